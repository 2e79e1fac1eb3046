// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/shape/landmark_set.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace tarsier {

// What is known when a picture is opened for annotation.
struct ProposalRequest {
  cv::Mat gray;               // CV_8UC1, the picture
  shape::LandmarkSet so_far;  // finished pictures; their paths open from the current folder
  int nearest = 0;            // index into so_far.samples: the one that was taken nearest to it
};

// Where the points may be (2 x n, px, all finite), or nothing.
using Propose = std::function<std::optional<Eigen::Matrix2Xd>(const ProposalRequest&)>;

struct ProposerOptions {
  std::uint64_t seed = 1;
  int least_faces = 3;     // finished pictures from which a model is trained, >= 2
  int most_faces = 60;     // newest ones that it is trained on: keeps it quick, 3..1000
  int starts = 12;         // of a picture in training, 1..200
  bool find_faces = true;  // try the face detector
  void check() const;
};

// Learns while a person annotates. With few finished pictures: the points of the nearest one, moved
// as the picture has moved (optical flow; nothing where the pictures are not alike). From
// `least_faces` on: supervised descent (landmarks/descent.h) from the mean shape at the place that
// the face detector tells, where it finds what is annotated in most pictures, else at the best
// match of the mean appearance; then every point goes to where it looks most as in the finished
// pictures that are most alike. The model is trained anew when finished pictures have changed.
// The same requests give the same proposals. Not thread-safe.
class Proposer {
 public:
  explicit Proposer(const ProposerOptions& options = {});
  ~Proposer();
  Proposer(Proposer&&) noexcept;
  Proposer& operator=(Proposer&&) noexcept;

  [[nodiscard]] std::optional<Eigen::Matrix2Xd> operator()(const ProposalRequest& request);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier
