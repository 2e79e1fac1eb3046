// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/anchor_detector.h"

#include "tarsier/core/boxes.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/media/archive.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face {
namespace {

constexpr int kAnchorDetectorVersion = 1;
constexpr int kSeparable = 5;        // conv1 .. conv5
constexpr int kValuesPerBox = 5;     // of a box: dx, dy, width, height, face
constexpr float kLeakySlope = 0.1F;  // of the rectifiers
constexpr double kMaxLogScale = 4;   // logarithm: a box is at most e^4 times its anchor
constexpr int kMaxChannels = 4096;   // of a layer

// Mean colour of the network's training images: red, green, blue.
constexpr std::array<float, 3> kMeanRgb{117.001F, 114.697F, 97.404F};

// The network's anchor boxes, in cells.
struct Anchor {
  double width;
  double height;
};
constexpr std::array<Anchor, 5> kAnchors{{{1.603231, 2.094468},
                                          {6.041143, 7.080126},
                                          {2.882459, 3.518061},
                                          {4.266906, 5.178857},
                                          {9.041765, 10.66308}}};

// [v][u][in][out] to [out][in][v][u], for 1 x 1.
linalg::Layer mixing_layer(linalg::TensorReader& tensors, const std::string& filters,
                           const std::string& bias) {
  std::vector<std::int64_t> shape;
  const std::vector<float> from = tensors.take(filters, 4, shape);
  if (shape[0] != 1 || shape[1] != 1)
    throw ModelError(tensors.path(),
                     fmt::format("'{}' is of {} x {}, not 1 x 1", filters, shape[0], shape[1]));
  const auto in = static_cast<std::size_t>(shape[2]);
  const auto out = static_cast<std::size_t>(shape[3]);
  linalg::Layer layer =
      linalg::convolution(static_cast<int>(shape[2]), static_cast<int>(shape[3]), 1, 1, false);
  for (std::size_t o = 0; o < out; ++o)
    for (std::size_t i = 0; i < in; ++i) layer.weights[o * in + i] = from[i * out + o];
  layer.bias = tensors.take_vector(bias, layer.out);
  return layer;
}

// The first layer for grey images. Values are 0..255 in the files and 0..1 for the network.
linalg::Layer grey_layer(linalg::TensorReader& tensors) {
  std::vector<std::int64_t> shape;
  const std::vector<float> from = tensors.take("conv0/filters", 4, shape);
  if (shape[0] != 3 || shape[1] != 3 || shape[2] != 3)
    throw ModelError(tensors.path(),
                     fmt::format("'conv0/filters' is of {} x {} x {}, not 3 x 3 x 3", shape[0],
                                 shape[1], shape[2]));
  const auto out = static_cast<std::size_t>(shape[3]);
  linalg::Layer layer = linalg::convolution(1, static_cast<int>(shape[3]), 3, 3, false);
  layer.pad_x = layer.pad_y = 0;
  layer.bias = tensors.take_vector("conv0/bias", layer.out);
  for (std::size_t o = 0; o < out; ++o)
    for (std::size_t tap = 0; tap < 9; ++tap)
      for (std::size_t c = 0; c < 3; ++c) {
        const float weight = from[(tap * 3 + c) * out + o];
        layer.weights[o * 9 + tap] += weight;
        layer.bias[o] -= weight * kMeanRgb[c] / 255.0F;
      }
  return layer;
}

std::vector<float> depthwise_weights(linalg::TensorReader& tensors, const std::string& name,
                                     int channels) {
  std::vector<std::int64_t> shape;
  const std::vector<float> from = tensors.take(name, 4, shape);
  if (shape[0] != 3 || shape[1] != 3 || shape[2] != channels || shape[3] != 1)
    throw ModelError(tensors.path(),
                     fmt::format("'{}' is of {} x {} x {} x {}, not 3 x 3 x {} x 1", name, shape[0],
                                 shape[1], shape[2], shape[3], channels));
  const auto count = static_cast<std::size_t>(channels);
  std::vector<float> out(from.size());
  for (std::size_t tap = 0; tap < 9; ++tap)
    for (std::size_t c = 0; c < count; ++c) out[c * 9 + tap] = from[tap * count + c];
  return out;
}

}  // namespace

void AnchorSearchOptions::check() const { check_fields(*this); }

bool has_anchor_tensors(const linalg::NamedTensors& tensors) {
  return std::any_of(tensors.begin(), tensors.end(), [](const linalg::NamedTensor& tensor) {
    return tensor.name == "conv1/depthwise_filter";
  });
}

