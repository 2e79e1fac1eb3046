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

namespace tarsier::face::landmarks {

// A sample ready for training: grey, cut out around the face, no point missing.
struct TrainingFace {
  cv::Mat gray;                   // CV_8UC1
  Eigen::Matrix2Xd points;        // px of `gray`, centres at integers
  std::optional<cv::Rect2d> box;  // px of `gray`
  std::string name;
  std::string person;
  bool mirrored = false;  // the face before it, mirrored
  bool turned = false;    // made of a face before it, by an ExtraFaces
  double scale = 1;       // px of the image to a px of `gray`
};

struct LoadOptions {
  bool mirror = false;  // each face mirrored too, behind the one it comes from
  // The set's points lie so far to the right of where a mirror-symmetric annotation has them, px of
  // the images (DescentReport::to_the_right); mirrored faces get theirs there too.
  double to_the_right = 0;
  double margin = 0.75;  // around the points' box that stays, share of its larger side
  int largest = 400;     // px; the points' box is reduced to this at most

  [[nodiscard]] OptionFields fields() {
    return {{"to_the_right", to_the_right, range(-100, 100)},
            {"margin", margin, range(0, 4)},
            {"largest", largest, range(50, 4000)}};
  }
  void check() const { check_fields(*this); }
};

// Reads the images of a set. Samples that are not complete and images that cannot be read are
// left out and named in `skipped` ("path: reason"). Throws Interrupted; InputError(set_path) where
// nothing is left.
[[nodiscard]] std::vector<TrainingFace> load_training_faces(
    const shape::LandmarkSet& set, const std::string& set_path, const LoadOptions& options,
    Progress& progress, const std::stop_token& stop, std::vector<std::string>& skipped);

// Faces made from one that is neither mirrored nor turned, as more to learn from. Their points are
// as exact as the face's; the same for the same seed; called from several threads.
using ExtraFaces =
    std::function<std::vector<TrainingFace>(const TrainingFace& face, std::uint64_t seed)>;

// The faces, each followed by its mirror image where that is among them, with what `extra` makes of
// each behind it, marked as turned and, where `mirror` is not empty, mirrored too (LoadOptions).
[[nodiscard]] std::vector<TrainingFace> with_extra_faces(
    const std::vector<TrainingFace>& faces, const ExtraFaces& extra, const std::vector<int>& mirror,
    double to_the_right, std::uint64_t seed, Progress& progress, const std::stop_token& stop);

// Where a fit begins: a shape (2 x n, px of its face's image).
struct Start {
  int face = 0;  // index of the training face
  Eigen::Matrix2Xd points;
};

// Root mean squared distance of points from their centre, px: the size of a shape.
[[nodiscard]] double shape_size(const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::landmarks
