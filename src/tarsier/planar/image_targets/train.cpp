// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/train.h"

#include "tarsier/core/image.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/planar/image_targets/quality.h"
#include "tarsier/planar/image_targets/trials.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier::planar::image_targets {
namespace {

struct View {
  cv::Mat gray;
  cv::Matx23d from_image;  // affine, px of the view
};

// The image viewed from a distance, tilted by acos(1 / tilt) about an axis at `azimuth`.
View tilted_view(const cv::Mat& gray, double tilt, double azimuth) {
  View view;
  if (tilt == 1) {
    view.gray = gray;
    view.from_image = {1, 0, 0, 0, 1, 0};
    return view;
  }
  const double c = std::cos(azimuth);
  const double s = std::sin(azimuth);
  const double w = gray.cols;
  const double h = gray.rows;
  const auto turned_w = static_cast<int>(std::ceil(std::abs(c) * w + std::abs(s) * h));
  const auto turned_h = static_cast<int>(std::ceil(std::abs(s) * w + std::abs(c) * h));
  const cv::Matx23d turn{c,  s, turned_w / 2.0 - 0.5 - c * (w / 2 - 0.5) - s * (h / 2 - 0.5),
                         -s, c, turned_h / 2.0 - 0.5 + s * (w / 2 - 0.5) - c * (h / 2 - 0.5)};
  cv::Mat turned;
  cv::warpAffine(gray, turned, turn, cv::Size(turned_w, turned_h), cv::INTER_LINEAR,
                 cv::BORDER_REPLICATE);
  cv::GaussianBlur(turned, turned, cv::Size(1, 0), 0, 0.8 * std::sqrt(tilt * tilt - 1),
                   cv::BORDER_REPLICATE);
  const int rows = std::max(8, static_cast<int>(std::lround(turned_h / tilt)));
  cv::resize(turned, view.gray, cv::Size(turned_w, rows), 0, 0, cv::INTER_LINEAR);
  const double squeeze = static_cast<double>(rows) / turned_h;
  view.from_image = {turn(0, 0),           turn(0, 1),
                     turn(0, 2),           squeeze * turn(1, 0),
                     squeeze * turn(1, 1), squeeze * (turn(1, 2) + 0.5) - 0.5};
  return view;
}

void add_view(Target& target, double tilt, double azimuth, int max_features) {
  const View view = tilted_view(target.gray, tilt, azimuth);
  FeatureOptions options;
  options.max_features = max_features;
  options.contrast = 10;
  const FeatureSet set = find_features(make_pyramid(view.gray, true, 20), options);
  const cv::Matx22d a(view.from_image(0, 0), view.from_image(0, 1), view.from_image(1, 0),
                      view.from_image(1, 1));
  const cv::Matx22d back = a.inv();
  for (std::size_t i = 0; i < set.features.size(); ++i) {
    const Feature& f = set.features[i];
    const cv::Vec2d p =
        back * cv::Vec2d(f.at.x - view.from_image(0, 2), f.at.y - view.from_image(1, 2));
    const double c = f.scale * std::cos(f.angle);
    const double s = f.scale * std::sin(f.angle);
    const cv::Matx22d frame = back * cv::Matx22d(c, -s, s, c);
    // Features at the edge consist mostly of the surroundings of the print.
    const double reach_x = 5 * std::hypot(frame(0, 0), frame(0, 1));
    const double reach_y = 5 * std::hypot(frame(1, 0), frame(1, 1));
    if (p[0] < reach_x || p[1] < reach_y || p[0] > target.gray.cols - 1 - reach_x ||
        p[1] > target.gray.rows - 1 - reach_y) {
      continue;
    }
    target.features.push_back(
        {{static_cast<float>(p[0]), static_cast<float>(p[1])}, cv::Matx22f(frame), 0});
    target.descriptors.push_back(set.descriptors[i]);
  }
}

cv::Mat working_image(const cv::Mat& image, int longer_side) {
  const cv::Mat gray = gray_of(image);
  const int longer = std::max(gray.cols, gray.rows);
  if (longer > longer_side) {
    const double scale = static_cast<double>(longer_side) / longer;
    cv::Mat small;
    cv::resize(gray, small,
               cv::Size(std::max(8, static_cast<int>(std::lround(gray.cols * scale))),
                        std::max(8, static_cast<int>(std::lround(gray.rows * scale)))),
               0, 0, cv::INTER_AREA);
    return small;
  }
  return gray.clone();
}

}  // namespace

Target train_target(const cv::Mat& image, const std::string& name, const TrainOptions& options,
                    const std::stop_token& stop) {
  options.check();
  if (image.type() == CV_8UC3)
    require_bgr(image);
  else
    require_gray(image);
  TARSIER_REQUIRE(std::min(image.cols, image.rows) >= 32 &&
                      std::min(image.cols, image.rows) * 8 >= std::max(image.cols, image.rows),
                  "{}x{}: sides of at least 32 px, none more than 8 times the other", image.cols,
                  image.rows);
  Target target;
  target.name = name;
  target.width = options.width;
  target.height = options.width * image.rows / image.cols;
  target.original_size = image.size();
  target.gray = working_image(image, options.longer_side);
  add_view(target, 1, 0, options.frontal_features);
  if (options.tilted_features >= 10) {
    for (int k = 0; k < 4; ++k)
      add_view(target, 1.5, k * std::numbers::pi / 4, options.tilted_features);
    for (int k = 0; k < 6; ++k)
      add_view(target, 2.1, k * std::numbers::pi / 6, options.tilted_features * 3 / 4);
  }
  compute_derived_members(target);
  if (options.trials > 0) {
    const TrialResult result = run_trials(target, options.trials, options.seed, stop);
    keep_best_features(target, result, static_cast<std::size_t>(options.max_features));
    compute_derived_members(target);
  }
  // Uses other views than those that selected the features.
  target.quality = rate_target(target, options.trials, options.seed + 1, stop);
  return target;
}

}  // namespace tarsier::planar::image_targets
