// SPDX-License-Identifier: MIT
#include "tarsier/face/face_training.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/image_file.h"
#include "tarsier/nn/trainer.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier {
namespace {

constexpr float kIgnore = -1;
constexpr double kLargestFace = 72;         // px; pictures with larger faces are reduced
constexpr double kLargestSide = 1400;       // px of pictures without faces
constexpr int kPatch = 64;                  // px, what the first network learns from
constexpr double kFits[2] = {14.0, 23.5};   // px, widths of faces that the first network answers
constexpr double kNearly[2] = {9.5, 34.0};  // and those where either answer will do

struct Picture {
  std::vector<cv::Mat> halves;
  std::vector<cv::Rect2d> faces;
  std::vector<cv::Rect2d> ignored;
  [[nodiscard]] cv::Size size() const { return halves[0].size(); }
};

// A place that was taken for a face.
struct Mistake {
  int picture = 0;
  cv::Rect2d box;
};

struct Material {
  std::vector<Picture> faces;            // pictures with faces
  std::vector<Picture> without;          // and those without
  std::vector<std::pair<int, int>> all;  // picture and face
  [[nodiscard]] const Picture& picture(int number) const {
    const auto count = static_cast<int>(without.size());
    return number < count ? without[static_cast<std::size_t>(number)]
                          : faces[static_cast<std::size_t>(number - count)];
  }
};

double logistic(double x) { return 1 / (1 + std::exp(-x)); }

double shared(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common / std::max(1e-9, a.area() + b.area() - common);
}

// --- views of pictures ---

// Turned, scaled, perhaps mirrored: view = A picture.
struct Place {
  cv::Matx23d view_from_picture;
  double scale = 1;
  [[nodiscard]] cv::Point2d operator()(const cv::Point2d& p) const {
    const cv::Matx23d& m = view_from_picture;
    return {m(0, 0) * p.x + m(0, 1) * p.y + m(0, 2), m(1, 0) * p.x + m(1, 1) * p.y + m(1, 2)};
  }
};

// `center` (px of the picture) comes to lie at `to`; coordinates run from the corners of pixels.
Place place(const cv::Point2d& center, const cv::Point2d& to, double scale, double turn,
            bool mirrored) {
  const double c = scale * std::cos(turn);
  const double s = scale * std::sin(turn);
  const double sign = mirrored ? -1 : 1;
  Place result;
  result.scale = scale;
  result.view_from_picture = {sign * c, -s, to.x - (sign * c * center.x - s * center.y),
                              sign * s, c,  to.y - (sign * s * center.x + c * center.y)};
  return result;
}

cv::Mat view_of(const Picture& picture, const Place& where, int side) {
  const int level = half_for(where.scale, picture.halves.size());
  const double unit = std::ldexp(1.0, level);
  // From corners to centres of pixels, on both sides.
  cv::Matx23d m = where.view_from_picture;
  cv::Matx23d warp(m(0, 0) * unit, m(0, 1) * unit, 0, m(1, 0) * unit, m(1, 1) * unit, 0);
  warp(0, 2) = m(0, 2) + 0.5 * (warp(0, 0) + warp(0, 1)) - 0.5;
  warp(1, 2) = m(1, 2) + 0.5 * (warp(1, 0) + warp(1, 1)) - 0.5;
  cv::Mat view;
  cv::warpAffine(picture.halves[static_cast<std::size_t>(level)], view, warp, cv::Size(side, side),
                 cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return view;
}

// Light, lens and sensor as they may be.
void disturb(cv::Mat& view, Rng& rng) {
  const double gamma = std::exp(rng.normal(0, 0.3));
  const double contrast = std::exp(rng.normal(0, 0.3));
  const double offset = rng.normal(0, 20);
  const double slope_x = rng.uniform() < 0.3 ? rng.normal(0, 1.2) : 0;
  const double slope_y = rng.uniform() < 0.3 ? rng.normal(0, 0.8) : 0;
  const double noise = rng.uniform() < 0.5 ? rng.uniform(0, 9) : 0;
  if (rng.uniform() < 0.25) {
    const double sigma = rng.uniform(0.4, 1.1);
    cv::GaussianBlur(view, view, cv::Size(0, 0), sigma);
  } else if (rng.uniform() < 0.25) {
    const int side = cvRound(view.cols * rng.uniform(0.55, 0.9));
    cv::Mat small;
    cv::resize(view, small, cv::Size(side, side), 0, 0, cv::INTER_AREA);
    cv::resize(small, view, view.size(), 0, 0, cv::INTER_LINEAR);
  }
  float curve[256];
  for (int i = 0; i < 256; ++i) {
    curve[i] =
        static_cast<float>((255 * std::pow(i / 255.0, gamma) - 128) * contrast + 128 + offset);
  }
  for (int y = 0; y < view.rows; ++y) {
    std::uint8_t* row = view.ptr(y);
    for (int x = 0; x < view.cols; ++x) {
      const double light = slope_x * (x - view.cols / 2) + slope_y * (y - view.rows / 2);
      const double grain = noise > 0 ? rng.normal(0, noise) : 0;
      row[x] = cv::saturate_cast<std::uint8_t>(curve[row[x]] + light + grain);
    }
  }
}

// Something before a part of the face.
void hide_part(cv::Mat& view, const cv::Rect2d& box, Rng& rng) {
  const double share = rng.uniform(0.15, 0.4);
  const int edge = rng.integer(0, 3);
  const double value = rng.uniform(0, 255);
  cv::Rect2d area(box.x - 0.3 * box.width, box.y - 0.3 * box.height, 1.6 * box.width,
                  1.6 * box.height);
  const double length = (0.3 + share) * box.width;
  if (edge == 0) area.width = length;
  if (edge == 1) area = {area.x + area.width - length, area.y, length, area.height};
  if (edge >= 2) area = {area.x, area.y + area.height - length, area.width, length};
  const cv::Rect whole =
      cv::Rect(cvRound(area.x), cvRound(area.y), cvRound(area.width), cvRound(area.height)) &
      cv::Rect(0, 0, view.cols, view.rows);
  if (whole.empty()) return;
  view(whole).setTo(cv::Scalar(value));
}

double turn_of(Rng& rng) { return std::clamp(rng.normal(0, 10.0), -30.0, 30.0) * CV_PI / 180; }

double log_uniform(Rng& rng, double low, double high) {
  return low * std::exp(rng.uniform() * std::log(high / low));
}

// Where any scale may be shown: a square of `side` px of the view, within the picture.
Place anywhere(const Picture& picture, int side, double smallest_scale, Rng& rng) {
  const double least = std::min(
      1.0, std::max(smallest_scale, static_cast<double>(side) /
                                        std::min(picture.size().width, picture.size().height)));
  const double scale = log_uniform(rng, least, std::max(1.0, least));
  const double x = rng.uniform(0, picture.size().width);
  const double y = rng.uniform(0, picture.size().height);
  const double turn = turn_of(rng);
  const bool mirrored = rng.uniform() < 0.5;
  return place({x, y}, {side / 2.0, side / 2.0}, scale, turn, mirrored);
}

// --- what the first network learns from ---

// Planes: label, is the box known, dx, dy, log of the growth.
constexpr std::size_t kScanPlanes = 5;

void label_scan(const Picture& picture, const Place& where, std::vector<float>& target) {
  constexpr int kSide = kPatch / kScanCell;
  constexpr std::size_t kPlane = kSide * kSide;
  target.assign(kScanPlanes * kPlane, 0.0F);
  const auto each_cell = [&](const auto& what) {
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        what(static_cast<std::size_t>(y * kSide + x),
             cv::Point2d((x + 0.5) * kScanCell, (y + 0.5) * kScanCell));
      }
    }
  };
  const auto inside = [](const cv::Point2d& p, const cv::Point2d& middle, double reach) {
    return std::abs(p.x - middle.x) < reach && std::abs(p.y - middle.y) < reach;
  };
  for (const cv::Rect2d& box : picture.ignored) {
    const cv::Point2d middle = where((box.tl() + box.br()) / 2);
    each_cell([&](std::size_t i, const cv::Point2d& p) {
      if (inside(p, middle, 0.7 * where.scale * box.width)) target[i] = kIgnore;
    });
  }
  for (const cv::Rect2d& box : picture.faces) {
    const cv::Point2d middle = where((box.tl() + box.br()) / 2);
    const double width = where.scale * box.width;
    if (width < kNearly[0] || width > kNearly[1]) continue;
    const bool fits = width >= kFits[0] && width <= kFits[1];
    each_cell([&](std::size_t i, const cv::Point2d& p) {
      if (fits && inside(p, middle, std::max(0.17 * width, 2.05))) {
        target[i] = 1;
        target[kPlane + i] = 1;
        target[2 * kPlane + i] = static_cast<float>((middle.x - p.x) / kScanFace);
        target[3 * kPlane + i] = static_cast<float>((middle.y - p.y) / kScanFace);
        target[4 * kPlane + i] = static_cast<float>(std::log(width / kScanFace));
      } else if (target[i] == 0 && inside(p, middle, 0.45 * width)) {
        target[i] = kIgnore;
      }
    });
  }
}

