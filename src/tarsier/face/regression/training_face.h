// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::face::regression {

// A training sample: grey, cropped around the face, all points present.
struct TrainingFace {
  cv::Mat gray;                   // CV_8UC1
  Eigen::Matrix2Xd points;        // px of `gray`, pixel centres at integers
  std::optional<cv::Rect2d> box;  // px of `gray`
  std::string name;
  std::string person;
  bool mirrored = false;  // mirror image of the preceding face
  bool turned = false;    // made from a preceding face by an ExtraFaces
  double scale = 1;       // px of the image per px of `gray`
};

struct LoadOptions {
  bool mirror = false;  // add a mirrored copy after each face
  // Horizontal offset of the set's points from a mirror-symmetric annotation, px of the images
  // (DescentReport::to_the_right). The points of mirrored faces get the same offset.
  double to_the_right = 0;
  double margin = 0.75;  // kept around the points' box, share of its larger side
  int largest = 400;     // px; larger faces are reduced to this size of the points' box

  [[nodiscard]] OptionFields fields() {
    return {{"to_the_right", to_the_right, range(-100, 100)},
            {"margin", margin, range(0, 4)},
            {"largest", largest, range(50, 4000)}};
  }
  void check() const { check_fields(*this); }
};

// Reads the images of a set. Incomplete samples and images that cannot be read are skipped and
// listed in `skipped` ("path: reason"). Throws Interrupted; InputError(set_path) if no face is
// left.
[[nodiscard]] std::vector<TrainingFace> load_training_faces(
    const shape::LandmarkSet& set, const std::string& set_path, const LoadOptions& options,
    Progress& progress, const std::stop_token& stop, std::vector<std::string>& skipped);

// Makes additional training faces from one that is neither mirrored nor turned. Their points are as
// accurate as those of the face. Must be deterministic by the seed and thread-safe.
using ExtraFaces =
    std::function<std::vector<TrainingFace>(const TrainingFace& face, std::uint64_t seed)>;

// The faces, each followed by its mirror image if that is among them, and then by the faces that
// `extra` makes from it. The latter are marked as turned and, if `mirror` is not empty, also
// mirrored (LoadOptions).
[[nodiscard]] std::vector<TrainingFace> with_extra_faces(
    const std::vector<TrainingFace>& faces, const ExtraFaces& extra, const std::vector<int>& mirror,
    double to_the_right, std::uint64_t seed, Progress& progress, const std::stop_token& stop);

// Start of a fit: a shape (2 x n, px of its face's image).
struct Start {
  int face = 0;  // index of the training face
  Eigen::Matrix2Xd points;
};

// Root mean squared distance of points from their centre, px: the size of a shape.
[[nodiscard]] double shape_size(const Eigen::Matrix2Xd& points);

// The mean of the faces' shapes: 2 x n, centred, size 1.
[[nodiscard]] Eigen::Matrix2Xd mean_shape(const std::vector<TrainingFace>& faces);

}  // namespace tarsier::face::regression
