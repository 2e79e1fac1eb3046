// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/appearance/fit.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <functional>
#include <vector>

// The same objects, frame after frame.
namespace tarsier::face::appearance {

// Where objects may be in an image (CV_8UC3): for each a list of starts (2 x n, px), best first.
using FindStarts = std::function<std::vector<std::vector<Eigen::Matrix2Xd>>(const cv::Mat&)>;

struct TrackOptions {
  int search_every = 10;  // frames between searches for further objects
  int max_objects = 4;
  double remember_s = 3;    // in which a lost one that appears near its place keeps its id
  double worse = 1.25;      // a fit at the finest level alone whose error rose by this factor is
                            // done again at all levels
  double hold_error = 1.3;  // an object that is followed is lost only above this times the
                            // model's lost_error

  [[nodiscard]] OptionFields fields() {
    return {
        {"search_every", search_every, at_least(1), "--search-every",
         "frames between searches for new faces"},
        {"max_objects", max_objects, range(1, 100), "--max-faces", "objects followed at a time"},
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

// State of a video; {} before its first frame.
struct Track {
  struct Object {
    TrackedObject now;
    FitWorkspace workspace;
    double seen = 0;  // s, when it was last fitted
    bool is_lost = false;
  };
  std::vector<Object> objects;
  int next_id = 1;
  int until_search = 0;
};

// One more frame at `time` (s): each object is fitted from where it was; a lost one is looked for,
// new ones as options say. Largest first where they are new.
[[nodiscard]] std::vector<TrackedObject> track_objects(const Fitter& fitter,
                                                       const TrackOptions& options,
                                                       const FindStarts& find, Track& track,
                                                       const cv::Mat& image, double time);

// The objects of an image by itself: fits from the starts that are not lost, each place once.
[[nodiscard]] std::vector<TrackedObject> find_objects(const Fitter& fitter, const FindStarts& find,
                                                      const cv::Mat& image, int most,
                                                      FitWorkspace& workspace);

}  // namespace tarsier::face::appearance