AnchorDetector build_anchor_detector(const linalg::NamedTensors& weights, const std::string& path) {
  linalg::TensorReader tensors(weights, path);
  AnchorDetector detector;
  std::vector<linalg::SeparableStage>& stages = detector.network.stages;
  stages.push_back({{}, grey_layer(tensors), kLeakySlope, 2});
  for (int i = 1; i <= kSeparable; ++i) {
    const std::string name = fmt::format("conv{}", i);
    linalg::SeparableStage stage;
    stage.mix = mixing_layer(tensors, name + "/pointwise_filter", name + "/bias");
    stage.depthwise = depthwise_weights(tensors, name + "/depthwise_filter", stage.mix.in);
    stage.slope = kLeakySlope;
    stage.pool = i < kSeparable ? 2 : 1;
    stages.push_back(std::move(stage));
  }
  stages.push_back({{}, mixing_layer(tensors, "conv8/filters", "conv8/bias"), 1, 0});
  if (!tensors.all_used()) throw ModelError(path, "holds tensors that belong to no layer");
  constexpr int kOutputs = static_cast<int>(kAnchors.size()) * kValuesPerBox;
  if (stages.back().mix.out != kOutputs)
    throw ModelError(path,
                     fmt::format("{} numbers a cell, not {}", stages.back().mix.out, kOutputs));
  try {
    detector.network.check();
    (void)detector.network.output({1, 96, 96});
  } catch (const std::invalid_argument& error) {
    throw ModelError(path, error.what());
  }
  static_assert(kMaxChannels >= kOutputs);
  return detector;
}

void write_anchor_detector(const std::string& path, const linalg::NamedTensors& tensors,
                           const nlohmann::json& provenance) {
  write_archive(path, {std::string(kAnchorDetectorType),
                       kAnchorDetectorVersion,
                       provenance,
                       {{"tensors", linalg::tensors_to_json(tensors)}}});
}

AnchorDetector read_anchor_detector(const std::string& path) {
  const Archive archive =
      read_archive(path, std::string(kAnchorDetectorType), kAnchorDetectorVersion);
  return build_anchor_detector(linalg::tensors_from_json(archive.payload, "tensors", path), path);
}

std::vector<ScoredFace> search_anchors(const cv::Mat& gray, const AnchorDetector& detector,
                                       const AnchorSearchOptions& options,
                                       AnchorWorkspace& workspace) {
  require_gray(gray);
  options.check();
  const double longer = std::max(gray.cols, gray.rows) * (1 + 2 * options.margin);
  const double scale = options.side / longer;
  const int left = cvRound(options.margin * options.side / (1 + 2 * options.margin));
  // The rest of the square on the right and below is black, as in the network's training.
  const cv::Size size(std::clamp(cvRound(gray.cols * scale), 1, options.side - left),
                      std::clamp(cvRound(gray.rows * scale), 1, options.side - left));
  cv::resize(gray, workspace.scaled, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const auto side = static_cast<std::size_t>(options.side);
  workspace.input.assign(side * side, 0);
  for (int y = 0; y < size.height; ++y) {
    const auto* row = workspace.scaled.ptr<unsigned char>(y);
    float* out = workspace.input.data() + static_cast<std::size_t>(y + left) * side +
                 static_cast<std::size_t>(left);
    for (int x = 0; x < size.width; ++x) out[x] = static_cast<float>(row[x]) * (1 / 255.0F);
  }
  const linalg::Shape input{1, options.side, options.side};
  const linalg::Shape cells = detector.network.output(input);
  const std::vector<float>& map =
      linalg::run(detector.network, workspace.input.data(), input, workspace.network);

  const auto plane = static_cast<std::size_t>(cells.height) * static_cast<std::size_t>(cells.width);
  const double cell = static_cast<double>(options.side) / cells.width;
  std::vector<ScoredFace> found;
  for (int y = 0; y < cells.height; ++y) {
    for (int x = 0; x < cells.width; ++x) {
      const float* at = map.data() + static_cast<std::ptrdiff_t>(y) * cells.width + x;
      for (std::size_t a = 0; a < kAnchors.size(); ++a) {
        const auto number = [&](std::size_t k) {
          return static_cast<double>(at[(a * kValuesPerBox + k) * plane]);
        };
        const double score = logistic(number(4));
        if (!(score >= options.threshold)) continue;
        const double width = std::exp(std::min(kMaxLogScale, number(2))) * kAnchors[a].width * cell;
        const double height =
            std::exp(std::min(kMaxLogScale, number(3))) * kAnchors[a].height * cell;
        const double middle_x = (x + logistic(number(0))) * cell - left;
        const double middle_y = (y + logistic(number(1))) * cell - left;
        found.push_back({{(middle_x - width / 2) / scale, (middle_y - height / 2) / scale,
                          width / scale, height / scale},
                         score});
      }
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const ScoredFace& a, const ScoredFace& b) { return a.score > b.score; });
  std::vector<ScoredFace> kept;
  for (const ScoredFace& face : found) {
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const ScoredFace& better) {
      return iou(better.box, face.box) > options.overlap;
    });
    if (!known) kept.push_back(face);
  }
  return kept;
}

cv::Rect2d cascade_square(const cv::Rect2d& box) {
  // Medians over the faces of faces68 that both detectors find.
  constexpr double kWidth = 1.0;
  constexpr double kCenterShift = -0.136;
  const double width = kWidth * std::sqrt(box.width * box.height);
  const double x = box.x + box.width / 2;
  const double y = box.y + box.height / 2 + kCenterShift * width;
  return {x - width / 2, y - width / 2, width, width};
}

}  // namespace tarsier::face
