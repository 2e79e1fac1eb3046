// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/training_views.h"

#include "tarsier/core/require.h"
#include "tarsier/media/image_file.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace tarsier::plate {
namespace {

double log_uniform(double low, double high, Rng& rng) {
  return low * std::pow(high / low, rng.uniform());
}

// Grey with random weights: simulates another sensor, filter or light.
cv::Mat random_gray(const cv::Mat& bgr, Rng& rng) {
  double weights[3] = {0.114, 0.587, 0.299};
  if (rng.uniform() < 0.5) {
    double sum = 0;
    for (double& weight : weights) sum += weight = rng.uniform(0.05, 1);
    for (double& weight : weights) weight /= sum;
  }
  const cv::Mat mix = (cv::Mat_<float>(1, 3) << weights[0], weights[1], weights[2]);
  cv::Mat gray;
  cv::transform(bgr, gray, mix);
  return gray;
}

// A piece of an image as the view's content, with a small rotation and stretch. Returns the map
// from the image to the view.
cv::Matx33d random_window(double scale, cv::Point2d anchor, cv::Point2d target, double roll,
                          Rng& rng) {
  const double stretch = std::exp(rng.normal(0, 0.07));
  const double c = std::cos(roll);
  const double s = std::sin(roll);
  const double sx = scale * stretch;
  const double sy = scale / stretch;
  return {sx * c, -sy * s, target.x - sx * c * anchor.x + sy * s * anchor.y,
          sx * s, sy * c,  target.y - sx * s * anchor.x - sy * c * anchor.y,
          0,      0,       1};
}

cv::Mat window_of(const cv::Mat& bgr, const cv::Matx33d& view_from_photo, cv::Size size, Rng& rng) {
  const cv::Matx33d inverse = view_from_photo.inv();
  const Quad in_photo = transformed(inverse, quad_of({0, 0, static_cast<float>(size.width - 1),
                                                      static_cast<float>(size.height - 1)}));
  float left = 1e9F;
  float top = 1e9F;
  float right = -1e9F;
  float bottom = -1e9F;
  for (const cv::Point2f& p : in_photo) {
    left = std::min(left, p.x);
    right = std::max(right, p.x);
    top = std::min(top, p.y);
    bottom = std::max(bottom, p.y);
  }
  cv::Rect reach(static_cast<int>(left) - 4, static_cast<int>(top) - 4,
                 static_cast<int>(right - left) + 9, static_cast<int>(bottom - top) + 9);
  reach &= cv::Rect(0, 0, bgr.cols, bgr.rows);
  if (reach.width < 2 || reach.height < 2) return cv::Mat(size, CV_8UC1, cv::Scalar(90));
  const cv::Mat gray = random_gray(bgr(reach), rng);
  Quad shifted = in_photo;
  for (cv::Point2f& p : shifted) p -= cv::Point2f(reach.tl());
  return sample(
      gray, shifted,
      quad_of({0, 0, static_cast<float>(size.width - 1), static_cast<float>(size.height - 1)}),
      size);
}

// Projects a rectangle of width x height (mm) under a random rotation, centred at 0; 1 unit = 1 mm
// at its own distance.
Quad random_pose(double width, double height, const ViewOptions& options, Rng& rng) {
  const double deg = std::numbers::pi / 180;
  // Most plates are seen nearly frontally; some from a large angle.
  const double spread = rng.uniform() < 0.6 ? 0.25 : 0.7;
  const auto angle = [&](double limit) {
    return std::clamp(rng.normal(0, limit * spread), -limit, limit) * deg;
  };
  const double yaw = angle(options.yaw_deg);
  const double pitch = angle(30);
  const double roll = angle(options.roll_deg);
  const double distance = width * log_uniform(2.5, 14, rng);
  Quad quad;
  const double xs[4] = {-width / 2, width / 2, width / 2, -width / 2};
  const double ys[4] = {-height / 2, -height / 2, height / 2, height / 2};
  for (std::size_t i = 0; i < 4; ++i) {
    const double x1 = xs[i] * std::cos(yaw);
    const double z1 = -xs[i] * std::sin(yaw);
    const double y2 = ys[i] * std::cos(pitch) - z1 * std::sin(pitch);
    const double z2 = ys[i] * std::sin(pitch) + z1 * std::cos(pitch);
    const double f = distance / (distance + z2);
    const double px = x1 * f;
    const double py = y2 * f;
    quad[i] = {static_cast<float>(px * std::cos(roll) - py * std::sin(roll)),
               static_cast<float>(px * std::sin(roll) + py * std::cos(roll))};
  }
  return quad;
}

Quad around(const std::vector<cv::Rect2f>& boxes) {
  cv::Rect2f all = boxes.front();
  for (const cv::Rect2f& box : boxes) all |= box;
  return quad_of(all);
}

// Draws something like a bumper or boot lid behind the plate, so that the network does not
// recognise plates by the pasting.
void draw_surroundings(cv::Mat& view, const Quad& quad, Rng& rng) {
  if (rng.uniform() < 0.35) return;
  const auto higher = static_cast<float>(rng.uniform(1.15, 4.0));
  const auto grown = grow(quad, static_cast<float>(rng.uniform(1.05, 2.2)), higher);
  std::array<cv::Point, 4> points;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto y = static_cast<float>(rng.normal(0, 2));
    points[i] = grown[i] + cv::Point2f(static_cast<float>(rng.normal(0, 2)), y);
  }
  // Bright bodies are as frequent as dark ones, and often as bright as the plate.
  const double tone = rng.uniform() < 0.5 ? rng.uniform(140, 255) : rng.uniform(5, 150);
  cv::Mat layer = view.clone();
  cv::fillConvexPoly(layer, points.data(), 4, cv::Scalar(tone), cv::LINE_AA);
  const double alpha = rng.uniform(0.5, 1);
  cv::addWeighted(layer, alpha, view, 1 - alpha, 0, view);
  if (rng.uniform() < 0.4) {  // the dark gap or frame around the plate
    const auto height = static_cast<float>(rng.uniform(1.05, 1.5));
    const auto frame = grow(quad, static_cast<float>(rng.uniform(1.02, 1.1)), height);
    for (std::size_t i = 0; i < 4; ++i) points[i] = frame[i];
    cv::fillConvexPoly(view, points.data(), 4, cv::Scalar(rng.uniform(5, 120)), cv::LINE_AA);
  }
}

