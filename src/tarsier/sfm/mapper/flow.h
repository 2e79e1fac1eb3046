// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/mapper/features.h"
#include "tarsier/sfm/mapper/matching.h"

#include <opencv2/core.hpp>

#include <vector>

namespace tarsier::sfm {

struct FlowOptions {
  int max_points = 4000;  // that are followed at a time
  int grid = 16;          // cells along the larger side, each gets its share of them
  int reach = 6;          // images that a point is followed over at most
  double back_px = 0.7;   // followed back, a point must come this near to its start
  double alike = 0.85;    // least correlation with the patch of the first image

  [[nodiscard]] OptionFields fields() {
    return {{"max_points", max_points, range(10, 1'000'000)},
            {"grid", grid, range(1, 200)},
            {"reach", reach, range(2, 100)},
            {"back_px", back_px, range(0.01, 10)},
            {"alike", alike, range(0, 0.999)}};
  }
  void check() const { check_fields(*this); }
};

// What two images have in common, first < second.
struct FlowMatches {
  int first = 0;
  int second = 0;
  std::vector<Match> matches;  // by `first`
};

struct FlowResult {
  std::vector<Features> features;  // of each image; no descriptors; sizes: px of the patch
  std::vector<FlowMatches> pairs;  // by first, second; those with at least one match
};

// Follows points through the frames of a video or a quick series. Corners (Shi and Tomasi, "Good
// features to track", CVPR 1994), spread over the image, are found wherever no point is followed
// yet. Each goes from frame to frame by pyramidal Lucas-Kanade (Bouguet, 2000), forward and back.
// Then it is aligned again with the patch of its first frame, by an affine map with gain and offset
// (inverse compositional, Baker and Matthews, IJCV 2004), so that errors do not add up. A point is
// dropped where following it back does not end at its start, where its patch no longer looks the
// same or leaves the image, and where it runs into an older one. It also ends after `reach`
// images, with another beginning there; the ends are spread over the frames, so that no frame
// cuts the sequence in two.
//
// Holds two images and a small patch for each point, whatever `reach` is. The same for any number
// of threads.
class FlowTracker {
 public:
  explicit FlowTracker(const FlowOptions& options);
  ~FlowTracker();
  FlowTracker(const FlowTracker&) = delete;
  FlowTracker& operator=(const FlowTracker&) = delete;

  // The next frame, CV_8UC3 (BGR) or CV_8UC1, all of one size, at least 64 px on each side. Throws
  // std::invalid_argument otherwise.
  void add(const cv::Mat& image);

  [[nodiscard]] int count() const { return count_; }  // frames so far

  // Features and matches of all frames so far; the next add() begins a new sequence. Points that
  // were seen once only are left out.
  [[nodiscard]] FlowResult finish();

 private:
  // One point through consecutive frames.
  struct Track {
    int start = 0;  // frame
    std::vector<cv::Point2f> points;
    std::vector<cv::Vec3b> colors;
    std::vector<float> sizes;
  };

  struct Live;  // what following one needs; gone when it ends

  void follow(const cv::Mat& image, const std::vector<cv::Mat>& pyramid, const cv::Mat& smooth);
  void separate();
  void end(Live& live);
  void begin(const cv::Mat& image, const cv::Mat& gray, const cv::Mat& smooth);

  FlowOptions options_;
  int count_ = 0;
  cv::Size size_;
  double spacing_ = 0;            // px, between corners at least
  std::vector<cv::Mat> pyramid_;  // of the last frame
  std::vector<Live> live_;        // oldest first
  std::vector<Track> done_;       // of two frames or more
};

}  // namespace tarsier::sfm
