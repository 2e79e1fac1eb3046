// SPDX-License-Identifier: MIT
#include "tarsier/synth/plate_painter.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

// What plates in the wild have beside their text, and what time does to them.
namespace tarsier::synth {

void make_wild(PlateLook& look, bool slogans, Rng& rng) {
  const auto chance = [&](double p) { return rng.uniform() < p; };
  look.cell *= rng.uniform(0.85, 1.2);
  look.gap *= rng.uniform(0.6, 1.3);
  if (chance(0.15)) look.slant = rng.normal(0, 0.1);
  // A town, a state or a slogan above or below: the text gives way.
  const double spare = look.height - look.cap;
  if (slogans && chance(0.35)) {
    look.slogan_above = chance(0.6);
    look.slogan_below = !look.slogan_above || chance(0.3);
    if (spare < 0.35 * look.height) look.cap *= rng.uniform(0.76, 0.9);
    const double shift = rng.uniform(0.02, 0.09);
    look.centre =
        std::clamp(look.centre + (look.slogan_above ? shift : 0) - (look.slogan_below ? shift : 0),
                   0.42, 0.64);
  }
  if (chance(0.4)) {  // an emblem that fills the gap, as high as the letters now and then
    look.emblem = rng.uniform(0.4, 1.1);
    look.group_gap = std::max(look.group_gap, look.cap * look.emblem * rng.uniform(0.6, 1.1));
  }
  look.stacked = chance(0.07);
  if (chance(0.5)) {
    look.relief = rng.uniform(0.5, 2.5);
    look.relief_from = rng.uniform(0, 2 * CV_PI);
    look.relief_strength = rng.uniform(0.15, 0.7);
  }
  if (chance(0.3)) look.worn = rng.uniform(0.1, 0.8);
  if (chance(0.35)) {  // faint ink
    const double share = rng.uniform(0.05, 0.6);
    look.ink = look.ink * (1 - share) + look.ground * share;
  }
  look.lattice = chance(0.15) ? rng.uniform(4, 22) : 0;
}

void wear(cv::Mat& mask, double strength, Rng& rng) {
  const int columns = rng.integer(2, 5);
  cv::Mat field(rng.integer(2, 5), columns, CV_32F);
  for (int y = 0; y < field.rows; ++y)
    for (int x = 0; x < field.cols; ++x)
      field.at<float>(y, x) = static_cast<float>(1 - strength * std::pow(rng.uniform(), 2));
  cv::resize(field, field, mask.size(), 0, 0, cv::INTER_LINEAR);
  cv::Mat value;
  mask.convertTo(value, CV_32F);
  value = value.mul(field);
  value.convertTo(mask, CV_8U);
}

void relief(const PlatePainter& p, const PlateLook& look, const cv::Mat& mask, cv::Point corner) {
  const double far = look.relief * p.s;
  const cv::Point away(cvRound(far * std::cos(look.relief_from)),
                       cvRound(far * std::sin(look.relief_from)));
  if (away == cv::Point(0, 0)) return;
  blend(p.image, mask * look.relief_strength, corner - away, Color::all(255));
  blend(p.image, mask * look.relief_strength, corner + away, Color::all(30));
}

void lattice(const PlatePainter& p, const PlateLook& look) {
  const double pitch = p.rng.uniform(7, 30);
  const double lean = p.rng.uniform(-1, 1);
  const Color line = look.ground + Color::all(p.chance(0.5) ? look.lattice : -look.lattice);
  for (double x = -look.height; x < look.width + look.height; x += pitch) {
    cv::line(p.image, p.at(x, 0), p.at(x + lean * look.height, look.height), line,
             std::max(1, p.px(2)), cv::LINE_AA);
    if (std::abs(lean) > 0.3)
      cv::line(p.image, p.at(x, 0), p.at(x - lean * look.height, look.height), line,
               std::max(1, p.px(2)), cv::LINE_AA);
  }
}

void slogans(const PlatePainter& p, const PlateLook& look) {
  const double middle = look.height * look.centre;
  for (const bool above : {true, false}) {
    if (!(above ? look.slogan_above : look.slogan_below)) continue;
    const double room = (above ? middle : look.height - middle) - look.cap / 2;
    if (room < 9) continue;
    const double cap = std::clamp(room * p.rng.uniform(0.4, 0.75), 5.0, 22.0);
    const double y = above ? room / 2 : look.height - room / 2;
    std::string text = random_word(p.rng, 2, 10);
    if (p.chance(0.6)) text += " " + random_word(p.rng, 2, 9);
    if (p.chance(0.3)) text = random_word(p.rng, 1, 2) + " " + text;
    const Color color = p.chance(0.7) ? look.ink : p.any_color();
    const double stretch = p.rng.uniform(0.8, 1.5);
    const double x = look.width * p.rng.uniform(0.42, 0.58);
    small_text(p, text, x, y, cap, color, stretch);
  }
}

double stacked_letters(const PlatePainter& p, const PlateLook& look, double x, double y) {
  const double cap = look.cap * p.rng.uniform(0.36, 0.46);
  const bool digits = p.chance(0.3);
  for (const double side : {-1.0, 1.0}) {
    const std::string one =
        digits ? std::string(1, kPlateSymbols[static_cast<std::size_t>(p.rng.integer(0, 9))])
               : random_word(p.rng, 1, 1);
    small_text(p, one, x, y + side * look.cap * 0.26, cap, look.ink, 0.9);
  }
  return cap * 0.8;
}

}  // namespace tarsier::synth
