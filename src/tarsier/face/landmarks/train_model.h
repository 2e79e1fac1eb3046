// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/training_face.h"

#include <cstdint>
#include <functional>
#include <limits>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::landmarks {

// Shapes near a face's points from which fits may begin besides the mean shape (2 x n px of the
// face's image each); the same for the same seed, called from several threads.
using StartShapes = std::function<std::vector<Eigen::Matrix2Xd>(const TrainingFace& face, int count,
                                                                std::uint64_t seed)>;

struct TrainModelOptions {
  bool mirror = false;
  bool trees = true;  // which parts
  bool descent = true;
  bool patches = true;
  bool quality = true;
  // px; NaN: measured (see DescentReport::to_the_right) where mirrored faces take part.
  double to_the_right = std::numeric_limits<double>::quiet_NaN();
  int starts = 24;  // of each face
  // More faces to learn from, for trees, descent and quality; empty: none.
  ExtraFaces extra;
  // Fits that begin again from a better start than the mean shape must learn from such starts too;
  // empty: none.
  StartShapes start_shapes;
  int shaped_starts = 4;  // of each face, if there are start_shapes
  shape::ShapeModelOptions shape;
  TreesOptions tree_options;
  DescentOptions descent_options;
  PatchOptions patch_options;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"starts", starts, range(1, 200), "--scatter", "starts scattered around each face"},
            {"shaped_starts", shaped_starts, range(1, 200)}};
  }
  void check() const;
};

struct TrainedModel {
  LandmarkModel model;
  int faces = 0;                     // without the mirrored
  int extra = 0;                     // made from them, without the mirrored
  int detected = 0;                  // of these, seen by the face detector
  double to_the_right = 0;           // px, that was used
  std::vector<std::string> skipped;  // "path: reason"
};

// All parts from a set of annotated images. Throws InputError (nothing usable), Interrupted.
[[nodiscard]] TrainedModel train_landmark_model(const shape::LandmarkSet& set,
                                                const std::string& set_path,
                                                const TrainModelOptions& options,
                                                Progress& progress, const std::stop_token& stop);

// How far a set's points lie to the right of where a mirror-symmetric model puts them, px of the images
// (DescentReport::to_the_right), by a short descent on a part of `faces`, mirrored ones among them.
[[nodiscard]] double measured_shift(const std::vector<TrainingFace>& faces,
                                    const Eigen::Matrix2Xd& mean, std::uint64_t seed,
                                    Progress& progress, const std::stop_token& stop);
inline constexpr double kShiftWorthMending = 0.2;  // px

// The mean of the faces' shapes: 2 x n, centred, size 1.
[[nodiscard]] Eigen::Matrix2Xd mean_shape(const std::vector<TrainingFace>& faces);

// The faces of a set (paths from the current folder) for networks that see them in a frame (face_input.h), with
// `mirror` also mirrored; a shift of the set's points to one side is measured and taken into account. Images that
// cannot be used are named in `skipped`. Throws InputError, Interrupted.
[[nodiscard]] std::vector<TrainingFace> load_framed_faces(const shape::LandmarkSet& set,
                                                          bool mirror, std::uint64_t seed,
                                                          Progress& progress,
                                                          const std::stop_token& stop,
                                                          std::vector<std::string>& skipped);

// Mean shapes around each face as a detector's boxes place them: without a box, scattered around
// the truth (shift normal, 9 % of the size; scale log-normal, 10 %; turn 10 degrees). Where a box
// is known, every second one around the start that it gives (half as wide), so that what detectors
// do on average is learned too. `boxes`: one for each face, empty where there is none; or none at
// all.
[[nodiscard]] std::vector<Start> scattered_starts(const std::vector<TrainingFace>& faces,
                                                  const Eigen::Matrix2Xd& mean, int each,
                                                  std::uint64_t seed,
                                                  const std::vector<cv::Rect2d>& boxes = {},
                                                  const BoxModel& box = {});

}  // namespace tarsier::face::landmarks
