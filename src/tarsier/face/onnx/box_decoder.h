// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <array>
#include <span>
#include <string>
#include <vector>

// Converts the outputs of a detector of the YuNet family (Wu, Peng and Yu, "YuNet: a tiny
// millisecond-level face detector", 2023) to faces.
namespace tarsier::face::onnx {

struct DecodedFace {
  cv::Rect2d box;    // px of the network's input
  double score = 0;  // 0..1
  // Eyes (left and right in the image), nose tip, mouth corners, px.
  std::array<cv::Point2d, 5> points;
};

// The cell sizes of the outputs, px: the names are cls_S, obj_S, bbox_S and kps_S with S a power of
// two from 4 to 128. Empty if there are none, or not all four of each.
[[nodiscard]] std::vector<int> strides_of(std::span<const std::string> names);

// For each cell (column i, row j) of S px: score sqrt(cls obj), each limited to 0..1; box centre
// ((i + b0) S, (j + b1) S) and size (e^b2 S, e^b3 S); points ((i + k0) S, (j + k1) S). `outputs[i]`
// is called `names[i]`; cls and obj contain rows x columns numbers, bbox 4 and kps 10 per cell.
// `input`: size of the network's input, px. Returns the faces with a score of at least `threshold`,
// best first, after non-maximum suppression with the intersection over union `overlap`. Values that
// are not finite give no face. Throws std::invalid_argument for outputs of other sizes.
[[nodiscard]] std::vector<DecodedFace> decode_boxes(std::span<const std::string> names,
                                                    std::span<const cv::Mat> outputs,
                                                    cv::Size input, double threshold,
                                                    double overlap = 0.3);

// The square that OpenCV's frontal cascade gives for a face with these points: 2.4 eye distances
// wide (for turned heads, the eye distance is derived from the distance between eyes and mouth).
[[nodiscard]] cv::Rect2d square_of_points(const std::array<cv::Point2d, 5>& points);

}  // namespace tarsier::face::onnx
