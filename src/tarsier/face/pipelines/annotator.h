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

// What is known when an image is opened for annotation.
struct ProposalRequest {
  cv::Mat gray;               // CV_8UC1, the image
  shape::LandmarkSet so_far;  // finished images; their paths open from the current folder
  int nearest = 0;            // index into so_far.samples: the one that was taken nearest to it
};

// Where the points may be.
struct Proposal {
  Eigen::Matrix2Xd points;  // 2 x n, px, all finite
  bool learned = false;     // by a model of the finished images; else from the nearest one of them
};

// {"points": [[x, y] ..], "learned"}; to a hundredth of a pixel.
[[nodiscard]] nlohmann::ordered_json to_json(const Proposal& proposal);

struct AnnotatorOptions {
  std::uint64_t seed = 1;
  int min_faces = 3;       // finished images from which a model is trained
  int max_faces = 60;      // newest ones that it is trained on: keeps it quick
  int starts = 12;         // of an image in training
  bool find_faces = true;  // try the face detector

  [[nodiscard]] OptionFields fields() {
    return {{"min_faces", min_faces, at_least(2)},
            {"max_faces", max_faces, range(3, 1000)},
            {"starts", starts, range(1, 200)}};
  }
  void check() const { check_fields(*this); }
};

// Learns while a person annotates images:
//
//   face::Annotator annotator;
//   shape::LandmarkSet done;
//   for each image:
//     const auto proposal = annotator.propose({gray, done, nearest});
//     .. a person corrects the points (or begins from nothing)
//     done.samples.push_back({path, points});
//
// Its model is learned from these images alone, so it takes no ModelStore.
//
// With few finished images: the points of the nearest one, moved as the image has moved
// (optical flow; nothing where the images are not alike). From `min_faces` on: supervised
// descent (landmarks/descent.h) from the mean shape at the place that the face detector tells,
// where it finds what is annotated in most images, else at the best match of the mean appearance;
// then every point goes to where it looks most as in the finished images that are most alike. The
// model is trained again when finished images have changed. The same requests give the same
// proposals. Not thread-safe.
class Annotator {
 public:
  explicit Annotator(const AnnotatorOptions& options = {});
  ~Annotator();
  Annotator(Annotator&&) noexcept;
  Annotator& operator=(Annotator&&) noexcept;

  // Nothing where no point can be proposed. Throws std::invalid_argument for an image that is not
  // CV_8UC1 and a nearest sample that is not there.
  [[nodiscard]] std::optional<Proposal> propose(const ProposalRequest& request);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face