synth::PlateKind random_kind(Rng& rng, bool wild) {
  const double k = rng.uniform();
  if (wild) {
    // Arbitrary shares of the kinds; none dominates.
    if (k < 0.15) return synth::PlateKind::kSpain;
    if (k < 0.19) return synth::PlateKind::kSpainSquare;
    if (k < 0.22) return synth::PlateKind::kSpainMoto;
    if (k < 0.57) return synth::PlateKind::kEurope;
    if (k < 0.87) return synth::PlateKind::kUs;
    return synth::PlateKind::kBrazil;
  }
  if (k < 0.20) return synth::PlateKind::kSpain;
  if (k < 0.23) return synth::PlateKind::kSpainOld;
  if (k < 0.28) return synth::PlateKind::kSpainSquare;
  if (k < 0.31) return synth::PlateKind::kSpainMoto;
  if (k < 0.66) return synth::PlateKind::kEurope;
  if (k < 0.93) return synth::PlateKind::kUs;
  return synth::PlateKind::kBrazil;
}

// Illumination of the plate itself.
void illuminate(cv::Mat& face, Rng& rng) {
  const double high = rng.uniform() < 0.15 ? rng.uniform(40, 120) : rng.uniform(110, 255);
  const double low = rng.uniform(0, 0.45) * high;
  face.convertTo(face, -1, (high - low) / 255, low);
  if (rng.uniform() < 0.4) {  // a gradient
    const double a = rng.uniform(0.5, 1.1);
    const double b = rng.uniform(0.5, 1.1);
    for (int x = 0; x < face.cols; ++x) {
      const double gain = a + (b - a) * x / face.cols;
      for (int y = 0; y < face.rows; ++y)
        face.at<std::uint8_t>(y, x) =
            cv::saturate_cast<std::uint8_t>(face.at<std::uint8_t>(y, x) * gain);
    }
  }
  if (rng.uniform() < 0.25) {  // the edge of a shadow
    std::array<cv::Point, 4> shadow{cv::Point(rng.integer(-face.cols, face.cols), -2),
                                    cv::Point(rng.integer(0, 2 * face.cols), -2),
                                    cv::Point(rng.integer(0, 2 * face.cols), face.rows + 2),
                                    cv::Point(rng.integer(-face.cols, face.cols), face.rows + 2)};
    cv::Mat mask(face.size(), CV_8UC1, cv::Scalar(0));
    cv::fillConvexPoly(mask, shadow.data(), 4, cv::Scalar(255));
    cv::Mat dark;
    face.convertTo(dark, -1, rng.uniform(0.35, 0.8));
    dark.copyTo(face, mask);
  }
}

