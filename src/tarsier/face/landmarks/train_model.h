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

// Returns shapes near a face's points (2 x n px of the face's image each), from which fits may
// start besides the mean shape. Must be deterministic by the seed and thread-safe.
using StartShapes = std::function<std::vector<Eigen::Matrix2Xd>(const TrainingFace& face, int count,
                                                                std::uint64_t seed)>;

struct TrainModelOptions {
  bool mirror = false;
  bool trees = true;  // which parts to train
  bool descent = true;
  bool patches = true;
  bool quality = true;
  // px; NaN: measured (see DescentReport::to_the_right) if mirrored faces are used.
  double to_the_right = std::numeric_limits<double>::quiet_NaN();
  int starts = 24;  // per face
  // Additional training faces for trees, descent and quality; empty: none.
  ExtraFaces extra;
  // Additional starts, for models whose fits are repeated from a better start than the mean shape;
  // empty: none.
  StartShapes start_shapes;
  int shaped_starts = 4;  // per face, if start_shapes is set
  shape::ShapeModelOptions shape;
  TreesOptions tree_options;
  DescentOptions descent_options;
  PatchOptions patch_options;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"starts", starts, range(1, 200), "--scatter",
             "number of random initial shapes for each face"},
            {"shaped_starts", shaped_starts, range(1, 200)}};
  }
  void check() const;
};

struct TrainedModel {
  LandmarkModel model;
  int faces = 0;                     // without mirrored ones
  int extra = 0;                     // made from them, without mirrored ones
  int detected = 0;                  // number of faces that the face detector detected
  double to_the_right = 0;           // px, the value that was used
  std::vector<std::string> skipped;  // "path: reason"
};

// Trains all parts on a set of annotated images. Throws InputError (no usable image), Interrupted.
[[nodiscard]] TrainedModel train_landmark_model(const shape::LandmarkSet& set,
                                                const std::string& set_path,
                                                const TrainModelOptions& options,
                                                Progress& progress, const std::stop_token& stop);

// Horizontal offset of a set's points from those of a mirror-symmetric model, px of the images
// (DescentReport::to_the_right). Trains a short descent on some of `faces`, including mirrored
// ones.
[[nodiscard]] double measured_shift(const std::vector<TrainingFace>& faces,
                                    const Eigen::Matrix2Xd& mean, std::uint64_t seed,
                                    Progress& progress, const std::stop_token& stop);
inline constexpr double kMinCorrectedShift = 0.2;  // px

// The mean of the faces' shapes: 2 x n, centred, size 1.
[[nodiscard]] Eigen::Matrix2Xd mean_shape(const std::vector<TrainingFace>& faces);

// The faces of a set (paths relative to the current folder) for networks that see them in a frame
// (face_input.h), with `mirror` also mirrored. A horizontal offset of the set's points is measured
// and corrected for. Images that cannot be used are listed in `skipped`. Throws InputError,
// Interrupted.
[[nodiscard]] std::vector<TrainingFace> load_framed_faces(const shape::LandmarkSet& set,
                                                          bool mirror, std::uint64_t seed,
                                                          Progress& progress,
                                                          const std::stop_token& stop,
                                                          std::vector<std::string>& skipped);

// Mean shapes near each face, as placed by a detector's boxes. Without a box, they are scattered
// around the true shape (shift normal, 9 % of the size; scale log-normal, 10 %; rotation 10
// degrees). With a box, every second one is scattered around the start from the box (half as wide),
// so that the detector's mean offset is learned too. `boxes`: one per face, empty if not detected;
// or an empty list.
[[nodiscard]] std::vector<Start> scattered_starts(const std::vector<TrainingFace>& faces,
                                                  const Eigen::Matrix2Xd& mean, int each,
                                                  std::uint64_t seed,
                                                  const std::vector<cv::Rect2d>& boxes = {},
                                                  const BoxModel& box = {});

}  // namespace tarsier::face::landmarks
