// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/regression/face_input.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/linalg/network.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Direct regression of all points by a convolutional network (as in Sun and others, "Deep
// convolutional network cascade for facial point detection", CVPR 2013). It sees the whole face at
// once, while trees and descent use pixels near the points. Its errors are different, so that the
// mean of all methods is better than each.
namespace tarsier::face::regression {

// The network sees the face in the frame of a start (face_input.h, kNetworkSide, kNetworkScale).
// Its output is 2 n numbers d, x of all points, then y:
//   x = S(mean + d)
// where S is the similarity from the mean shape to the start. Only the start's position, size and
// angle matter.
struct RegressionNetwork {
  Eigen::Matrix2Xd mean;  // 2 x n: centred, size 1
  linalg::Network network;
  [[nodiscard]] int points() const { return static_cast<int>(mean.cols()); }
  void check() const;  // throws std::invalid_argument
};
inline constexpr int kNetworkSide = 96;      // px
inline constexpr double kNetworkScale = 20;  // px per unit of the mean shape's size

struct RegressionNetworkOptions {
  int steps = 8000;       // with 32 faces each
  double occluded = 0.3;  // share of the faces with a synthetic occlusion
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"steps", steps, range(1, 1'000'000), "--steps", "training steps, batches of 32 faces"},
            {"occluded", occluded, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// The loss is the mean distance of a point from its true position. Training faces are randomly
// shifted, rotated and scaled, changed in light and sharpness, and partly occluded (occlusion.h).
// The result does not depend on the number of threads. Throws Interrupted; std::invalid_argument
// for fewer than two faces or faces with different numbers of points.
[[nodiscard]] RegressionNetwork train_regression_network(const std::vector<TrainingFace>& faces,
                                                         const RegressionNetworkOptions& options,
                                                         Progress& progress,
                                                         const std::stop_token& stop);

// Buffers. One per thread.
struct RegressionNetworkWorkspace {
  linalg::Workspace network;
  FaceInput face;
};

// The fit from a start, 2 x n, px of `gray` (CV_8UC1). Throws std::invalid_argument for another
// number of points, or points without extent.
[[nodiscard]] Eigen::Matrix2Xd fit_network(const RegressionNetwork& model, const cv::Mat& gray,
                                           const Eigen::Matrix2Xd& start,
                                           RegressionNetworkWorkspace& workspace);

[[nodiscard]] nlohmann::json to_json(const RegressionNetwork& model);
[[nodiscard]] RegressionNetwork regression_network_from_json(const nlohmann::json& value,
                                                             const std::string& path);

}  // namespace tarsier::face::regression
