// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/networks.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::plate {
namespace {

// Weighted mean of quads that belong to the same plate.
struct Cluster {
  Quad sum{};
  float weight = 0;
  float best_score = 0;
  Quad best_corners{};
  [[nodiscard]] Quad mean() const {
    Quad quad;
    for (std::size_t i = 0; i < 4; ++i) quad[i] = sum[i] * (1 / weight);
    return quad;
  }
};

// A cell that may belong to a plate that is too small for its level.
struct Hint {
  cv::Point2f at;  // px of the image
  float score;     // log odds
};

// Searches `part` of the image, resized to `size`. Cells of at least `min_logit` that are not
// detections become hints.
void detect_level(const cv::Mat& gray, const cv::Rect& part, cv::Size size,
                  const linalg::Network& network, const DetectorOptions& options,
                  linalg::Workspace& workspace, std::vector<Detection>& detections,
                  std::vector<Hint>* hints = nullptr) {
  cv::Mat level;
  cv::resize(gray(part), level, size, 0, 0, cv::INTER_AREA);
  const double scale_x = static_cast<double>(part.width) / size.width;
  const double scale_y = static_cast<double>(part.height) / size.height;
  const auto in_image = [&](cv::Point2f p) {
    return cv::Point2f(static_cast<float>(part.x + (p.x + 0.5) * scale_x - 0.5),
                       static_cast<float>(part.y + (p.y + 0.5) * scale_y - 0.5));
  };
  const cv::Mat contrast = local_contrast(level);
  const linalg::Shape shape{1, contrast.rows, contrast.cols};
  const std::vector<float>& output =
      linalg::run(network, contrast.ptr<float>(), shape, workspace, options.parallel);
  const linalg::Shape map = workspace.shapes.back();
  const std::size_t plane =
      static_cast<std::size_t>(map.height) * static_cast<std::size_t>(map.width);
  const float min_logit = std::log(options.threshold / (1 - options.threshold));
  const float min_hint = std::log(options.hint / (1 - options.hint));
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                             static_cast<std::size_t>(x);
      const cv::Point2f centre((static_cast<float>(x) + 0.5F) * kCellSize - 0.5F,
                               (static_cast<float>(y) + 0.5F) * kCellSize - 0.5F);
      if (hints != nullptr && output[at] >= min_hint)
        hints->push_back({in_image(centre), output[at]});
      if (output[at] < min_logit) continue;
      Detection detection;
      detection.score = logistic(output[at]);
      for (std::size_t i = 0; i < 4; ++i) {
        detection.corners[i] = in_image(centre + cv::Point2f(output[plane * (1 + 2 * i) + at],
                                                             output[plane * (2 + 2 * i) + at]) *
                                                     kCornerUnit);
      }
      if (is_convex(detection.corners, 40)) detections.push_back(detection);
    }
  }
}

// Searches around the best hints at a scale at which small plates are large enough. A hint inside a
// detection of at least `min_width` px is ignored.
void search_tiles(const cv::Mat& gray, std::vector<Hint> hints, const linalg::Network& network,
                  const DetectorOptions& options, linalg::Workspace& workspace, float min_width,
                  std::vector<Detection>& detections) {
  constexpr int kTileColumns = 24;  // cells of a tile: the network's receptive field
  constexpr int kTileRows = 14;
  const double scale = std::min(1.0, static_cast<double>(kMinPlateWidth) / options.small_plate);
  const cv::Size size(static_cast<int>(std::lround(kTileColumns * kCellSize / scale)),
                      static_cast<int>(std::lround(kTileRows * kCellSize / scale)));
  if (size.width > gray.cols || size.height > gray.rows) return;
  std::stable_sort(hints.begin(), hints.end(),
                   [](const Hint& a, const Hint& b) { return a.score > b.score; });
  std::vector<cv::Rect> tiles;
  const std::size_t known = detections.size();
  for (const Hint& hint : hints) {
    const bool explained =
        std::any_of(detections.begin(), detections.begin() + static_cast<std::ptrdiff_t>(known),
                    [&](const Detection& plate) {
                      return mean_width(plate.corners) >= min_width &&
                             cv::Rect2f(plate.corners[0], plate.corners[2]).contains(hint.at);
                    });
    if (explained) continue;
    const bool is_covered = std::any_of(tiles.begin(), tiles.end(), [&](const cv::Rect& tile) {
      const auto center = cv::Point2f(tile.tl() + tile.br()) * 0.5F;
      return std::abs(hint.at.x - center.x) < 0.25F * static_cast<float>(tile.width) &&
             std::abs(hint.at.y - center.y) < 0.25F * static_cast<float>(tile.height);
    });
    if (is_covered) continue;
    if (static_cast<int>(tiles.size()) >= options.max_tiles) break;
    tiles.emplace_back(std::clamp(cvRound(hint.at.x) - size.width / 2, 0, gray.cols - size.width),
                       std::clamp(cvRound(hint.at.y) - size.height / 2, 0, gray.rows - size.height),
                       size.width, size.height);
    detect_level(gray, tiles.back(), {kTileColumns * kCellSize, kTileRows * kCellSize}, network,
                 options, workspace, detections);
  }
}

}  // namespace

