// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/landmarks/alpha_beta_filter.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/regression/visibility.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

namespace tarsier::face::landmarks {

struct TrackerOptions {
  int search_every = 10;    // frames between searches of the whole image for large faces
  double min_score = 0.35;  // a face whose fit has a lower score is lost
  double min_new = 0.5;     // min score of a new face's fit
  // s; a lost face that reappears near its last position within this time keeps its id.
  double remember_s = 3;
  int max_faces = 8;
  bool smoothing = true;
  AlphaBetaFilterOptions filter;

  [[nodiscard]] OptionFields fields() {
    return {{"search_every", search_every, range(1, 100000), "--search-every",
             "frames between searches for new faces"},
            {"min_score", min_score, range(0, 1), "--min-score",
             "minimum fit score; below, the face is lost and searched again"},
            {"min_new", min_new, range(0, 1)},
            {"remember_s", remember_s, at_least(0)},
            {"max_faces", max_faces, range(1, 100), "--max-faces",
             "maximum number of faces tracked at a time"}};
  }
  void check() const;
};

struct TrackedFace {
  int id = 0;
  Eigen::Matrix2Xd points;            // px, smoothed if requested
  double score = 1;                   // 0..1
  cv::Rect2d box;                     // px, as a detector would give it
  double detection = 1;               // in stills: score of the detector, 0..1
  regression::Visibility visibility;  // of the points; empty if the model has no visibility part
};

struct TrackerState {
  struct Track {
    TrackedFace face;
    Eigen::Matrix2Xd raw;  // as fitted
    AlphaBetaFilter filter;
    double last_fit_s = 0;
    bool lost = false;
  };
  std::vector<Track> tracks;
  int next_id = 1;
  int until_search = 0;
  int calm_searches = 0;  // searches of the whole image while a face is tracked and none is lost
  bool to_left = false;   // side to which the image was rotated last
  bool searched = false;  // the whole image has been searched for faces of all sizes
  SearchPlan plan;        // how later searches are spread over frames,
  cv::Size planned;       // for frames of this size
  std::size_t next_tile = 0;
  double time = 0;
  bool started = false;
};

// Processes the next frame (CV_8UC1) at `time` (s, rising; otherwise 1/25 s is assumed) and returns
// the visible faces in the order of their ids. Each face is fitted from its last position. A face
// whose score is too low is lost and searched for around its last position in each frame.
//
// The first frame is searched for faces of all sizes. Each later frame searches one tile of
// finder.plan(), in turn. Every `search_every` frames (in each frame while a face is lost) the
// whole image is searched for large faces. While a face is tracked and none is lost, only every
// fourth such search uses OpenCV's cascades. The cost of a frame therefore does not depend on its
// size, and a small face is found within as many frames as there are tiles.
//
// Rolled faces (FaceFinderOptions::rolled; by default only while no face is tracked) are searched
// for in the first frame and with each search that is due, alternating between the two sides. They
// are also searched for around the position of a lost face that was rolled. `debug` receives the
// stages of each fit.
[[nodiscard]] std::vector<TrackedFace> track_faces(
    const LandmarkModel& model, const FitOptions& fit, const TrackerOptions& options,
    FaceFinder& finder, TrackerState& state, const cv::Mat& gray, double time,
    FitWorkspace& workspace, DebugSink* debug = nullptr);

// Forgets all positions: the next frame is searched as a whole. Numbering of ids continues.
void redetect(TrackerState& state);

}  // namespace tarsier::face::landmarks
