// SPDX-License-Identifier: MIT
#include "tarsier/landmarks/face_finder.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/io/archive.h"
#include "tarsier/landmarks/hog_detector.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::landmarks {

namespace {

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double overlap(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common / std::max(1.0, a.area() + b.area() - common);
}

}  // namespace

void BoxModel::check() const {
  TARSIER_REQUIRE(std::isfinite(dx) && std::abs(dx) <= 2, "dx {}", dx);
  TARSIER_REQUIRE(std::isfinite(dy) && std::abs(dy) <= 2, "dy {}", dy);
  TARSIER_REQUIRE(size >= 0.02 && size <= 5, "size {}", size);
}

BoxModel train_box_model(const std::vector<Eigen::Matrix2Xd>& shapes,
                         const std::vector<cv::Rect2d>& boxes, double fraction) {
  TARSIER_REQUIRE(shapes.size() == boxes.size(), "{} shapes, {} boxes", shapes.size(),
                  boxes.size());
  TARSIER_REQUIRE(fraction >= 0 && fraction <= 1, "fraction {}", fraction);
  std::vector<double> dx;
  std::vector<double> dy;
  std::vector<double> size;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    const cv::Rect2d& box = boxes[i];
    if (box.width <= 0 || box.height <= 0) continue;
    Eigen::Index inside = 0;
    for (Eigen::Index p = 0; p < shapes[i].cols(); ++p) {
      if (box.contains(cv::Point2d(shapes[i](0, p), shapes[i](1, p)))) ++inside;
    }
    if (static_cast<double>(inside) < fraction * static_cast<double>(shapes[i].cols())) continue;
    const Eigen::Vector2d center = shapes[i].rowwise().mean();
    dx.push_back((center.x() - (box.x + 0.5 * box.width - 0.5)) / box.width);
    dy.push_back((center.y() - (box.y + 0.5 * box.height - 0.5)) / box.width);
    size.push_back(shape_size(shapes[i]) / box.width);
  }
  TARSIER_REQUIRE(!dx.empty(), "of {} boxes none holds {} of its face's points", boxes.size(),
                  fraction);
  BoxModel model;
  model.dx = median(dx);
  model.dy = median(dy);
  model.size = median(size);
  model.trained_on = static_cast<int>(dx.size());
  return model;
}

Eigen::Matrix2Xd start_in_box(const BoxModel& model, const Eigen::Matrix2Xd& mean,
                              const cv::Rect2d& box) {
  const Eigen::Vector2d center(box.x + 0.5 * box.width - 0.5 + model.dx * box.width,
                               box.y + 0.5 * box.height - 0.5 + model.dy * box.width);
  return (mean * (model.size * box.width)).colwise() + center;
}

cv::Rect2d box_around(const BoxModel& model, const Eigen::Matrix2Xd& points) {
  const double width = shape_size(points) / model.size;
  const Eigen::Vector2d center = points.rowwise().mean();
  return {center.x() - model.dx * width - 0.5 * width + 0.5,
          center.y() - model.dy * width - 0.5 * width + 0.5, width, width};
}

struct FaceFinder::Impl {
  FaceFinderOptions options;
  std::optional<FaceDetector> strict;  // or
  std::optional<HogFinder> trained;
  // Made when they are first needed; nothing where the file is missing.
  std::vector<std::optional<FaceDetector>> others;
  bool tried = false;
  cv::Mat flipped;
  std::optional<BoxModel> box;

  void load();
  [[nodiscard]] std::vector<Candidate> find_trained(const cv::Mat& gray, double below);
};

namespace {

// How far under its threshold a trained detector is still asked, margins of the training.
constexpr double kBelow = 0.5;

FaceDetectorOptions less_strict(FaceDetectorOptions options) {
  options.neighbors = std::max(1, options.neighbors - 1);
  options.step = 1.05;
  return options;
}

std::optional<FaceDetector> detector_if_there(const FaceDetectorOptions& options) {
  if (find_cascade(options.cascade).empty()) return std::nullopt;
  return FaceDetector(options);
}

}  // namespace

