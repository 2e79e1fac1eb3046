// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/steady.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <vector>

namespace tarsier::face::landmarks {

struct TrackerOptions {
  int search_every = 10;    // frames between two looks at the whole image for large faces
  double min_score = 0.35;  // a face whose fit is worth less is lost
  double min_new = 0.5;     // what the fit of a new face must be worth
  double remember_s = 3;    // s in which a lost face that appears near its place keeps its id
  int max_faces = 8;
  bool smoothing = true;
  SteadyOptions filter;

  [[nodiscard]] OptionFields fields() {
    return {{"search_every", search_every, range(1, 100000), "--search-every",
             "frames between searches for new faces"},
            {"min_score", min_score, range(0, 1), "--min-score",
             "a face whose fit is worth less is lost and looked for again"},
            {"min_new", min_new, range(0, 1)},
            {"remember_s", remember_s, at_least(0)},
            {"max_faces", max_faces, range(1, 100), "--max-faces", "faces followed at a time"}};
  }
  void check() const;
};

struct TrackedFace {
  int id = 0;
  Eigen::Matrix2Xd points;  // px, smoothed where asked
  double score = 1;         // 0..1
  cv::Rect2d box;           // px, as a detector would draw it
  double detection = 1;     // of stills: score of the detector, 0..1
  Visibility visibility;    // of the points; empty where the model has no such part
};

struct TrackerState {
  struct Track {
    TrackedFace face;
    Eigen::Matrix2Xd raw;  // as fitted
    Steady filter;
    double seen = 0;  // s, when it was last fitted
    bool lost = false;
  };
  std::vector<Track> tracks;
  int next_id = 1;
  int until_search = 0;
  int calm_searches = 0;  // of the whole image while a face is followed and none is lost
  bool to_left = false;   // side to which the image was turned last
  bool searched = false;  // the whole image, for faces of all sizes
  SearchPlan plan;        // how that is spread from then on,
  cv::Size planned;       // for frames of this size
  std::size_t next_tile = 0;
  double time = 0;
  bool started = false;
};

// The next frame (CV_8UC1) at `time` (s, rising; else 1/25 s is taken to have passed): faces in
// sight, in the order of their ids. Each is fitted from where it was; one whose score falls is
// looked for around its place in each frame. The first frame is searched for faces of all sizes.
// From then on each frame sees one tile of finder.plan(), in turn, and every `search_every` frames
// (while a face is lost: in each) the whole image for large faces, by OpenCV's cascades only in every
// fourth such search while a face is followed and none is lost: the cost of a frame does not depend
// on its size, and a small face is found within as many frames as there are tiles. Rolled faces are
// looked for (FaceFinderOptions::rolled; by default while no face is followed) in the first frame and
// with each search that is due, to one side and the other in turn, and around the place of a
// lost face that was rolled. `debug` gets the stages of each fit.
[[nodiscard]] std::vector<TrackedFace> track_faces(
    const LandmarkModel& model, const FitOptions& fit, const TrackerOptions& options,
    FaceFinder& finder, TrackerState& state, const cv::Mat& gray, double time,
    FitWorkspace& workspace, DebugSink* debug = nullptr);

// Forgets all places; faces are searched in the next frame. Ids go on.
void redetect(TrackerState& state);

}  // namespace tarsier::face::landmarks
