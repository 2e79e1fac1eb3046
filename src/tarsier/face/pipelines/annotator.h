// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

namespace tarsier::face {

// Input of Annotator::propose().
struct ProposalRequest {
  cv::Mat gray;  // the image, CV_8UC1
  // The images annotated so far. Their paths are relative to the current folder.
  shape::LandmarkSet annotated;
  // Index into annotated.samples: the finished image that was taken nearest to this one.
  int nearest = 0;
};

// Proposed positions of the points.
struct Proposal {
  Eigen::Matrix2Xd points;  // 2 x n, px, all finite
  // True: by a model trained on the finished images. False: moved from the nearest one of them.
  bool from_model = false;
};

// {"points": [[x, y] ..], "learned"}; coordinates are rounded to 0.01 px.
[[nodiscard]] nlohmann::ordered_json to_json(const Proposal& proposal);

struct AnnotatorOptions {
  std::uint64_t seed = 1;
  int min_faces = 3;       // finished images that training needs
  int max_faces = 60;      // only the newest ones are trained on, so that training stays quick
  int starts = 12;         // training starts per image
  bool find_faces = true;  // use the face detector

  [[nodiscard]] OptionFields fields() {
    return {{"min_faces", min_faces, at_least(2)},
            {"max_faces", max_faces, range(3, 1000)},
            {"starts", starts, range(1, 200)}};
  }
  void check() const { check_fields(*this); }
};

// Proposes the points of an image while a person annotates a set, and learns from the finished
// images:
//
//   face::Annotator annotator;
//   shape::LandmarkSet done;
//   for each image:
//     const auto proposal = annotator.propose({gray, done, nearest});
//     .. the person corrects the points (or begins without a proposal)
//     done.samples.push_back({path, points});
//
// The model is trained on these images alone, so no ModelStore is needed.
//
// With fewer than `min_faces` finished images, the points of the nearest image are moved by optical
// flow. If the two images are too different, the points are transferred by the face detector's
// boxes, if possible. From `min_faces` on, supervised descent (regression/descent.h) fits the
// points. It starts from the mean shape, placed by the face detector if that finds the annotated
// object in most images, otherwise at the best match of the mean appearance. Each point is then
// refined by comparing its surroundings with the most similar finished images. The model is trained
// again when the finished images have changed. The same requests give the same proposals. Not
// thread-safe.
class Annotator {
 public:
  explicit Annotator(const AnnotatorOptions& options = {});
  ~Annotator();
  Annotator(Annotator&&) noexcept;
  Annotator& operator=(Annotator&&) noexcept;

  // Empty if no points can be proposed. Throws std::invalid_argument if the image is not CV_8UC1 or
  // the nearest sample does not exist.
  [[nodiscard]] std::optional<Proposal> propose(const ProposalRequest& request);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face
