// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/detector.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/require.h"
#include "tarsier/face/detect/cascade.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::face {
namespace {

cv::Rect blended(const cv::Rect& old, const cv::Rect& seen, double share) {
  const auto mix = [&](int a, int b) { return cvRound(a + share * (b - a)); };
  return {mix(old.x, seen.x), mix(old.y, seen.y), mix(old.width, seen.width),
          mix(old.height, seen.height)};
}

}  // namespace

double default_min_face(cv::Size image) {
  constexpr double kSmallImage = 0.5e6;  // px
  return static_cast<double>(image.width) * image.height > kSmallImage ? 40 : 24;
}

void FaceDetectorOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_face == 0 || (min_face >= 16 && min_face <= 8192),
                  "the smallest face is of 16..8192 px, got {}", min_face);
  TARSIER_REQUIRE(max_width == 0 || (max_width >= 80 && max_width <= 4096),
                  "working width is 80..4096 px, got {}", max_width);
}

struct FaceDetector::Impl {
  explicit Impl(const FaceDetectorOptions& given) : options(given), cascade(given.cascade) {}

  FaceDetectorOptions options;
  Cascade cascade;
  cv::Mat gray;
  cv::Mat small;
  std::int64_t pixels = 0;
};

FaceDetector::FaceDetector(const FaceDetectorOptions& options)
    : impl_((options.check(), std::make_unique<Impl>(options))) {}

FaceDetector::~FaceDetector() = default;
FaceDetector::FaceDetector(FaceDetector&&) noexcept = default;
FaceDetector& FaceDetector::operator=(FaceDetector&&) noexcept = default;

std::int64_t FaceDetector::pixels() const { return impl_->pixels; }

std::vector<cv::Rect> FaceDetector::detect(const cv::Mat& frame) {
  const FaceDetectorOptions& options = impl_->options;
  return detect(frame, options.min_face > 0 ? options.min_face : default_min_face(frame.size()), 0);
}

std::vector<cv::Rect> FaceDetector::detect(const cv::Mat& frame, double min_face, double max_face) {
  TARSIER_REQUIRE(!frame.empty() && frame.depth() == CV_8U, "got {}x{}", frame.cols, frame.rows);
  TARSIER_REQUIRE(min_face > 0 && max_face >= 0, "faces of {} to {} px", min_face, max_face);
  Impl& my = *impl_;
  double scale = kCascadeWindow / min_face;
  if (my.options.max_width > 0) {
    scale = std::min({1.0, scale, static_cast<double>(my.options.max_width) / frame.cols});
  }
  const cv::Size size(std::max(1, cvRound(frame.cols * scale)),
                      std::max(1, cvRound(frame.rows * scale)));
  cv::resize(frame, my.small, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  if (my.small.channels() == 3) {
    cv::cvtColor(my.small, my.gray, cv::COLOR_BGR2GRAY);
  } else {
    my.small.copyTo(my.gray);
  }
  cv::equalizeHist(my.gray, my.gray);
  const int smallest = std::max(kCascadeWindow, cvRound(min_face * scale));
  const int largest = max_face > 0 ? cvRound(max_face * scale) : 0;
  my.pixels += size.area();
  std::vector<cv::Rect> faces;
  if (std::min(size.width, size.height) >= smallest && (largest == 0 || largest >= smallest)) {
    faces = my.cascade.detect(my.gray, {.step = my.options.step,
                                        .neighbors = my.options.neighbors,
                                        .min = cv::Size(smallest, smallest),
                                        .max = cv::Size(largest, largest)});
  }
  for (cv::Rect& face : faces) {
    face = cv::Rect(cvRound(face.x / scale), cvRound(face.y / scale), cvRound(face.width / scale),
                    cvRound(face.height / scale)) &
           cv::Rect(0, 0, frame.cols, frame.rows);
  }
  // Largest first. The position breaks ties, so that the order is deterministic.
  std::sort(faces.begin(), faces.end(), [](const cv::Rect& a, const cv::Rect& b) {
    return std::tuple(-a.area(), a.x, a.y) < std::tuple(-b.area(), b.x, b.y);
  });
  return faces;
}

struct FaceFollower::Impl {
  FaceDetector detector;
  FaceDetector near;  // detects one face in a part of the image
  FaceFollowerOptions options;
  std::vector<Face> faces;
  int frame = 0;
  int next_id = 1;
};

FaceFollower::FaceFollower(const FaceDetectorOptions& detector, FaceFollowerOptions options) {
  options.check();
  FaceDetectorOptions close = detector;
  // The face is about half as wide as the part.
  close.max_width = 96;
  close.min_face = kCascadeWindow;
  impl_ =
      std::make_unique<Impl>(Impl{FaceDetector(detector), FaceDetector(close), options, {}, 0, 1});
}

FaceFollower::~FaceFollower() = default;
FaceFollower::FaceFollower(FaceFollower&&) noexcept = default;
FaceFollower& FaceFollower::operator=(FaceFollower&&) noexcept = default;

void FaceFollower::reset() {
  impl_->faces.clear();
  impl_->frame = 0;
}

const std::vector<FaceFollower::Face>& FaceFollower::follow(const cv::Mat& frame) {
  constexpr double kMinIou = 0.25;          // overlap of two boxes of one face
  constexpr double kSmoothingWeight = 0.5;  // weight of the new position in the smoothing
  Impl& my = *impl_;
  const bool search = my.frame++ % my.options.search_every == 0 || my.faces.empty();
  std::vector<cv::Rect> detections;
  if (search) {
    detections = my.detector.detect(frame);
  } else {
    for (const Face& face : my.faces) {
      const int margin = face.box.width / 2;
      const cv::Rect area = cv::Rect(face.box.x - margin, face.box.y - margin,
                                     face.box.width + 2 * margin, face.box.height + 2 * margin) &
                            cv::Rect(0, 0, frame.cols, frame.rows);
      if (area.empty()) continue;
      const std::vector<cv::Rect> found = my.near.detect(frame(area));
      if (!found.empty()) detections.push_back(found.front() + area.tl());
    }
  }
  for (Face& face : my.faces) {
    const auto best = std::max_element(
        detections.begin(), detections.end(),
        [&](const cv::Rect& a, const cv::Rect& b) { return iou(face.box, a) < iou(face.box, b); });
    if (best == detections.end() || iou(face.box, *best) < kMinIou) {
      ++face.missed;
      continue;
    }
    face.box = blended(face.box, *best, kSmoothingWeight);
    face.missed = 0;
    detections.erase(best);
  }
  std::erase_if(my.faces, [&](const Face& face) { return face.missed > my.options.forget_after; });
  if (search) {
    for (const cv::Rect& box : detections) {
      const bool known = std::any_of(my.faces.begin(), my.faces.end(), [&](const Face& face) {
        return iou(face.box, box) >= kMinIou;
      });
      if (!known) my.faces.push_back({my.next_id++, box, 0});
    }
  }
  return my.faces;
}

}  // namespace tarsier::face