void FaceFinder::Impl::load() {
  if (tried) return;
  tried = true;
  FaceDetectorOptions loose = less_strict(options.detector);
  others.push_back(detector_if_there(loose));
  loose.cascade = "haarcascade_frontalface_default.xml";
  loose.neighbors = options.detector.neighbors;
  others.push_back(detector_if_there(loose));
  loose.cascade = "haarcascade_profileface.xml";
  others.push_back(detector_if_there(loose));
}

FaceFinder::FaceFinder(const FaceFinderOptions& options) : impl_(std::make_unique<Impl>()) {
  impl_->options = options;
  impl_->strict.emplace(options.detector);
}
FaceFinder::FaceFinder(const HogDetector& detector, const FaceFinderOptions& options)
    : impl_(std::make_unique<Impl>()) {
  options.detector.check();
  impl_->options = options;
  impl_->trained.emplace(detector);
  impl_->box = detector.box;
}
FaceFinder::~FaceFinder() = default;
FaceFinder::FaceFinder(FaceFinder&&) noexcept = default;
FaceFinder& FaceFinder::operator=(FaceFinder&&) noexcept = default;

const std::optional<BoxModel>& FaceFinder::box_model() const { return impl_->box; }

std::vector<Candidate> FaceFinder::Impl::find_trained(const cv::Mat& gray, double below) {
  const double least = std::max(1.0, options.detector.min_size * std::min(gray.cols, gray.rows));
  std::vector<Candidate> found;
  for (const ScoredBox& scored : trained->find(gray, least, below)) {
    found.push_back({scored.box, scored.score >= 0});
  }
  std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) {
    return a.box.area() > b.box.area();
  });
  return found;
}

std::vector<Candidate> FaceFinder::find_sure(const cv::Mat& gray) {
  require_gray(gray);
  if (impl_->trained) return impl_->find_trained(gray, 0);
  std::vector<Candidate> found;
  for (const cv::Rect& box : impl_->strict->detect(gray)) {
    found.push_back({cv::Rect2d(box.x, box.y, box.width, box.height), true});
  }
  return found;
}

std::vector<Candidate> FaceFinder::find(const cv::Mat& gray) {
  std::vector<Candidate> found = find_sure(gray);
  if (!found.empty() || !impl_->options.thorough) return found;
  if (impl_->trained) return impl_->find_trained(gray, kBelow);
  impl_->load();
  const auto add = [&](const cv::Rect2d& box) {
    for (const Candidate& known : found) {
      if (overlap(known.box, box) > 0.6) return;
    }
    found.push_back({box, false});
  };
  for (std::size_t k = 0; k < impl_->others.size(); ++k) {
    if (!impl_->others[k]) continue;
    const bool profile = k + 1 == impl_->others.size();
    for (const cv::Rect& box : impl_->others[k]->detect(gray)) add(box);
    if (!profile) continue;
    cv::flip(gray, impl_->flipped, 1);
    for (const cv::Rect& box : impl_->others[k]->detect(impl_->flipped)) {
      add(cv::Rect2d(gray.cols - box.x - box.width, box.y, box.width, box.height));
    }
  }
  std::stable_sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) {
    return a.box.area() > b.box.area();
  });
  return found;
}

nlohmann::json to_json(const BoxModel& model) {
  return {
      {"dx", model.dx}, {"dy", model.dy}, {"size", model.size}, {"trained_on", model.trained_on}};
}

BoxModel box_model_from_json(const nlohmann::json& value, const std::string& path) {
  BoxModel model;
  model.dx = number_member(value, "dx", path, -2, 2);
  model.dy = number_member(value, "dy", path, -2, 2);
  model.size = number_member(value, "size", path, 0.02, 5);
  model.trained_on = static_cast<int>(integer_member(value, "trained_on", path, 0, 1 << 30));
  return model;
}

}  // namespace tarsier::landmarks
