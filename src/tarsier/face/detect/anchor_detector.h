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

// Large faces in one look at the whole image: a network says for each cell of 32 px and each of
// five sizes of boxes whether a face is there and how its box differs (Redmon and Farhadi, "YOLO9000:
// better, faster, stronger", CVPR 2017), with separable convolutions. It takes faces that are turned
// or half covered (sunglasses, beards) for faces more often than the networks of face_networks.h,
// which were learned from bare ones. It does not come with the program: the network is
// tiny_face_detector of the npm package @vladmandic/face-api (see scripts/get-model.sh).
namespace tarsier::face {

inline constexpr int kAnchorCell = 32;  // px of the image that the network sees

// For grey images: the weights of the three colours are summed, and the mean that the network
// subtracts is in the first bias, which changes no result for images without colour.
struct AnchorDetector {
  linalg::SeparableNetwork network;
};

// Builds the network from tensors named as face-api does:
//   conv0/filters (3 x 3 x 3 x n), conv0/bias: without a border
//   conv1/depthwise_filter (3 x 3 x c x 1), conv1/pointwise_filter (1 x 1 x c x n), conv1/bias; ..
//   conv5: the same; conv8/filters (1 x 1 x c x 25), conv8/bias
// Throws ModelError(path).
[[nodiscard]] AnchorDetector build_anchor_detector(const linalg::NamedTensors& tensors,
                                                   const std::string& path);
// Whether a file of such weights is meant: it has a tensor conv1/depthwise_filter.
[[nodiscard]] bool has_anchor_tensors(const linalg::NamedTensors& tensors);

// Files of this type. Throw ModelError naming path and reason, OutputError.
inline constexpr std::string_view kAnchorDetectorType = "face-anchors";
void write_anchor_detector(const std::string& path, const linalg::NamedTensors& tensors,
                           const nlohmann::json& provenance);
[[nodiscard]] AnchorDetector read_anchor_detector(const std::string& path);

struct AnchorSearchOptions {
  int side = 416;     // px; the image is scaled so that its longer side, with the margin, is this
  double margin = 0;  // black border at each side, share of the longer side: for tight crops
  double threshold = 0.1;  // score of a face
  double overlap = 0.4;    // intersection over union from which two boxes are one face

  [[nodiscard]] OptionFields fields() {
    return {{"side", side, range(96, 2048)},
            {"margin", margin, range(0, 1)},
            {"threshold", threshold, range(0.01, 0.99)},
            {"overlap", overlap, range(0, 1)}};
  }
  void check() const;
};

// Buffers, reused from image to image. One for each thread.
struct AnchorWorkspace {
  linalg::SeparableWorkspace network;
  cv::Mat scaled;
  std::vector<float> input;
};

// Faces in `gray` (CV_8UC1), best first: boxes as the network draws them, from the brows to the
// chin, px. The same for any number of threads. Throws std::invalid_argument.
[[nodiscard]] std::vector<ScoredFace> search_anchors(const cv::Mat& gray,
                                                     const AnchorDetector& detector,
                                                     const AnchorSearchOptions& options,
                                                     AnchorWorkspace& workspace);

// The square that OpenCV's frontal cascade, and with it face_networks.h, draws around the same
// face.
[[nodiscard]] cv::Rect2d cascade_square(const cv::Rect2d& anchor_box);

}  // namespace tarsier::face