void make_scan_example(const Material& material, const std::vector<Mistake>& mistakes, Rng& rng,
                       FaceSearchWorkspace& workspace, nn::Example& example) {
  cv::Mat view;
  const double kind = rng.uniform();
  if (kind < 0.55) {
    const auto& [number, face] = material.all[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(material.all.size()) - 1))];
    const Picture& picture = material.faces[static_cast<std::size_t>(number)];
    const cv::Rect2d& box = picture.faces[static_cast<std::size_t>(face)];
    const double size = rng.uniform();
    const double width = size < 0.85   ? log_uniform(rng, kFits[0], kFits[1])
                         : size < 0.92 ? log_uniform(rng, 6, kNearly[0])
                                       : log_uniform(rng, kNearly[1], 64);
    const double x = rng.uniform(8, kPatch - 8);
    const double y = rng.uniform(8, kPatch - 8);
    const double turn = turn_of(rng);
    const bool mirrored = rng.uniform() < 0.5;
    const Place where = place((box.tl() + box.br()) / 2, {x, y}, width / box.width, turn, mirrored);
    view = view_of(picture, where, kPatch);
    if (rng.uniform() < 0.2) hide_part(view, {x - width / 2, y - width / 2, width, width}, rng);
    label_scan(picture, where, example.target);
  } else {
    Place where;
    const Picture* picture = nullptr;
    if (kind < 0.8 && !mistakes.empty()) {
      const Mistake& mistake =
          mistakes[static_cast<std::size_t>(rng.integer(0, static_cast<int>(mistakes.size()) - 1))];
      picture = &material.picture(mistake.picture);
      const double width = log_uniform(rng, 14, 23);
      const double x = rng.uniform(16, kPatch - 16);
      const double y = rng.uniform(16, kPatch - 16);
      const bool mirrored = rng.uniform() < 0.5;
      where = place((mistake.box.tl() + mistake.box.br()) / 2, {x, y}, width / mistake.box.width,
                    rng.normal(0, 0.08), mirrored);
    } else {
      const auto number =
          static_cast<std::size_t>(rng.integer(0, static_cast<int>(material.without.size()) - 1));
      picture = &material.without[number];
      where = anywhere(*picture, kPatch, 0.08, rng);
    }
    view = view_of(*picture, where, kPatch);
    label_scan(*picture, where, example.target);
  }
  disturb(view, rng);
  example.shape = {4, kPatch / 2, kPatch / 2};
  scan_input(view, workspace, example.input);
}

