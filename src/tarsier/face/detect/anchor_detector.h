// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/linalg/separable.h"
#include "tarsier/linalg/tensors.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

// Detects large faces in the whole image at once. For each cell of 32 px and each of five box
// sizes, a network with separable convolutions predicts whether there is a face and how its box
// differs (Redmon and Farhadi, "YOLO9000: better, faster, stronger", CVPR 2017). It detects turned
// or half covered faces (sunglasses, beards) more often than the networks of face_networks.h, which
// were trained on uncovered ones. It is not part of the program: the network is tiny_face_detector
// of the npm package @vladmandic/face-api (see scripts/get-model.sh).
namespace tarsier::face {

inline constexpr int kAnchorCell = 32;  // px of the network's input

// For grey images: the weights of the three colours are summed, and the mean that the network
// subtracts is included in the first bias. For images without colour the results are the same.
struct AnchorDetector {
  linalg::SeparableNetwork network;
};

// Builds the network from tensors with the names of face-api:
//   conv0/filters (3 x 3 x 3 x n), conv0/bias: without padding
//   conv1/depthwise_filter (3 x 3 x c x 1), conv1/pointwise_filter (1 x 1 x c x n), conv1/bias; ..
//   conv5: the same; conv8/filters (1 x 1 x c x 25), conv8/bias
// Throws ModelError(path).
[[nodiscard]] AnchorDetector build_anchor_detector(const linalg::NamedTensors& tensors,
                                                   const std::string& path);
// Whether the tensors are of this network: one of them is conv1/depthwise_filter.
[[nodiscard]] bool has_anchor_tensors(const linalg::NamedTensors& tensors);

// Files of this type. Throws ModelError that names path and reason, OutputError.
inline constexpr std::string_view kAnchorDetectorType = "face-anchors";
void write_anchor_detector(const std::string& path, const linalg::NamedTensors& tensors,
                           const nlohmann::json& provenance);
[[nodiscard]] AnchorDetector read_anchor_detector(const std::string& path);

struct AnchorSearchOptions {
  // px; the image is scaled so that its longer side, including the margin, has this length.
  int side = 416;
  double margin = 0;       // black border on each side, share of the longer side: for tight crops
  double threshold = 0.1;  // min score of a face
  double overlap = 0.4;    // non-maximum suppression: max intersection over union

  [[nodiscard]] OptionFields fields() {
    return {{"side", side, range(96, 2048)},
            {"margin", margin, range(0, 1)},
            {"threshold", threshold, range(0.01, 0.99)},
            {"overlap", overlap, range(0, 1)}};
  }
  void check() const;
};

// Buffers that are reused between images. One per thread.
struct AnchorWorkspace {
  linalg::SeparableWorkspace network;
  cv::Mat scaled;
  std::vector<float> input;
};

// Faces in `gray` (CV_8UC1), best first. Boxes as the network gives them, from the eyebrows to the
// chin, px. The result does not depend on the number of threads. Throws std::invalid_argument.
[[nodiscard]] std::vector<ScoredFace> search_anchors(const cv::Mat& gray,
                                                     const AnchorDetector& detector,
                                                     const AnchorSearchOptions& options,
                                                     AnchorWorkspace& workspace);

// The square that OpenCV's frontal cascade and face_networks.h give for the same face.
[[nodiscard]] cv::Rect2d cascade_square(const cv::Rect2d& anchor_box);

}  // namespace tarsier::face
