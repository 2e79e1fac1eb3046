// SPDX-License-Identifier: MIT
#include "tarsier/synth/plate_painter.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

// Additional contents of wild plates, and their wear.
namespace tarsier::synth {

void make_wild(PlateStyle& style, bool slogans, Rng& rng) {
  const auto with_probability = [&](double p) { return rng.uniform() < p; };
  style.digit_width *= rng.uniform(0.85, 1.2);
  style.gap *= rng.uniform(0.6, 1.3);
  if (with_probability(0.15)) style.slant = rng.normal(0, 0.1);
  // A town, a state or a slogan above or below; the text moves.
  const double spare = style.height - style.cap_height;
  if (slogans && with_probability(0.35)) {
    style.slogan_above = with_probability(0.6);
    style.slogan_below = !style.slogan_above || with_probability(0.3);
    if (spare < 0.35 * style.height) style.cap_height *= rng.uniform(0.76, 0.9);
    const double shift = rng.uniform(0.02, 0.09);
    style.centre = std::clamp(
        style.centre + (style.slogan_above ? shift : 0) - (style.slogan_below ? shift : 0), 0.42,
        0.64);
  }
  if (with_probability(0.4)) {  // an emblem that fills the gap, sometimes as high as the letters
    style.emblem = rng.uniform(0.4, 1.1);
    style.group_gap =
        std::max(style.group_gap, style.cap_height * style.emblem * rng.uniform(0.6, 1.1));
  }
  style.has_stacked_letters = with_probability(0.07);
  if (with_probability(0.5)) {
    style.relief = rng.uniform(0.5, 2.5);
    style.relief_direction = rng.uniform(0, 2 * CV_PI);
    style.relief_strength = rng.uniform(0.15, 0.7);
  }
  if (with_probability(0.3)) style.max_wear = rng.uniform(0.1, 0.8);
  if (with_probability(0.35)) {  // faint ink
    const double share = rng.uniform(0.05, 0.6);
    style.ink = style.ink * (1 - share) + style.ground * share;
  }
  style.lattice = with_probability(0.15) ? rng.uniform(4, 22) : 0;
  style.has_crests = with_probability(0.7);
  style.has_side_symbols = with_probability(0.06);
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

void relief(const PlatePainter& p, const PlateStyle& style, const cv::Mat& mask, cv::Point corner) {
  const double far = style.relief * p.s;
  const cv::Point away(cvRound(far * std::cos(style.relief_direction)),
                       cvRound(far * std::sin(style.relief_direction)));
  if (away == cv::Point(0, 0)) return;
  blend(p.image, mask * style.relief_strength, corner - away, Color::all(255));
  blend(p.image, mask * style.relief_strength, corner + away, Color::all(30));
}

void lattice(const PlatePainter& p, const PlateStyle& style) {
  const double pitch = p.rng.uniform(7, 30);
  const double lean = p.rng.uniform(-1, 1);
  const Color line =
      style.ground + Color::all(p.with_probability(0.5) ? style.lattice : -style.lattice);
  for (double x = -style.height; x < style.width + style.height; x += pitch) {
    cv::line(p.image, p.at(x, 0), p.at(x + lean * style.height, style.height), line,
             std::max(1, p.px(2)), cv::LINE_AA);
    if (std::abs(lean) > 0.3)
      cv::line(p.image, p.at(x, 0), p.at(x - lean * style.height, style.height), line,
               std::max(1, p.px(2)), cv::LINE_AA);
  }
}

void slogans(const PlatePainter& p, const PlateStyle& style) {
  const double middle = style.height * style.centre;
  for (const bool above : {true, false}) {
    if (!(above ? style.slogan_above : style.slogan_below)) continue;
    const double room = (above ? middle : style.height - middle) - style.cap_height / 2;
    if (room < 9) continue;
    const double cap = std::clamp(room * p.rng.uniform(0.4, 0.75), 5.0, 22.0);
    const double y = above ? room / 2 : style.height - room / 2;
    std::string text = random_word(p.rng, 2, 10);
    if (p.with_probability(0.6)) {
      text += ' ';
      text += random_word(p.rng, 2, 9);
    }
    if (p.with_probability(0.3)) text = random_word(p.rng, 1, 2) + " " + text;
    const Color color = p.with_probability(0.7) ? style.ink : p.any_color();
    const double stretch = p.rng.uniform(0.8, 1.5);
    const double x = style.width * p.rng.uniform(0.42, 0.58);
    small_text(p, text, x, y, cap, color, stretch);
  }
}

double stacked_letters(const PlatePainter& p, const PlateStyle& style, double x, double y) {
  const double cap = style.cap_height * p.rng.uniform(0.36, 0.46);
  const bool digits = p.with_probability(0.3);
  for (const double side : {-1.0, 1.0}) {
    const std::string one =
        digits ? std::string(1, kPlateSymbols[static_cast<std::size_t>(p.rng.integer(0, 9))])
               : random_word(p.rng, 1, 1);
    small_text(p, one, x, y + side * style.cap_height * 0.26, cap, style.ink, 0.9);
  }
  return cap * 0.8;
}

double side_symbols(const PlatePainter& p, const PlateStyle& style, double x, double y, bool ends) {
  std::string text;
  const bool digits = p.with_probability(0.5);
  for (int i = p.rng.integer(1, 3); i > 0; --i)
    text += kPlateSymbols[static_cast<std::size_t>(digits ? p.rng.integer(0, 9)
                                                          : p.rng.integer(10, 35))];
  const double cap = style.cap_height * p.rng.uniform(0.3, 0.6);
  const double width = cap * 0.62 * static_cast<double>(text.size());
  const double down = p.rng.uniform(-0.5, 0.5) * (style.cap_height - cap);
  const Color color = p.with_probability(0.8) ? style.ink : p.any_color();
  small_text(p, text, ends ? x - width / 2 : x + width / 2, y + down, cap, color, 0.9);
  return width * 1.15;
}

void crest(const PlatePainter& p, const PlateStyle& style, double x, double y, double radius) {
  const auto any_tone = [&] { return p.with_probability(0.3) ? style.ink : p.any_color(); };
  // Its outline.
  std::vector<cv::Point> outline;
  const double narrow = p.rng.uniform(0.6, 1.05);
  const double kind = p.rng.uniform();
  if (kind < 0.4) {  // a shield
    const double shoulder = p.rng.uniform(0, 0.5);
    outline = {p.at(x - radius * narrow, y - radius), p.at(x + radius * narrow, y - radius),
               p.at(x + radius * narrow, y + radius * shoulder), p.at(x, y + radius * 1.1),
               p.at(x - radius * narrow, y + radius * shoulder)};
  } else if (kind < 0.6) {  // a square
    outline = {p.at(x - radius * narrow, y - radius), p.at(x + radius * narrow, y - radius),
               p.at(x + radius * narrow, y + radius), p.at(x - radius * narrow, y + radius)};
  } else {  // a map or a bird: a round shape with a rough edge
    const int corners = p.rng.integer(9, 20);
    const double rough = p.rng.uniform(0.1, 0.6);
    for (int i = 0; i < corners; ++i) {
      const double a = 2 * CV_PI * i / corners;
      const double r = radius * (1 - rough * p.rng.uniform());
      outline.push_back(p.at(x + r * narrow * std::cos(a), y + r * std::sin(a)));
    }
  }
  cv::Mat mask(p.image.size(), CV_8UC1, Color(0));
  const std::vector<std::vector<cv::Point>> shape{outline};
  const bool line_only = p.with_probability(0.2);
  if (!line_only) {
    cv::fillPoly(mask, shape, Color(255), cv::LINE_AA);
    blend(p.image, mask, {0, 0}, any_tone());
    // Fields and charges inside the outline.
    cv::Mat inside(p.image.size(), CV_8UC1, Color(0));
    for (int i = p.rng.integer(1, 5); i > 0; --i) {
      inside.setTo(0);
      const double across = p.rng.uniform(-0.7, 0.7) * radius;
      const double down = p.rng.uniform(-0.8, 0.8) * radius;
      const double wide = p.rng.uniform(0.1, 0.6) * radius;
      const double high = p.rng.uniform(0.1, 0.6) * radius;
      const cv::Size axes{std::max(1, p.px(wide)), std::max(1, p.px(high))};
      if (p.with_probability(0.5))
        cv::ellipse(inside, p.at(x + across, y + down), axes, p.rng.uniform(0, 180), 0, 360,
                    Color(255), cv::FILLED, cv::LINE_AA);
      else
        cv::rectangle(inside,
                      cv::Rect(p.at(x + across - wide, y + down - high),
                               p.at(x + across + wide, y + down + high)),
                      Color(255), cv::FILLED);
      cv::bitwise_and(inside, mask, inside);
      blend(p.image, inside, {0, 0}, any_tone());
    }
  }
  if (line_only || p.with_probability(0.5))
    cv::polylines(p.image, shape, true, any_tone(), std::max(1, p.px(radius * 0.12)), cv::LINE_AA);
}

void ghost(const PlatePainter& p, const PlateStyle& style, double x, double y) {
  const cv::Mat before = p.image.clone();
  crest(p, style, x, y, style.cap_height * p.rng.uniform(0.4, 1));
  const double strength = p.rng.uniform(0.1, 0.6);
  cv::addWeighted(p.image, strength, before, 1 - strength, 0, p.image);
}

}  // namespace tarsier::synth