double logistic_loss(float logit, float label, float& derivative) {
  const double p = logistic(static_cast<double>(logit));
  derivative = static_cast<float>(p - static_cast<double>(label));
  return label > 0.5F ? -std::log(std::max(p, 1e-9)) : -std::log(std::max(1 - p, 1e-9));
}

// Huber's loss with its corner at `knee`.
double huber(float error, float knee, float& derivative) {
  const float size = std::abs(error);
  derivative = std::clamp(error / knee, -1.0F, 1.0F);
  return static_cast<double>(size < knee ? error * error / (2 * knee) : size - knee / 2);
}

double scan_loss(const nn::Example& example, const std::vector<float>& output, nn::Shape shape,
                 std::vector<float>& derivative) {
  const auto plane = static_cast<std::size_t>(shape.height) * static_cast<std::size_t>(shape.width);
  double loss = 0;
  int positives = 0;
  for (std::size_t i = 0; i < plane; ++i) positives += example.target[i] > 0.5F ? 1 : 0;
  const float share = 1.0F / static_cast<float>(std::max(1, positives));
  for (std::size_t i = 0; i < plane; ++i) {
    const float label = example.target[i];
    if (label == kIgnore) continue;
    float slope = 0;
    const double raw = logistic_loss(output[i], label, slope);
    if (label > 0.5F) {
      loss += raw * static_cast<double>(share);
      derivative[i] = slope * share;
    } else {
      // The focal weight p^2 (Lin and others, ICCV 2017) taken as constant in the derivative.
      const float weight = slope * slope * 1.2F;
      loss += raw * static_cast<double>(weight);
      derivative[i] = slope * weight;
    }
    if (example.target[plane + i] > 0) {
      for (std::size_t k = 1; k < 4; ++k) {
        float d = 0;
        loss += static_cast<double>(share) *
                huber(output[k * plane + i] - example.target[(1 + k) * plane + i], 0.1F, d);
        derivative[k * plane + i] = share * d;
      }
    }
  }
  return loss;
}

