// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/box_decoder.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tarsier::face::onnx {
namespace {

constexpr std::size_t kMaxCandidates = 5000;  // max candidates before non-maximum suppression

std::ptrdiff_t index_of(std::span<const std::string> names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : found - names.begin();
}

bool is_finite(const DecodedFace& face) {
  bool finite = std::isfinite(face.score) && std::isfinite(face.box.x) &&
                std::isfinite(face.box.y) && std::isfinite(face.box.width) &&
                std::isfinite(face.box.height);
  for (const cv::Point2d& point : face.points)
    finite = finite && std::isfinite(point.x) && std::isfinite(point.y);
  return finite;
}

}  // namespace

std::vector<int> strides_of(std::span<const std::string> names) {
  std::vector<int> out;
  for (const int stride : {4, 8, 16, 32, 64, 128}) {
    int there = 0;
    for (const char* kind : {"cls", "obj", "bbox", "kps"})
      if (index_of(names, fmt::format("{}_{}", kind, stride)) >= 0) ++there;
    if (there == 4) out.push_back(stride);
    if (there > 0 && there < 4) return {};
  }
  return out;
}

std::vector<DecodedFace> decode_boxes(std::span<const std::string> names,
                                      std::span<const cv::Mat> outputs, cv::Size input,
                                      double threshold, double overlap) {
  TARSIER_REQUIRE(names.size() == outputs.size(), "{} names of {} outputs", names.size(),
                  outputs.size());
  std::vector<DecodedFace> found;
  for (const int stride : strides_of(names)) {
    const int columns = input.width / stride;
    const int rows = input.height / stride;
    const auto numbers = [&](const char* kind, std::size_t each) {
      const std::string name = fmt::format("{}_{}", kind, stride);
      const cv::Mat& output = outputs[static_cast<std::size_t>(index_of(names, name))];
      const std::size_t expected =
          static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows) * each;
      TARSIER_REQUIRE(
          output.type() == CV_32F && output.isContinuous() && output.total() == expected,
          "'{}' has {} numbers in place of {}", name, output.total(), expected);
      return output.ptr<float>();
    };
    const float* cls = numbers("cls", 1);
    const float* obj = numbers("obj", 1);
    const float* bbox = numbers("bbox", 4);
    const float* kps = numbers("kps", 10);
    for (int y = 0; y < rows; ++y) {
      for (int x = 0; x < columns; ++x) {
        const std::ptrdiff_t i = static_cast<std::ptrdiff_t>(y) * columns + x;
        DecodedFace face;
        face.score = std::sqrt(std::clamp<double>(cls[i], 0, 1) * std::clamp<double>(obj[i], 0, 1));
        if (!(face.score >= threshold)) continue;
        const double width = std::exp(static_cast<double>(bbox[4 * i + 2])) * stride;
        const double height = std::exp(static_cast<double>(bbox[4 * i + 3])) * stride;
        face.box = {(static_cast<double>(x) + bbox[4 * i]) * stride - width / 2,
                    (static_cast<double>(y) + bbox[4 * i + 1]) * stride - height / 2, width,
                    height};
        for (std::size_t k = 0; k < face.points.size(); ++k) {
          const auto at = 10 * i + 2 * static_cast<std::ptrdiff_t>(k);
          face.points[k] = {(static_cast<double>(x) + kps[at]) * stride,
                            (static_cast<double>(y) + kps[at + 1]) * stride};
        }
        if (is_finite(face)) found.push_back(face);
      }
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const DecodedFace& a, const DecodedFace& b) { return a.score > b.score; });
  if (found.size() > kMaxCandidates) found.resize(kMaxCandidates);
  std::vector<DecodedFace> out;
  for (const DecodedFace& face : found) {
    const bool hidden = std::any_of(out.begin(), out.end(), [&](const DecodedFace& better) {
      return iou(face.box, better.box) > overlap;
    });
    if (!hidden) out.push_back(face);
  }
  return out;
}

cv::Rect2d square_of_points(const std::array<cv::Point2d, 5>& points) {
  constexpr double kWidth = 2.4;  // in eye distances, as in people/face_reader.cpp
  constexpr double kDown = 0.12;  // of the square's centre below the eyes, share of its width
  constexpr double kEyesToMouth = 1.15;  // of a frontal face, in eye distances
  const cv::Point2d eyes = 0.5 * (points[0] + points[1]);
  const cv::Point2d mouth = 0.5 * (points[3] + points[4]);
  const double eye_distance =
      std::max(cv::norm(points[1] - points[0]), cv::norm(mouth - eyes) / kEyesToMouth);
  const double width = kWidth * eye_distance;
  return {eyes.x - width / 2, eyes.y - (0.5 - kDown) * width, width, width};
}

}  // namespace tarsier::face::onnx