void paste_plate(View& view, const ViewOptions& options, const synth::GlyphSet& glyphs, Rng& rng) {
  synth::PlateFaceOptions face_options;
  const bool wild = options.wild && rng.uniform() < 0.7;
  face_options.kind = random_kind(rng, wild);
  face_options.wild = wild;
  face_options.any_text = !options.valid_text;
  face_options.random_style = rng.uniform() < 0.95;
  face_options.infrared = rng.uniform() < 0.08;
  const double width = log_uniform(options.min_width, options.max_width, rng);
  // Enough pixels for the view, but not many more: drawing is the slow part.
  face_options.px_per_mm = static_cast<float>(std::clamp(width / 250, 0.35, 1.2));
  const synth::PlateFace face = synth::render_plate_face(glyphs, face_options, rng);
  if (face.rows > 2 || face.symbols.empty()) return;
  cv::Mat gray = random_gray(face.image, rng);
  illuminate(gray, rng);
  Quad quad = random_pose(face.image.cols, face.image.rows, options, rng);
  const double factor = width / mean_width(quad);
  const double spread = options.centred ? 0.06 : 0.5;
  const double down = view.gray.rows * (0.5 + rng.uniform(-spread, spread));
  const double across = view.gray.cols * (0.5 + rng.uniform(-spread, spread));
  const cv::Point2f centre(static_cast<float>(across), static_cast<float>(down));
  for (cv::Point2f& p : quad) p = p * factor + centre;
  if (!is_convex(quad, 60)) return;
  for (const ViewPlate& other : view.plates)
    if (box_iou(grow(other.plate, 1.2F, 1.4F), quad) > 0) return;
  const Quad source = quad_of(
      {-0.5F, -0.5F, static_cast<float>(face.image.cols), static_cast<float>(face.image.rows)});
  draw_surroundings(view.gray, quad, rng);
  const cv::Mat warped = sample(gray, source, quad, view.gray.size());
  // Coverage with soft edges: drawn at four times the size.
  cv::Mat mask(view.gray.size(), CV_8UC1, cv::Scalar(0));
  std::array<cv::Point, 4> points;
  for (std::size_t i = 0; i < 4; ++i)
    points[i] = cv::Point(cvRound(quad[i].x * 16), cvRound(quad[i].y * 16));
  cv::fillConvexPoly(mask, points.data(), 4, cv::Scalar(255), cv::LINE_AA, 4);
  for (int y = 0; y < mask.rows; ++y) {
    for (int x = 0; x < mask.cols; ++x) {
      const int a = mask.at<std::uint8_t>(y, x);
      if (a == 0) continue;
      auto& pixel = view.gray.at<std::uint8_t>(y, x);
      pixel =
          static_cast<std::uint8_t>((pixel * (255 - a) + warped.at<std::uint8_t>(y, x) * a) / 255);
    }
  }
  const cv::Matx33d map = map_between(source, quad);
  ViewPlate plate;
  plate.plate = quad;
  plate.rows = face.rows;
  plate.has_text_quad = true;
  std::vector<cv::Rect2f> boxes;
  for (const synth::PlateSymbol& symbol : face.symbols) {
    boxes.push_back(symbol.box);
    plate.symbols.push_back({symbol.symbol, transformed(map, quad_of(symbol.box)), symbol.row});
  }
  plate.text = transformed(map, around(boxes));
  view.plates.push_back(std::move(plate));
}

void draw_random_text(cv::Mat& gray, Rng& rng) {
  const std::string_view letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789";
  std::string text;
  for (int i = rng.integer(2, 12); i > 0; --i)
    text += letters[static_cast<std::size_t>(rng.integer(0, static_cast<int>(letters.size()) - 1))];
  const double tone = rng.uniform(0, 255);
  const int thickness = rng.integer(1, 3);
  const double size = rng.uniform(0.25, 1.2);
  const int face = rng.integer(0, 4);
  const cv::Point at{rng.integer(-20, gray.cols - 10), rng.integer(8, gray.rows)};
  cv::putText(gray, text, at, face, size, cv::Scalar(tone), thickness, cv::LINE_AA);
}

}  // namespace

void ViewOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_width <= max_width, "plates of {} to {} px", min_width, max_width);
}

void simulate_camera(cv::Mat& gray, double strength, Rng& rng) {
  if (rng.uniform() < 0.7) {
    const double sigma = rng.uniform(0.3, 0.5 + 0.9 * strength);
    cv::GaussianBlur(gray, gray, {}, sigma, sigma * rng.uniform(0.7, 1.3));
  }
  if (rng.uniform() < 0.2 * strength) {
    const int length = rng.integer(2, 2 + static_cast<int>(4 * strength));
    cv::Mat kernel(2 * length + 1, 2 * length + 1, CV_32F, cv::Scalar(0));
    const double angle =
        rng.uniform() < 0.5 ? rng.normal(0, 0.15) : rng.uniform(0, std::numbers::pi);
    const cv::Point2d d(std::cos(angle) * length / 2, std::sin(angle) * length / 2);
    cv::line(kernel, cv::Point(cvRound(length - d.x), cvRound(length - d.y)),
             cv::Point(cvRound(length + d.x), cvRound(length + d.y)), cv::Scalar(1));
    kernel /= cv::sum(kernel)[0];
    cv::filter2D(gray, gray, -1, kernel, {-1, -1}, 0, cv::BORDER_REPLICATE);
  }
  if (rng.uniform() < 0.6) {
    // Tone: gamma, gain, offset; also over- and underexposed.
    const double gamma = std::exp(rng.normal(0, 0.22));
    const double gain = std::exp(rng.normal(0, 0.25));
    const double offset = rng.normal(0, 15);
    cv::Mat table(1, 256, CV_8U);
    for (int i = 0; i < 256; ++i)
      table.at<std::uint8_t>(i) =
          cv::saturate_cast<std::uint8_t>(255 * std::pow(i / 255.0, gamma) * gain + offset);
    cv::LUT(gray, table, gray);
  }
  if (rng.uniform() < 0.7) {
    const double sigma =
        rng.uniform() < 0.88 ? rng.uniform(0, 6) : rng.uniform(6, 8 + 8 * strength);
    // A table of normal numbers is sufficient and fast.
    float normals[256];
    for (float& value : normals) value = static_cast<float>(rng.normal(0, sigma));
    std::uint64_t bits = rng();
    for (int y = 0; y < gray.rows; ++y) {
      std::uint8_t* row = gray.ptr(y);
      for (int x = 0; x < gray.cols; ++x) {
        bits = bits * 6364136223846793005ULL + 1442695040888963407ULL;
        row[x] = cv::saturate_cast<std::uint8_t>(static_cast<float>(row[x]) + normals[bits >> 56U]);
      }
    }
  }
  if (rng.uniform() < 0.3) {
    const auto bytes = encode_image(".jpg", gray, "a view", rng.integer(25, 90));
    cv::extractChannel(decode_image(bytes, "a view"), gray, 0);
  }
}

void simulate_cheap_camera(cv::Mat& gray, Rng& rng) {
  const auto with_probability = [&](double p) { return rng.uniform() < p; };
  if (with_probability(0.12)) {  // downscaling and upscaling
    const double scale = rng.uniform(0.45, 0.85);
    const cv::Size size = gray.size();
    cv::Mat small;
    cv::resize(gray, small, {}, scale, scale,
               with_probability(0.5) ? cv::INTER_AREA : cv::INTER_LINEAR);
    cv::resize(small, gray, size, 0, 0, with_probability(0.6) ? cv::INTER_CUBIC : cv::INTER_LINEAR);
  }
  if (with_probability(0.15)) {  // sharpening
    cv::Mat soft;
    const double sigma = rng.uniform(0.8, 2.2);
    cv::GaussianBlur(gray, soft, {}, sigma);
    const double amount = rng.uniform(0.4, 2);
    cv::addWeighted(gray, 1 + amount, soft, -amount, 0, gray);
  }
  if (with_probability(0.1)) {  // a dark corner, haze
    const double gain = rng.uniform(0.12, 0.5);
    gray.convertTo(gray, -1, gain, rng.uniform(0, 255 * (1 - gain)));
  }
  if (with_probability(0.15)) {
    const auto bytes = encode_image(".jpg", gray, "a view", rng.integer(8, 30));
    cv::extractChannel(decode_image(bytes, "a view"), gray, 0);
  }
}

