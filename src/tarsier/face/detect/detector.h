// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace tarsier::face {

// Default width of the smallest face that is searched for, px of the image: 40, or 24 in images of
// up to half a megapixel, where it costs little.
[[nodiscard]] double default_min_face(cv::Size image);

struct FaceDetectorOptions {
  double min_face = 0;  // px of the image, width of the smallest box; 0: the default
  // px; wider images are searched at this width, whatever min_face is; 0: at the width that
  // min_face requires.
  int max_width = 0;
  int neighbors = 3;  // overlapping detections that are required
  double step = 1.1;  // ratio between successive face sizes
  std::string cascade = "haarcascade_frontalface_alt2.xml";

  [[nodiscard]] OptionFields fields() {
    return {{"neighbors", neighbors, range(1, 20)}, {"step", step, range(1.01, 2)}};
  }
  void check() const;
};

// Detects upright frontal faces with a boosted cascade (Viola and Jones, CVPR 2001), in the image
// reduced so that min_face is kCascadeWindow px. Not thread-safe.
inline constexpr int kCascadeWindow = 24;
class FaceDetector {
 public:
  // Throws ModelError if no cascade file is found (Debian: package opencv-data).
  explicit FaceDetector(const FaceDetectorOptions& options = {});
  ~FaceDetector();
  FaceDetector(FaceDetector&&) noexcept;
  FaceDetector& operator=(FaceDetector&&) noexcept;

  // Faces in `frame` (CV_8UC3 BGR or CV_8UC1), px, largest first.
  [[nodiscard]] std::vector<cv::Rect> detect(const cv::Mat& frame);
  // With other sizes than those of the options; max_face 0: as large as the image.
  [[nodiscard]] std::vector<cv::Rect> detect(const cv::Mat& frame, double min_face,
                                             double max_face);
  // Cost of the searches so far: pixels of all images at the resolution at which they were
  // searched.
  [[nodiscard]] std::int64_t pixels() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct FaceFollowerOptions {
  int search_every = 8;   // frames between two searches of the whole image
  int forget_after = 15;  // a face is dropped after this number of frames without detection

  [[nodiscard]] OptionFields fields() {
    return {{"search_every", search_every, at_least(1)},
            {"forget_after", forget_after, at_least(1)}};
  }
  void check() const { check_fields(*this); }
};

// Tracks faces through a video. The whole image is searched every few frames; in between, each face
// is searched for near its last position. Positions are smoothed, short misses are bridged. Not
// thread-safe.
class FaceFollower {
 public:
  // The whole image is searched at 320 px: for faces of at least 7.5 % of its width.
  explicit FaceFollower(const FaceDetectorOptions& detector = {.max_width = 320},
                        FaceFollowerOptions options = {});
  ~FaceFollower();
  FaceFollower(FaceFollower&&) noexcept;
  FaceFollower& operator=(FaceFollower&&) noexcept;

  struct Face {
    int id = 0;      // constant over frames
    cv::Rect box;    // px in the frame
    int missed = 0;  // frames since the last detection
  };
  const std::vector<Face>& follow(const cv::Mat& frame);
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face
