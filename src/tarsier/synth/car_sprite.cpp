// SPDX-License-Identifier: MIT
#include "tarsier/synth/car_sprite.h"

#include "tarsier/synth/glyphs.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::synth {
namespace {

using Points = std::vector<cv::Point2d>;
constexpr double kMillimetre = kBodyWidth / (kCarMetres * 1000);  // px

// Draws at twice the size, so that edges are smooth after reduction.
struct Sheet {
  cv::Mat color{2 * kSpriteHeight, 2 * kSpriteWidth, CV_8UC3, cv::Scalar(0, 0, 0)};
  cv::Mat alpha{2 * kSpriteHeight, 2 * kSpriteWidth, CV_8UC1, cv::Scalar(0)};

  // A closed polygon, also mirrored about the car's centre if `both`.
  void fill(const Points& points, const cv::Scalar& tone, bool both = false) {
    std::vector<cv::Point> scaled;
    for (const cv::Point2d& p : points) scaled.emplace_back(cvRound(p.x * 2), cvRound(p.y * 2));
    cv::fillPoly(color, std::vector<std::vector<cv::Point>>{scaled}, tone);
    cv::fillPoly(alpha, std::vector<std::vector<cv::Point>>{scaled}, cv::Scalar(255));
    if (!both) return;
    Points mirrored;
    for (const cv::Point2d& p : points) mirrored.emplace_back(kSpriteWidth - p.x, p.y);
    fill(mirrored, tone, false);
  }
  void disc(cv::Point2d centre, cv::Size2d radius, const cv::Scalar& tone, bool both = false) {
    const cv::Size axes(cvRound(radius.width * 2), cvRound(radius.height * 2));
    for (const double x : {centre.x, kSpriteWidth - centre.x}) {
      const cv::Point at(cvRound(x * 2), cvRound(centre.y * 2));
      cv::ellipse(color, at, axes, 0, 0, 360, tone, cv::FILLED);
      cv::ellipse(alpha, at, axes, 0, 0, 360, cv::Scalar(255), cv::FILLED);
      if (!both) return;
    }
  }
  // Light from above: brightens the upper parts and darkens the lower ones between two rows.
  void shade(double from, double to, double top, double bottom) const {
    for (int y = cvRound(from * 2); y < cvRound(to * 2) && y < color.rows; ++y) {
      const double t = (y - from * 2) / ((to - from) * 2);
      color.row(y) *= top + (bottom - top) * t;
    }
  }
};

// A rectangle with rounded corners as a polygon.
Points rounded(double x0, double y0, double x1, double y1, double radius) {
  Points points;
  const cv::Point2d centres[4] = {{x1 - radius, y0 + radius},
                                  {x1 - radius, y1 - radius},
                                  {x0 + radius, y1 - radius},
                                  {x0 + radius, y0 + radius}};
  for (int corner = 0; corner < 4; ++corner) {
    for (int i = 0; i <= 6; ++i) {
      const double a = (corner - 1) * CV_PI / 2 + i * CV_PI / 12;
      points.emplace_back(centres[corner].x + radius * std::cos(a),
                          centres[corner].y + radius * std::sin(a));
    }
  }
  return points;
}

cv::Scalar body_color(Rng& rng) {
  static const cv::Scalar kColors[] = {{235, 235, 235}, {200, 200, 198}, {120, 118, 116},
                                       {45, 42, 40},    {40, 35, 150},   {140, 80, 30},
                                       {70, 110, 60},   {60, 170, 210},  {150, 140, 100}};
  cv::Scalar color = kColors[static_cast<std::size_t>(rng.integer(0, 8))];
  for (int c = 0; c < 3; ++c) color[c] = std::clamp(color[c] + rng.normal(0, 10), 20.0, 250.0);
  return color;
}

void draw_body(Sheet& sheet, const cv::Scalar& paint, bool rear, double roof, Rng& rng) {
  const double middle = kSpriteWidth / 2.0;
  const cv::Scalar dark = paint * 0.55;
  const cv::Scalar glass(72, 62, 55);
  // Tyres, then the body over them.
  sheet.fill(rounded(52, 455, 132, 606, 18), {28, 28, 28}, true);
  // Cabin.
  const double eaves = middle - 215;
  sheet.fill({{eaves, roof}, {kSpriteWidth - eaves, roof}, {kSpriteWidth - 92, 272}, {92, 272}},
             paint);
  sheet.disc({middle, roof + 6}, {215, 16}, paint);
  sheet.fill({{eaves + 16, roof + 18},
              {kSpriteWidth - eaves - 16, roof + 18},
              {kSpriteWidth - 128, 262},
              {128, 262}},
             glass);
  // Sky in the glass, and a hint of seats behind it.
  sheet.fill({{eaves + 26, roof + 22}, {middle + 40, roof + 22}, {middle - 90, 256}, {140, 256}},
             {104, 94, 86});
  for (const double x : {middle - 105, middle + 105})
    sheet.fill(rounded(x - 42, 178, x + 42, 256, 20), {50, 45, 42});
  // Lower body.
  sheet.fill(rounded(30, 250, kSpriteWidth - 30, 560, 58), paint);
  sheet.fill({{60, 300}, {kSpriteWidth - 60, 300}, {kSpriteWidth - 64, 304}, {64, 304}}, dark);
  // Mirrors.
  sheet.fill(rounded(20, 228, 88, 268, 14), dark, true);
  // Bumper with a dark lip below.
  sheet.fill(rounded(34, 468, kSpriteWidth - 34, 566, 30), paint * 0.9);
  sheet.fill(rounded(70, 532, kSpriteWidth - 70, 570, 14), {38, 38, 38});
  sheet.fill({{46, 464}, {kSpriteWidth - 46, 464}, {kSpriteWidth - 46, 468}, {46, 468}}, dark);
  if (rear) {
    sheet.fill(rounded(44, 318, 148, 408, 22), {36, 30, 150}, true);
    sheet.fill(rounded(54, 372, 138, 398, 10), {215, 215, 220}, true);
    sheet.fill({{150, 312}, {152, 312}, {168, 462}, {166, 462}}, dark, true);
    sheet.fill(rounded(middle - 44, 330, middle + 44, 344, 6), {190, 190, 190});
  } else {
    sheet.fill(rounded(48, 330, 176, 398, 30), {205, 205, 200}, true);
    sheet.disc({112, 364}, {30, 26}, {245, 245, 240}, true);
    sheet.fill(rounded(206, 338, kSpriteWidth - 206, 410, 18), {40, 40, 40});
    for (double y = 348; y < 406; y += 14)
      sheet.fill({{214, y}, {kSpriteWidth - 214, y}, {kSpriteWidth - 214, y + 4}, {214, y + 4}},
                 {110, 110, 112});
    sheet.disc({middle, 374}, {24, 24}, {205, 205, 205});
    sheet.disc({150, 520}, {22, 14}, {190, 190, 185}, true);
  }
  (void)rng;
}

cv::Mat lit(const cv::Mat& color, StreetLight light) {
  cv::Mat result;
  if (light == StreetLight::kDay) return color;
  if (light == StreetLight::kNight) {
    cv::Mat blue;
    color.convertTo(result, -1, 0.22, 2);
    return result;
  }
  cv::cvtColor(color, result, cv::COLOR_BGR2GRAY);
  result.convertTo(result, -1, 0.16, 4);
  cv::cvtColor(result, result, cv::COLOR_GRAY2BGR);
  return result;
}

}  // namespace