View ViewGenerator::make_hard_negative(const ViewOptions& options, Rng& rng, Quad& quad) const {
  options.check();
  TARSIER_REQUIRE(!hard_negatives.empty(), "there are no distractors");
  const HardNegative& chosen = hard_negatives[static_cast<std::size_t>(
      rng.integer(0, static_cast<int>(hard_negatives.size()) - 1))];
  const Scene& scene = scenes[chosen.scene];
  const cv::Point2d anchor =
      (chosen.quad[0] + chosen.quad[1] + chosen.quad[2] + chosen.quad[3]) * 0.25F;
  const double width = log_uniform(options.min_width, options.max_width, rng);
  const double scale = std::min(width / static_cast<double>(mean_width(chosen.quad)), 2.5);
  const cv::Matx33d map =
      random_window(scale, anchor, {options.size.width / 2.0, options.size.height / 2.0},
                    rng.normal(0, 0.06), rng);
  View view;
  view.gray = window_of(scene.image, map, options.size, rng);
  quad = transformed(map, chosen.quad);
  simulate_camera(view.gray, 1.0, rng);
  return view;
}

View ViewGenerator::make(const ViewOptions& options, Rng& rng) const {
  options.check();
  TARSIER_REQUIRE(!scenes.empty(), "training needs images");
  View view;
  const double random_type = rng.uniform();
  const bool none = random_type < options.none;
  const bool drawn = !none && glyphs != nullptr && rng.uniform() < options.drawn;
  const Scene* scene = nullptr;
  for (int tries = 0; tries < 60; ++tries) {
    scene = &scenes[static_cast<std::size_t>(rng.integer(0, static_cast<int>(scenes.size()) - 1))];
    if (drawn || none || !scene->plates.empty()) break;
  }
  const cv::Size photo = scene->image.size();
  const cv::Point2d center(options.size.width / 2.0, options.size.height / 2.0);
  cv::Matx33d map;
  const double roll = rng.normal(0, 0.06);
  if (!drawn && !none && !scene->plates.empty()) {
    const cv::Rect2f box = scene->plates[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(scene->plates.size()) - 1))];
    const double width = log_uniform(options.min_width, options.max_width, rng);
    const double spread = options.centred ? 0.06 : 0.45;
    const double y = options.size.height * (0.5 + rng.uniform(-spread, spread));
    const double x = options.size.width * (0.5 + rng.uniform(-spread, spread));
    const cv::Point2d target(x, y);
    const double scale = std::min(width / box.width, 2.0);
    map = random_window(scale, {box.x + box.width / 2.0, box.y + box.height / 2.0}, target, roll,
                        rng);
  } else {
    const double min_scale = std::max(static_cast<double>(options.size.width) / photo.width,
                                      static_cast<double>(options.size.height) / photo.height);
    const double scale =
        std::min(log_uniform(min_scale, std::max(min_scale * 1.01, 1.5), rng), 3.0);
    const double y = rng.uniform(0, photo.height);
    const cv::Point2d anchor(rng.uniform(0, photo.width), y);
    map = random_window(scale, anchor, center, roll, rng);
  }
  view.gray = window_of(scene->image, map, options.size, rng);
  for (const cv::Rect2f& box : scene->plates) {
    ViewPlate plate;
    plate.plate = transformed(map, quad_of(box));
    view.plates.push_back(plate);
  }
  if (rng.uniform() < 0.25)
    for (int i = rng.integer(1, 3); i > 0; --i) {
      bool on_plate = false;
      for (const ViewPlate& plate : view.plates)
        on_plate = on_plate ||
                   box_iou(plate.plate, quad_of({0, 0, static_cast<float>(options.size.width),
                                                 static_cast<float>(options.size.height)})) > 0;
      if (!on_plate) draw_random_text(view.gray, rng);
    }
  if (drawn) {
    paste_plate(view, options, *glyphs, rng);
    if (!options.centred && rng.uniform() < 0.3) paste_plate(view, options, *glyphs, rng);
  }
  simulate_camera(view.gray, 1.0, rng);
  if (options.wild) simulate_cheap_camera(view.gray, rng);
  return view;
}

}  // namespace tarsier::plate
