// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/hog_detector.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/landmarks/hog_scanner.h"
#include "tarsier/linalg/model_fields.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::face::landmarks {

namespace {

constexpr const char* kHogDetectorType = "face-detector";
constexpr int kHogDetectorVersion = 1;
constexpr int kMinWindow = 16;
constexpr int kMaxWindow = 400;
constexpr double kMaxEnlarged = 4;
constexpr double kMaxPixels = 2e6;
constexpr std::size_t kMaxCandidates = 4000;
constexpr std::size_t kMaxDetections = 200;

}  // namespace

cv::Size HogDetector::cells() const {
  inner::HogScanner scanner;
  scanner.configure(*this);
  return {static_cast<int>(scanner.get_fhog_window_width()),
          static_cast<int>(scanner.get_fhog_window_height())};
}

void HogDetector::check() const {
  for (const int side : {width, height}) {
    TARSIER_REQUIRE(side >= kMinWindow && side <= kMaxWindow, "a window of {}x{} px", width,
                    height);
  }
  TARSIER_REQUIRE(cell >= 4 && cell <= 16, "cells of {} px", cell);
  TARSIER_REQUIRE(padding >= 0 && padding <= 8, "padding of {} cells", padding);
  const cv::Size size = cells();
  TARSIER_REQUIRE(weights.rows() == kHogPlanes && weights.cols() == size.area(),
                  "{} x {} weights for {} x {} cells", weights.rows(), weights.cols(), size.width,
                  size.height);
  TARSIER_REQUIRE(weights.allFinite() && std::isfinite(threshold), "weights that are not finite");
  TARSIER_REQUIRE(overlap >= 0 && overlap <= 1 && covered >= 0 && covered <= 1, "overlap {}, {}",
                  overlap, covered);
  if (box) box->check();
}

struct HogFinder::Impl {
  HogDetector model;
  inner::HogScanner scanner;
  inner::HogScanner::fhog_filterbank filters;
  dlib::test_box_overlap overlaps;
  cv::Mat resized;

  explicit Impl(const HogDetector& detector)
      : model(detector), overlaps(detector.overlap, detector.covered) {
    model.check();
    scanner.configure(model);
    dlib::matrix<double, 0, 1> weights(static_cast<long>(model.weights.size()));
    long at = 0;
    for (Eigen::Index plane = 0; plane < model.weights.rows(); ++plane) {
      for (Eigen::Index k = 0; k < model.weights.cols(); ++k) {
        weights(at++) = static_cast<double>(model.weights(plane, k));
      }
    }
    filters = scanner.build_fhog_filterbank(weights);
  }

  // Best first. Bounds the work even if a model's threshold is very low.
  std::vector<std::pair<double, dlib::rectangle>> detect(double margin) {
    scanner.load(resized);
    std::vector<std::pair<double, dlib::rectangle>> candidates;
    scanner.detect(filters, candidates, model.threshold - margin);
    candidates.resize(std::min(candidates.size(), kMaxCandidates));
    std::vector<std::pair<double, dlib::rectangle>> kept;
    for (const auto& candidate : candidates) {
      const bool is_suppressed = std::any_of(kept.begin(), kept.end(), [&](const auto& better) {
        return overlaps(better.second, candidate.second);
      });
      if (!is_suppressed && kept.size() < kMaxDetections) kept.push_back(candidate);
    }
    return kept;
  }
};

HogFinder::HogFinder(const HogDetector& detector) : impl_(std::make_unique<Impl>(detector)) {}
HogFinder::~HogFinder() = default;
HogFinder::HogFinder(HogFinder&&) noexcept = default;
HogFinder& HogFinder::operator=(HogFinder&&) noexcept = default;

const HogDetector& HogFinder::detector() const { return impl_->model; }