// --- what the others learn from ---

void make_window_example(const Material& material, const std::vector<Mistake>& mistakes,
                         FaceWindow form, Rng& rng, nn::Example& example) {
  // Target: label, is the box known, dx, dy, log of the growth.
  example.target.assign(kScanPlanes, 0.0F);
  const double middle = form.side / 2.0;
  cv::Mat view;
  const double kind = rng.uniform();
  if (kind < 0.55) {
    const auto& [number, face] = material.all[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(material.all.size()) - 1))];
    const Picture& picture = material.faces[static_cast<std::size_t>(number)];
    const cv::Rect2d& box = picture.faces[static_cast<std::size_t>(face)];
    // The box is off by (dx, dy) widths of the face and `growth` too large.
    double dx = rng.uniform(-0.17, 0.17);
    double dy = rng.uniform(-0.17, 0.17);
    double growth = log_uniform(rng, 0.78, 1.28);
    const bool is_near = kind >= 0.45;
    double turn = turn_of(rng);
    if (is_near) {  // too far off to pass, or not upright
      const double how = rng.uniform();
      if (how < 0.2) {
        const double quarters = rng.integer(1, 3);
        turn += quarters * CV_PI / 2;
      } else if (how < 0.7) {
        const double angle = rng.uniform(0, 2 * CV_PI);
        const double far = rng.uniform(0.42, 0.95);
        dx = far * std::cos(angle);
        dy = far * std::sin(angle);
      } else {
        growth = rng.uniform() < 0.5 ? log_uniform(rng, 0.38, 0.6) : log_uniform(rng, 1.65, 2.7);
      }
    }
    const bool mirrored = rng.uniform() < 0.5;
    const double width = form.box / growth;
    const cv::Point2d to(middle - dx * width, middle - dy * width);
    const Place where = place((box.tl() + box.br()) / 2, to, width / box.width, turn, mirrored);
    view = view_of(picture, where, form.side);
    if (!is_near) {
      if (rng.uniform() < 0.25) {
        hide_part(view, {to.x - width / 2, to.y - width / 2, width, width}, rng);
      }
      example.target = {1, 1, static_cast<float>((to.x - middle) / form.box),
                        static_cast<float>((to.y - middle) / form.box),
                        static_cast<float>(std::log(width / form.box))};
    }
  } else if (kind < 0.93 && !mistakes.empty()) {
    const Mistake& mistake =
        mistakes[static_cast<std::size_t>(rng.integer(0, static_cast<int>(mistakes.size()) - 1))];
    const double dx = rng.normal(0, 0.06);
    const double dy = rng.normal(0, 0.06);
    const double growth = std::exp(rng.normal(0, 0.08));
    const bool mirrored = rng.uniform() < 0.5;
    const Place where = place((mistake.box.tl() + mistake.box.br()) / 2,
                              {middle + dx * form.box, middle + dy * form.box},
                              form.box / mistake.box.width * growth, rng.normal(0, 0.08), mirrored);
    view = view_of(material.picture(mistake.picture), where, form.side);
  } else {
    const Picture& picture = material.without[static_cast<std::size_t>(
        rng.integer(0, static_cast<int>(material.without.size()) - 1))];
    view = view_of(picture, anywhere(picture, form.side, 0.05, rng), form.side);
  }
  disturb(view, rng);
  example.shape = {4, form.side / 2, form.side / 2};
  window_input(view, example.input);
}

