// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/appearance/fit.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <functional>
#include <vector>

// Tracks objects through the frames of a video.
namespace tarsier::face::appearance {

// Candidate objects in an image (CV_8UC3): for each a list of starts (2 x n, px), best first.
using FindStarts = std::function<std::vector<std::vector<Eigen::Matrix2Xd>>(const cv::Mat&)>;

struct TrackOptions {
  int search_every = 10;  // frames between searches for new objects
  int max_objects = 4;
  // s; a lost object that reappears near its last position within this time keeps its id.
  double remember_s = 3;
  // If the error of a fit at the finest level rises by this factor, the fit is repeated at all
  // levels.
  double worse = 1.25;
  // A tracked object is lost only above this factor times the model's lost_error.
  double hold_error = 1.3;

  [[nodiscard]] OptionFields fields() {
    return {{"search_every", search_every, at_least(1), "--search-every",
             "frames between searches for new faces"},
            {"max_objects", max_objects, range(1, 100), "--max-faces",
             "maximum number of objects tracked at a time"},
            {"remember_s", remember_s, at_least(0)},
            {"worse", worse, at_least(1)},
            {"hold_error", hold_error, at_least(1)}};
  }
  void check() const { check_fields(*this); }
};

struct TrackedObject {
  int id = 0;
  FitResult fit;
};

// State for a video; {} before its first frame.
struct Track {
  struct Object {
    TrackedObject tracked;
    FitWorkspace workspace;
    double last_fit_s = 0;
    bool is_lost = false;
  };
  std::vector<Object> objects;
  int next_id = 1;
  int until_search = 0;
};

// Processes one frame at `time` (s). Each object is fitted from its last position. Lost objects are
// searched for, and new ones as often as the options say. New objects are ordered by size, largest
// first.
[[nodiscard]] std::vector<TrackedObject> track_objects(const Fitter& fitter,
                                                       const TrackOptions& options,
                                                       const FindStarts& find, Track& track,
                                                       const cv::Mat& image, double time);

// The objects of a single image: all fits from the starts that are not lost, one per object
// position.
[[nodiscard]] std::vector<TrackedObject> find_objects(const Fitter& fitter, const FindStarts& find,
                                                      const cv::Mat& image, int max_objects,
                                                      FitWorkspace& workspace);

}  // namespace tarsier::face::appearance