std::vector<ScoredBox> HogFinder::find(const cv::Mat& gray, double min_size, double margin) {
  require_gray(gray);
  TARSIER_REQUIRE(min_size > 0 && std::isfinite(min_size) && margin >= 0 && std::isfinite(margin),
                  "least {} px, {} below", min_size, margin);
  Impl& my = *impl_;
  const double window = std::sqrt(static_cast<double>(my.model.width) * my.model.height);
  const double pixels = static_cast<double>(gray.cols) * gray.rows;
  const double scale =
      std::min({window / min_size, kMaxEnlarged, std::max(0.01, std::sqrt(kMaxPixels / pixels))});
  const cv::Size size(std::max(1, cvRound(gray.cols * scale)),
                      std::max(1, cvRound(gray.rows * scale)));
  std::vector<ScoredBox> found;
  if (size.width < my.model.width / 2 || size.height < my.model.height / 2) return found;
  cv::resize(gray, my.resized, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const double sx = static_cast<double>(gray.cols) / size.width;
  const double sy = static_cast<double>(gray.rows) / size.height;
  for (const auto& [score, rectangle] : my.detect(margin)) {
    const cv::Rect2d box = inner::from_dlib(rectangle);
    found.push_back(
        {{box.x * sx, box.y * sy, box.width * sx, box.height * sy}, score - my.model.threshold});
  }
  return found;
}

namespace {

void list_hog_detector(linalg::ModelFields& file, HogDetector& model) {
  file.whole("width", model.width, kMinWindow, kMaxWindow);
  file.whole("height", model.height, kMinWindow, kMaxWindow);
  file.whole("cell", model.cell, 4, 16);
  file.whole("padding", model.padding, 0, 8);
  file.matrix("weights", model.weights, kHogPlanes, model.cells().area());
  file.number("threshold", model.threshold, -1e6, 1e6);
  file.number("overlap", model.overlap, 0, 1);
  file.number("covered", model.covered, 0, 1);
  file.optional("box", model.box, box_model_from_json);
}

}  // namespace

void write_hog_detector(const std::string& path, const HogDetector& detector,
                        const nlohmann::json& provenance) {
  detector.check();
  write_archive(path, {kHogDetectorType, kHogDetectorVersion, provenance,
                       linalg::written(detector, list_hog_detector)});
}

HogDetector read_hog_detector(const std::string& path) {
  return linalg::read_fields<HogDetector>(
      read_archive(path, kHogDetectorType, kHogDetectorVersion).payload, path, list_hog_detector);
}

cv::Mat draw_hog_detector(const HogDetector& detector, int zoom) {
  detector.check();
  TARSIER_REQUIRE(zoom >= 4 && zoom <= 200, "zoom {}", zoom);
  constexpr int kDirections = 9;
  const cv::Size cells = detector.cells();
  // Of the 31 planes, 18 are signed directions and the next 9 unsigned ones. The weight of a
  // direction is the sum of its three planes.
  const auto weight = [&](int cell, int direction) {
    return detector.weights(direction, cell) + detector.weights(direction + kDirections, cell) +
           detector.weights(direction + 2 * kDirections, cell);
  };
  float max_weight = 1e-9F;
  for (int c = 0; c < cells.area(); ++c) {
    for (int d = 0; d < kDirections; ++d) max_weight = std::max(max_weight, std::abs(weight(c, d)));
  }
  const cv::Size half(cells.width * zoom, cells.height * zoom);
  cv::Mat sheet(half.height, 2 * half.width + zoom / 2, CV_8UC3, cv::Scalar(48, 40, 36));
  for (const int sign : {1, -1}) {
    cv::Mat sum(half, CV_32FC1, cv::Scalar(0));
    for (int c = 0; c < cells.area(); ++c) {
      const cv::Point2d center((c % cells.width + 0.5) * zoom, (c / cells.width + 0.5) * zoom);
      for (int d = 0; d < kDirections; ++d) {
        const double value = sign * static_cast<double>(weight(c, d) / max_weight);
        if (value <= 0.02) continue;
        // An edge is perpendicular to its gradient.
        const double angle = CV_PI * d / kDirections + CV_PI / 2;
        const cv::Point2d reach(0.45 * zoom * std::cos(angle), 0.45 * zoom * std::sin(angle));
        cv::Mat stroke(half, CV_8UC1, cv::Scalar(0));
        const cv::Rect area = cv::Rect(static_cast<int>(center.x) - zoom,
                                       static_cast<int>(center.y) - zoom, 2 * zoom, 2 * zoom) &
                              cv::Rect({0, 0}, half);
        cv::line(stroke, cv::Point(center - reach), cv::Point(center + reach), cv::Scalar(255),
                 std::max(1, zoom / 12), cv::LINE_AA);
        cv::Mat part;
        stroke(area).convertTo(part, CV_32F, value / 255);
        sum(area) += part;
      }
    }
    cv::Mat gray;
    cv::Mat(cv::min(sum, 1.0)).convertTo(gray, CV_8UC1, 255);
    const int left = sign > 0 ? 0 : half.width + zoom / 2;
    cv::Mat to = sheet(cv::Rect(cv::Point(left, 0), half));
    cv::cvtColor(gray, to, cv::COLOR_GRAY2BGR);
  }
  return sheet;
}

}  // namespace tarsier::face::landmarks