double window_loss(const nn::Example& example, const std::vector<float>& output, nn::Shape,
                   std::vector<float>& derivative) {
  double loss = logistic_loss(output[0], example.target[0], derivative[0]);
  if (example.target[1] < 0.5F) return loss;
  for (std::size_t k = 1; k < 4; ++k) {
    float d = 0;
    loss += huber(output[k] - example.target[1 + k], 0.06F, d);
    derivative[k] = d;
  }
  return loss;
}

// --- both ---

Material load(const std::vector<FacePicture>& pictures, Progress& progress,
              const std::stop_token& stop, std::vector<std::string>& skipped) {
  Material material;
  progress.begin("reading", static_cast<std::int64_t>(pictures.size()), "pictures");
  for (const FacePicture& from : pictures) {
    throw_if_stopped(stop);
    progress.advance();
    cv::Mat gray;
    try {
      gray = read_gray_image(from.image);
    } catch (const InputError& error) {
      skipped.emplace_back(error.what());
      continue;
    }
    double scale = std::min(1.0, kLargestSide / std::max(gray.cols, gray.rows));
    if (!from.faces.empty()) {
      double smallest = 1e9;
      for (const cv::Rect2d& face : from.faces) smallest = std::min(smallest, face.width);
      scale = std::min(1.0, kLargestFace / smallest);
    }
    const cv::Size size(std::max(8, cvRound(gray.cols * scale)),
                        std::max(8, cvRound(gray.rows * scale)));
    if (scale < 1) cv::resize(gray, gray, size, 0, 0, cv::INTER_AREA);
    Picture picture;
    const auto scaled = [&](const cv::Rect2d& box) {
      return cv::Rect2d(box.x * scale, box.y * scale, box.width * scale, box.height * scale);
    };
    for (const cv::Rect2d& box : from.faces) {
      if (box.width * scale >= kScanFace && box.width > 0) {
        picture.faces.push_back(scaled(box));
      } else {
        picture.ignored.push_back(scaled(box));
      }
    }
    for (const cv::Rect2d& box : from.ignored) picture.ignored.push_back(scaled(box));
    make_halves(gray, 0.05, picture.halves);
    if (from.faces.empty() && from.ignored.empty()) {
      material.without.push_back(std::move(picture));
    } else if (!picture.faces.empty()) {
      for (int f = 0; f < static_cast<int>(picture.faces.size()); ++f) {
        material.all.emplace_back(static_cast<int>(material.faces.size()), f);
      }
      material.faces.push_back(std::move(picture));
    }
  }
  progress.end();
  return material;
}

