// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/matching.h"

#include <opencv2/core.hpp>

#include <vector>

namespace tarsier::sfm {

struct FlowOptions {
  int max_points = 4000;          // max number of points tracked at a time
  int grid = 16;                  // cells along the longer side; each gets its share of points
  int reach = 6;                  // max number of images over which a point is tracked
  double back_px = 0.7;           // max distance to its start after backward tracking
  double min_correlation = 0.85;  // min correlation with the patch of the first image

  [[nodiscard]] OptionFields fields() {
    return {{"max_points", max_points, range(10, 1'000'000)},
            {"grid", grid, range(1, 200)},
            {"reach", reach, range(2, 100)},
            {"back_px", back_px, range(0.01, 10)},
            {"alike", min_correlation, range(0, 0.999)}};
  }
  void check() const { check_fields(*this); }
};

// Matches of two images, first < second.
struct FlowMatches {
  int first = 0;
  int second = 0;
  std::vector<Match> matches;  // sorted by `first`
};

struct FlowResult {
  std::vector<Features> features;  // for each image; no descriptors; sizes: px of the patch
  std::vector<FlowMatches> pairs;  // sorted by first, second; with at least one match
};

// Tracks points through the frames of a video or a fast series. Corners (Shi and Tomasi, "Good
// features to track", CVPR 1994) are detected wherever no point is tracked yet, spread over the
// image. They are tracked from frame to frame by pyramidal Lucas-Kanade (Bouguet, 2000), forward
// and backward. Then each is aligned with the patch of its first frame by an affine map with gain
// and offset (inverse compositional, Baker and Matthews, IJCV 2004), so that errors do not
// accumulate.
//
// A point is dropped where backward tracking misses its start, where its patch changes or leaves
// the image, and where it meets an older point. It also ends after `reach` images, and another one
// begins there. These ends are spread over the frames, so that no frame divides the sequence.
//
// Holds two images and a small patch per point, for any `reach`. Does not depend on the number of
// threads.
class FlowTracker {
 public:
  explicit FlowTracker(const FlowOptions& options);
  ~FlowTracker();
  FlowTracker(const FlowTracker&) = delete;
  FlowTracker& operator=(const FlowTracker&) = delete;

  // Adds the next frame, CV_8UC3 (BGR) or CV_8UC1, all of one size, at least 64 px on each side.
  // Throws std::invalid_argument otherwise.
  void add(const cv::Mat& image);

  [[nodiscard]] int count() const { return count_; }  // frames up to now

  // Features and matches of all frames up to now; the next add() begins a new sequence. Points in
  // only one frame are left out.
  [[nodiscard]] FlowResult finish();

 private:
  // A point through consecutive frames.
  struct Track {
    int start = 0;  // frame
    std::vector<cv::Point2f> points;
    std::vector<cv::Vec3b> colors;
    std::vector<float> sizes;
  };

  struct LiveTrack;  // state of a tracked point; removed when it ends

  void track_points(const cv::Mat& image, const std::vector<cv::Mat>& pyramid,
                    const cv::Mat& smooth);
  void remove_duplicates();
  void end(LiveTrack& live);
  void begin(const cv::Mat& image, const cv::Mat& gray, const cv::Mat& smooth);

  FlowOptions options_;
  int count_ = 0;
  cv::Size size_;
  double spacing_ = 0;                  // px, min distance between corners
  std::vector<cv::Mat> pyramid_;        // of the latest frame
  std::vector<LiveTrack> live_tracks_;  // oldest first
  std::vector<Track> done_;             // in two frames or more
};

}  // namespace tarsier::sfm
