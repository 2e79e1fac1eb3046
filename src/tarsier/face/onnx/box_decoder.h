// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <array>
#include <span>
#include <string>
#include <vector>

// From the outputs of a detector of the YuNet family (Wu, Peng and Yu, "YuNet: a tiny millisecond-
// level face detector", 2023) to faces.
namespace tarsier::face::onnx {

struct FoundFace {
  cv::Rect2d box;    // px of the network's image
  double score = 0;  // 0..1
  // Eyes (left and right as seen), tip of the nose, corners of the mouth, px.
  std::array<cv::Point2d, 5> points;
};

// The sizes of cells, px, whose outputs are there: of names cls_S, obj_S, bbox_S and kps_S, S a
// power of two from 4 to 128; empty: not all four of each, or none.
[[nodiscard]] std::vector<int> strides_of(std::span<const std::string> names);

// Of each cell (column i, row j) of S px: score sqrt(cls obj), each held to 0..1; the box's centre
// ((i + b0) S, (j + b1) S) and size (e^b2 S, e^b3 S); points ((i + k0) S, (j + k1) S).
// `outputs[i]` is called `names[i]`; cls and obj hold rows x columns numbers, bbox 4 of them for each,
// kps 10. `input`: of the network, px. Those that score `threshold` or more, best first; of boxes that
// overlap by more than `overlap` (intersection over union) the better one stays. Throws
// std::invalid_argument for outputs of other sizes. Numbers that are not finite are no face.
[[nodiscard]] std::vector<FoundFace> decode_boxes(std::span<const std::string> names,
                                                  std::span<const cv::Mat> outputs, cv::Size input,
                                                  double threshold, double overlap = 0.3);

// The square that OpenCV's frontal cascade draws around a face with these points: 2.4 times as wide
// as the eyes are apart (of turned heads: as the distance from the eyes to the mouth tells).
[[nodiscard]] cv::Rect2d square_of_points(const std::array<cv::Point2d, 5>& points);

}  // namespace tarsier::face::onnx