enum class Stage { kScan, kJudge, kCheck };

// Places that are taken for faces, up to the given network, and are none.
std::vector<Mistake> find_mistakes(const Material& material, const FaceNetworks& networks,
                                   Stage stage, double threshold, Progress& progress,
                                   const std::stop_token& stop) {
  const std::size_t count = material.without.size() + material.faces.size();
  std::vector<std::vector<Mistake>> found(count);
  progress.begin("looking for mistakes", static_cast<std::int64_t>(count), "pictures");
  cv::parallel_for_(cv::Range(0, static_cast<int>(count)), [&](const cv::Range& range) {
    FaceSearchWorkspace workspace;
    for (int i = range.start; i < range.end; ++i) {
      progress.advance();
      if (stop.stop_requested()) return;
      const Picture& picture = material.picture(i);
      FaceSearchOptions options;
      options.min_face = kScanFace;
      options.max_places = stage == Stage::kScan ? 150 : 600;
      options.threshold = threshold;
      options.checked = stage == Stage::kCheck;
      const std::vector<ScoredFace> places =
          stage == Stage::kScan ? scan_faces(picture.halves[0], networks, options, workspace)
                                : search_faces(picture.halves[0], networks, options, workspace);
      for (const ScoredFace& place : places) {
        if (place.score < threshold) continue;
        const auto is_near = [&](const cv::Rect2d& box) { return shared(box, place.box) > 0.25; };
        if (std::any_of(picture.faces.begin(), picture.faces.end(), is_near)) continue;
        if (std::any_of(picture.ignored.begin(), picture.ignored.end(), is_near)) continue;
        found[static_cast<std::size_t>(i)].push_back({i, place.box});
      }
    }
  });
  progress.end();
  throw_if_stopped(stop);
  std::vector<Mistake> all;
  for (const auto& part : found) all.insert(all.end(), part.begin(), part.end());
  return all;
}

// Faces that nobody drew a box around: what the second network firmly holds for a face in a picture
// that shows some. They become ignored.
void ignore_missing_boxes(Material& material, const FaceNetworks& networks, Progress& progress,
                          const std::stop_token& stop) {
  const auto first = static_cast<int>(material.without.size());
  for (const Mistake& mistake :
       find_mistakes(material, networks, Stage::kJudge, 0.9, progress, stop)) {
    if (mistake.picture < first) continue;
    material.faces[static_cast<std::size_t>(mistake.picture - first)].ignored.push_back(
        mistake.box);
  }
}

// Those in ignored places go.
void forget_ignored(const Material& material, std::vector<Mistake>& mistakes) {
  std::erase_if(mistakes, [&](const Mistake& mistake) {
    const std::vector<cv::Rect2d>& ignored = material.picture(mistake.picture).ignored;
    return std::any_of(ignored.begin(), ignored.end(),
                       [&](const cv::Rect2d& box) { return shared(box, mistake.box) > 0.25; });
  });
}

// The hard ones are as often seen as all others together.
void add_hard(const std::vector<Mistake>& hard, std::vector<Mistake>& mistakes) {
  if (hard.empty()) return;
  const std::size_t times = std::clamp<std::size_t>(mistakes.size() / hard.size(), 1, 20);
  for (std::size_t k = 0; k < times; ++k) {
    mistakes.insert(mistakes.end(), hard.begin(), hard.end());
  }
}

template <typename Make>
void run_training(nn::Network& network, int steps, double rate, std::uint64_t seed,
                  const char* stage, const Make& make, const nn::Loss& loss, Progress& progress,
                  const std::stop_token& stop) {
  nn::TrainOptions options;
  options.steps = steps;
  options.batch = 32;
  options.rate = rate;
  options.seed = seed;
  progress.begin(stage, steps, "batches");
  int done = 0;
  nn::train(
      network, options, make, loss,
      [&](int step, double mean) {
        progress.advance(step - done);
        done = step;
        log_debug("{}: step {}, loss {:.4f}", stage, step, mean);
      },
      stop);
  progress.end();
}

}  // namespace