linalg::Network detector_network() {
  linalg::Network network;
  network.layers = {linalg::convolution(1, 10, 5, 5),  linalg::convolution(10, 20, 3, 3),
                    linalg::convolution(20, 32, 3, 3), linalg::convolution(32, 40, 3, 3),
                    linalg::convolution(40, 40, 3, 5), linalg::convolution(40, 40, 3, 5),
                    linalg::convolution(40, 48, 1, 1), linalg::convolution(48, 9, 1, 1, false)};
  for (const std::size_t i : {0U, 1U, 2U}) network.layers[i].stride = 2;
  network.layers[5].dilation = 2;
  network.layers[5].pad_y = 2;
  network.layers[5].pad_x = 4;
  return network;
}

cv::Mat local_contrast(const cv::Mat& gray) {
  constexpr int kWindow = 41;
  constexpr float kFloor = 10;
  cv::Mat value;
  gray.convertTo(value, CV_32F);
  cv::Mat mean;
  cv::Mat square;
  cv::boxFilter(value, mean, CV_32F, {kWindow, kWindow}, {-1, -1}, true, cv::BORDER_REFLECT_101);
  cv::sqrBoxFilter(value, square, CV_32F, {kWindow, kWindow}, {-1, -1}, true,
                   cv::BORDER_REFLECT_101);
  for (int y = 0; y < value.rows; ++y) {
    auto* v = value.ptr<float>(y);
    const auto* m = mean.ptr<float>(y);
    const auto* s = square.ptr<float>(y);
    for (int x = 0; x < value.cols; ++x) {
      const float deviation = std::sqrt(std::max(0.0F, s[x] - m[x] * m[x]));
      v[x] = (v[x] - m[x]) / (deviation + kFloor);
    }
  }
  return value;
}

std::vector<Detection> detect(const cv::Mat& gray, const linalg::Network& network,
                              const DetectorOptions& options, linalg::Workspace& workspace,
                              const cv::Rect& region) {
  options.check();
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "an image of type {}", gray.type());
  const cv::Rect whole(0, 0, gray.cols, gray.rows);
  const cv::Rect part = region.empty() ? whole : region & whole;
  if (part.empty()) return {};
  const double pixels = static_cast<double>(gray.cols) * gray.rows;
  const double finest = std::min(1.0, std::sqrt(options.max_pixels / pixels));
  const bool misses_small = options.small_plate * finest < static_cast<double>(kMinPlateWidth);
  std::vector<Detection> detections;
  std::vector<Hint> hints;
  for (double scale = finest;; scale /= 2) {
    // With whole cells, the network's padding hides nothing.
    const int width = static_cast<int>(std::lround(part.width * scale)) / kCellSize * kCellSize;
    const int height = static_cast<int>(std::lround(part.height * scale)) / kCellSize * kCellSize;
    const cv::Size size(std::max(width, 4 * kCellSize), std::max(height, 2 * kCellSize));
    detect_level(gray, part, size, network, options, workspace, detections,
                 misses_small && scale == finest ? &hints : nullptr);
    if (size.width / 2 < 64 || size.height / 2 < 24) break;
  }
  if (misses_small) {
    const auto min_width = static_cast<float>(kMinPlateWidth / finest);
    search_tiles(gray, std::move(hints), network, options, workspace, min_width, detections);
  }
  std::stable_sort(detections.begin(), detections.end(),
                   [](const Detection& a, const Detection& b) { return a.score > b.score; });
  std::vector<Cluster> clusters;
  for (const Detection& detection : detections) {
    Cluster* match = nullptr;
    for (Cluster& cluster : clusters) {
      if (box_iou(cluster.best_corners, detection.corners) > options.overlap) {
        match = &cluster;
        break;
      }
    }
    if (match == nullptr) {
      if (static_cast<int>(clusters.size()) >= options.max_detections) continue;
      clusters.push_back({});
      match = &clusters.back();
      match->best_score = detection.score;
      match->best_corners = detection.corners;
    }
    const float weight = detection.score * detection.score * detection.score;
    for (std::size_t i = 0; i < 4; ++i) match->sum[i] += detection.corners[i] * weight;
    match->weight += weight;
  }
  std::vector<Detection> result;
  result.reserve(clusters.size());
  for (const Cluster& cluster : clusters) result.push_back({cluster.mean(), cluster.best_score});
  return result;
}