CarSprite draw_car(const GlyphSet& glyphs, StreetLight light, PlateKind kind,
                   const std::string& text, Rng& rng, bool wild) {
  CarSprite car;
  car.rear = rng.uniform() < 0.5;
  Sheet sheet;
  const cv::Scalar paint = body_color(rng);
  const double roof = rng.uniform(58, 110);
  draw_body(sheet, paint, car.rear, roof, rng);
  sheet.shade(roof, 280, 1.0, 0.82);
  sheet.shade(280, 575, 1.08, 0.66);

  PlateFaceOptions options;
  options.kind = kind;
  options.text = text;
  options.random_style = options.wild = wild;
  options.infrared = light == StreetLight::kInfrared;
  options.px_per_mm = static_cast<float>(2 * kMillimetre);
  const PlateFace face = render_plate_face(glyphs, options, rng);
  car.text = face.text;
  // Behind, the plate may be on the lid; in front it is on the bumper.
  const double plate_y = face.rows == 2 ? 430 : car.rear ? rng.uniform(395, 500) : 505;
  const cv::Point corner(kSpriteWidth - face.image.cols / 2,
                         cvRound(plate_y * 2) - face.image.rows / 2);
  const cv::Rect place(corner, face.image.size());
  cv::Mat color = lit(sheet.color, light);
  cv::rectangle(color, place + cv::Point(-6, -6) + cv::Size(12, 12), paint * 0.25, cv::FILLED);
  cv::Mat plate = face.image;
  if (light == StreetLight::kNight) plate.convertTo(plate, -1, 0.75, 0);
  plate.copyTo(color(place));
  car.plate = {static_cast<float>(corner.x) / 2, static_cast<float>(corner.y) / 2,
               static_cast<float>(place.width) / 2, static_cast<float>(place.height) / 2};
  const cv::Rect2f lamp = car.rear ? cv::Rect2f(44, 318, 104, 60) : cv::Rect2f(82, 338, 60, 52);
  car.lamps = {lamp, {kSpriteWidth - lamp.x - lamp.width, lamp.y, lamp.width, lamp.height}};

  cv::Mat level;
  cv::Mat cover;
  cv::resize(color, level, {kSpriteWidth, kSpriteHeight}, 0, 0, cv::INTER_AREA);
  cv::resize(sheet.alpha, cover, {kSpriteWidth, kSpriteHeight}, 0, 0, cv::INTER_AREA);
  for (int i = 0; i < 5; ++i) {
    car.color.push_back(level);
    car.alpha.push_back(cover);
    cv::Mat half;
    cv::resize(level, half, {}, 0.5, 0.5, cv::INTER_AREA);
    level = half;
    cv::Mat less;
    cv::resize(cover, less, {}, 0.5, 0.5, cv::INTER_AREA);
    cover = less;
  }
  return car;
}

}  // namespace tarsier::synth