void FaceTrainingOptions::check() const {
  TARSIER_REQUIRE(scan_steps >= 2 && scan_steps <= 1'000'000, "{} steps", scan_steps);
  TARSIER_REQUIRE(judge_steps >= 2 && judge_steps <= 1'000'000, "{} steps", judge_steps);
  TARSIER_REQUIRE(check_steps >= 2 && check_steps <= 1'000'000, "{} steps", check_steps);
}

FaceTraining train_face_networks(const std::vector<FacePicture>& pictures, const std::string& name,
                                 const FaceTrainingOptions& options, Progress& progress,
                                 std::stop_token stop) {
  options.check();
  FaceTraining result;
  Material material = load(pictures, progress, stop, result.skipped);
  if (material.all.empty()) throw InputError(name, "no face is left to learn from");
  if (material.without.empty()) {
    throw InputError(name, "no picture without faces: without them everything is a face");
  }
  result.pictures = static_cast<int>(material.faces.size());
  result.faces = static_cast<int>(material.all.size());
  result.without = static_cast<int>(material.without.size());

  FaceNetworks& networks = result.networks;
  const Rng root(options.seed);
  Rng first = root.fork(1);
  nn::initialize(networks.scan, first);
  nn::initialize(networks.judge, first);
  nn::initialize(networks.check, first);
  std::vector<Mistake> mistakes;
  const auto make_scan = [&](std::int64_t, Rng& rng, nn::Example& example) {
    thread_local FaceSearchWorkspace workspace;
    make_scan_example(material, mistakes, rng, workspace, example);
  };
  const auto train_scan = [&](int steps, double rate, std::uint64_t number) {
    run_training(networks.scan, steps, rate, options.seed * 8 + number, "first network", make_scan,
                 scan_loss, progress, stop);
  };
  const auto train_window = [&](nn::Network& network, FaceWindow form, const char* stage, int steps,
                                double rate, std::uint64_t number) {
    run_training(
        network, steps, rate, options.seed * 8 + number, stage,
        [&](std::int64_t, Rng& rng, nn::Example& example) {
          make_window_example(material, mistakes, form, rng, example);
        },
        window_loss, progress, stop);
  };
  const auto mistakes_of = [&](Stage stage, double threshold) {
    return find_mistakes(material, networks, stage, threshold, progress, stop);
  };

  train_scan(options.scan_steps / 2, 3e-3, 0);
  mistakes = mistakes_of(Stage::kScan, 0.3);
  result.scan_mistakes = static_cast<int>(mistakes.size());
  train_scan(options.scan_steps - options.scan_steps / 2, 2e-3, 1);

  mistakes = mistakes_of(Stage::kScan, 0.1);
  train_window(networks.judge, kJudgeWindow, "second network", options.judge_steps / 2, 2e-3, 2);
  ignore_missing_boxes(material, networks, progress, stop);
  forget_ignored(material, mistakes);
  std::vector<Mistake> hard = mistakes_of(Stage::kJudge, 0.2);
  result.judge_mistakes = static_cast<int>(hard.size());
  add_hard(hard, mistakes);
  train_window(networks.judge, kJudgeWindow, "second network",
               options.judge_steps - options.judge_steps / 2, 1.5e-3, 3);

  // The third sees what passed the second before and after its second half.
  mistakes = mistakes_of(Stage::kJudge, 0.1);
  mistakes.insert(mistakes.end(), hard.begin(), hard.end());
  train_window(networks.check, kCheckWindow, "third network", options.check_steps / 2, 2e-3, 4);
  hard = mistakes_of(Stage::kCheck, 0.1);
  result.check_mistakes = static_cast<int>(hard.size());
  add_hard(hard, mistakes);
  train_window(networks.check, kCheckWindow, "third network",
               options.check_steps - options.check_steps / 2, 1.5e-3, 5);
  return result;
}

}  // namespace tarsier