Quad aligner_quad() { return quad_of({20, 11, 87, 25}); }

linalg::Network aligner_network() {
  linalg::Network network;
  network.layers = {linalg::convolution(1, 12, 3, 3),         linalg::maximum(12, 2, 2),
                    linalg::convolution(12, 24, 3, 3),        linalg::maximum(24, 2, 2),
                    linalg::convolution(24, 48, 3, 3),        linalg::maximum(48, 2, 2),
                    linalg::convolution(48, 64, 3, 3),        linalg::convolution(64, 128, 6, 16),
                    linalg::convolution(128, 18, 1, 1, false)};
  network.layers[7].pad_y = network.layers[7].pad_x = 0;
  return network;
}

void normalize(const cv::Mat& gray, std::vector<float>& values) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(gray, mean, deviation);
  const auto offset = static_cast<float>(mean[0]);
  const auto scale = static_cast<float>(1 / (deviation[0] + 4));
  values.resize(gray.total());
  std::size_t at = 0;
  for (int y = 0; y < gray.rows; ++y) {
    const std::uint8_t* row = gray.ptr(y);
    for (int x = 0; x < gray.cols; ++x)
      values[at++] = (static_cast<float>(row[x]) - offset) * scale;
  }
}

Alignment align(const cv::Mat& gray, const Quad& corners, const linalg::Network& network,
                linalg::Workspace& workspace) {
  const Quad canonical = aligner_quad();
  const cv::Mat window = sample(gray, corners, canonical, {kAlignWidth, kAlignHeight});
  std::vector<float> input;
  normalize(window, input);
  const std::vector<float>& out =
      linalg::run(network, input.data(), {1, kAlignHeight, kAlignWidth}, workspace);
  const cv::Matx33d image_from_window = map_between(canonical, corners);
  Alignment result;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto moved = [&](std::size_t at) {
      return transformed(image_from_window, canonical[i] + cv::Point2f(out[at] * kCornerUnit,
                                                                       out[at + 1] * kCornerUnit));
    };
    result.plate[i] = moved(2 * i);
    result.text[i] = moved(8 + 2 * i);
  }
  result.score = logistic(out[16]);
  result.two_rows = logistic(out[17]);
  return result;
}

linalg::Network line_network() {
  linalg::Network network;
  network.layers = {linalg::convolution(1, 16, 3, 3),
                    linalg::maximum(16, 2, 2),
                    linalg::convolution(16, 32, 3, 3),
                    linalg::maximum(32, 2, 2),
                    linalg::convolution(32, 64, 3, 3),
                    linalg::convolution(64, 64, 3, 3),
                    linalg::maximum(64, 2, 1),
                    linalg::convolution(64, 96, 3, 3),
                    linalg::convolution(96, 144, 4, 3),
                    linalg::convolution(144, 96, 1, 3),
                    linalg::convolution(96, kClasses, 1, 1, false)};
  network.layers[8].pad_y = 0;
  return network;
}

Quad line_quad(int width) {
  return quad_of({kLineMargin, kLineTop, static_cast<float>(width - 2 * kLineMargin),
                  static_cast<float>(kLineBottom - kLineTop)});
}

cv::Mat read_line(const cv::Mat& gray, const Quad& text, int width, const linalg::Network& network,
                  linalg::Workspace& workspace, cv::Mat* features) {
  const cv::Mat canvas = sample(gray, text, line_quad(width), {width, kLineHeight});
  std::vector<float> input;
  normalize(canvas, input);
  const std::vector<float>& out =
      linalg::run(network, input.data(), {1, kLineHeight, width}, workspace);
  const int columns = workspace.shapes.back().width;
  cv::Mat result(columns, kClasses, CV_32F);
  for (int t = 0; t < columns; ++t) {
    auto* row = result.ptr<float>(t);
    float top = out[static_cast<std::size_t>(t)];
    for (int c = 0; c < kClasses; ++c) {
      row[c] = out[static_cast<std::size_t>(c * columns + t)];
      top = std::max(top, row[c]);
    }
    float sum = 0;
    for (int c = 0; c < kClasses; ++c) sum += row[c] = std::exp(row[c] - top);
    for (int c = 0; c < kClasses; ++c) row[c] /= sum;
  }
  if (features != nullptr) {
    std::vector<float>& last = workspace.maps[workspace.maps.size() - 2];
    const int planes = static_cast<int>(last.size()) / columns;
    cv::transpose(cv::Mat(planes, columns, CV_32F, last.data()), *features);
  }
  return result;
}

}  // namespace tarsier::plate
