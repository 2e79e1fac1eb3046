// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/face_networks.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>

namespace tarsier::face {
namespace {

// px; the border of a level is replicated by this, so that faces may touch its edge.
constexpr int kBorder = 8;
constexpr int kContrastReach = 8;    // 2 x 2 blocks on each side: 34 px, about twice a face
constexpr float kContrastFloor = 8;  // grey values
// Of the first network; later stages cannot recover its misses.
constexpr double kScanThreshold = 0.1;
constexpr std::size_t kMaxCandidatesPerLevel =
    3000;                                  // candidates per level: bounds the work for any image
constexpr double kRefineThreshold = 0.15;  // of the second
constexpr double kMinMirrorLogit = -3;     // logit of the third
constexpr double kDeviationFloor = 4;      // grey values, of a window
// Windows evaluated at once: they fit into the second-level cache.
constexpr std::size_t kBatchSize = 16;

bool is_same_face(const cv::Rect2d& a, const cv::Rect2d& b, double overlap) {
  const double width = std::min(a.x + a.width, b.x + b.width) - std::max(a.x, b.x);
  if (width <= 0) return false;
  const double height = std::min(a.y + a.height, b.y + b.height) - std::max(a.y, b.y);
  if (height <= 0) return false;
  const double common = width * height;
  const double all = a.area() + b.area() - common;
  return common > overlap * std::max(1e-9, all) ||
         common > 0.75 * std::max(1e-9, std::min(a.area(), b.area()));
}

// Cuts the content of a box as a network's input: form.side x form.side values, bilinear.
void cut_window(const std::vector<cv::Mat>& halves, const cv::Rect2d& box, FaceWindow form,
                float* window) {
  constexpr int kMaxSide = 64;
  const double scale = form.box / box.width;
  const int level = half_for(scale, halves.size());
  const cv::Mat& source = halves[static_cast<std::size_t>(level)];
  const double unit = std::ldexp(1.0, level);  // px of the image per px of this half
  const double step = 1 / (scale * unit);
  // Pixel centres: the window's (u + 0.5) * step + left - 0.5.
  const double x0 = (box.x + box.width / 2) / unit - 0.5 * (form.side - 1) * step - 0.5;
  const double y0 = (box.y + box.height / 2) / unit - 0.5 * (form.side - 1) * step - 0.5;
  // Outside the image, the border is replicated.
  const auto between = [&](double at, int count, int& low, int& high, float& share) {
    const double inside = std::clamp(at, 0.0, count - 1.0);
    low = static_cast<int>(inside);
    high = std::min(low + 1, count - 1);
    share = static_cast<float>(inside - low);
  };
  int left[kMaxSide];
  int right[kMaxSide];
  float share_x[kMaxSide];
  for (int u = 0; u < form.side; ++u) {
    between(x0 + u * step, source.cols, left[u], right[u], share_x[u]);
  }
  for (int v = 0; v < form.side; ++v) {
    int above = 0;
    int below = 0;
    float share_y = 0;
    between(y0 + v * step, source.rows, above, below, share_y);
    const std::uint8_t* upper = source.ptr(above);
    const std::uint8_t* lower = source.ptr(below);
    for (int u = 0; u < form.side; ++u) {
      const auto l = static_cast<std::size_t>(left[u]);
      const auto r = static_cast<std::size_t>(right[u]);
      const auto top =
          static_cast<float>(upper[l]) + share_x[u] * static_cast<float>(upper[r] - upper[l]);
      const auto bottom =
          static_cast<float>(lower[l]) + share_x[u] * static_cast<float>(lower[r] - lower[l]);
      *window++ = top + share_y * (bottom - top);
    }
  }
}

// The input of a window network: mean 0 and deviation 1, in four planes that are `stride` elements
// apart. `flipped`: mirrored.
void normalize_window(const float* window, int side, bool flipped, float* planes,
                      std::size_t stride) {
  double sums[4] = {};
  double squares[4] = {};
  for (int i = 0; i < side * side; i += 4) {  // independent chains of additions
    for (int k = 0; k < 4; ++k) {
      const auto value = static_cast<double>(window[i + k]);
      sums[k] += value;
      squares[k] += value * value;
    }
  }
  const double count = side * side;
  const double mean = (sums[0] + sums[1] + sums[2] + sums[3]) / count;
  const double square = (squares[0] + squares[1] + squares[2] + squares[3]) / count;
  const auto offset = static_cast<float>(mean);
  const auto scale =
      static_cast<float>(1 / (std::sqrt(std::max(0.0, square - mean * mean)) + kDeviationFloor));
  const int half = side / 2;
  for (int y = 0; y < side; ++y) {
    const float* row = window + y * side;
    float* even = planes + static_cast<std::size_t>(y % 2 * 2) * stride + y / 2 * half;
    float* odd = even + stride;
    if (flipped) {
      for (int x = 0; x < half; ++x) {
        even[x] = (row[side - 1 - 2 * x] - offset) * scale;
        odd[x] = (row[side - 2 - 2 * x] - offset) * scale;
      }
    } else {
      for (int x = 0; x < half; ++x) {
        even[x] = (row[2 * x] - offset) * scale;
        odd[x] = (row[2 * x + 1] - offset) * scale;
      }
    }
  }
}

struct WindowOutput {
  double logit = 0;
  cv::Rect2d box;
};

// A network's output for windows: four numbers for each, for the unchanged or the mirrored window.
void run_windows(const linalg::Network& network, FaceWindow form,
                 const std::vector<const float*>& windows, bool flipped,
                 FaceSearchWorkspace& workspace, std::vector<std::array<double, 4>>& outputs) {
  const std::size_t plane =
      static_cast<std::size_t>(form.side) / 2 * static_cast<std::size_t>(form.side) / 2;
  outputs.clear();
  for (std::size_t first = 0; first < windows.size(); first += kBatchSize) {
    const std::size_t count = std::min(kBatchSize, windows.size() - first);
    workspace.input.resize(4 * count * plane);
    for (std::size_t i = 0; i < count; ++i) {
      normalize_window(windows[first + i], form.side, flipped, workspace.input.data() + i * plane,
                       count * plane);
    }
    const std::vector<float>& out =
        linalg::run_stack(network, workspace.input.data(), {4, form.side / 2, form.side / 2},
                          static_cast<int>(count), workspace.stack);
    for (std::size_t i = 0; i < count; ++i) {
      std::array<double, 4> output{};
      for (std::size_t k = 0; k < 4; ++k) output[k] = static_cast<double>(out[k * count + i]);
      if (flipped) output[1] = -output[1];
      outputs.push_back(output);
    }
  }
}

// The network's output for the boxes. With `both`, the mean with the output for the mirror image,
// unless the first output is clearly negative.
std::vector<WindowOutput> evaluate_boxes(const std::vector<ScoredFace>& boxes,
                                         const linalg::Network& network, FaceWindow form, bool both,
                                         FaceSearchWorkspace& workspace) {
  const std::size_t size =
      static_cast<std::size_t>(form.side) * static_cast<std::size_t>(form.side);
  workspace.windows.resize(boxes.size() * size);
  std::vector<const float*> windows;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    float* window = workspace.windows.data() + i * size;
    cut_window(workspace.halves, boxes[i].box, form, window);
    windows.push_back(window);
  }
  std::vector<std::array<double, 4>> outputs;
  run_windows(network, form, windows, false, workspace, outputs);
  if (both) {
    std::vector<std::size_t> again;
    std::vector<const float*> mirrored;
    for (std::size_t i = 0; i < boxes.size(); ++i) {
      if (outputs[i][0] < kMinMirrorLogit) continue;
      again.push_back(i);
      mirrored.push_back(windows[i]);
    }
    std::vector<std::array<double, 4>> others;
    run_windows(network, form, mirrored, true, workspace, others);
    for (std::size_t j = 0; j < again.size(); ++j) {
      for (std::size_t k = 0; k < 4; ++k) {
        outputs[again[j]][k] = 0.5 * (outputs[again[j]][k] + others[j][k]);
      }
    }
  }
  std::vector<WindowOutput> result;
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const cv::Rect2d& box = boxes[i].box;
    const std::array<double, 4>& output = outputs[i];
    const double width = box.width * std::exp(std::clamp(output[3], -0.5, 0.5));
    const double x = box.x + box.width / 2 + std::clamp(output[1], -0.5, 0.5) * box.width;
    const double y = box.y + box.height / 2 + std::clamp(output[2], -0.5, 0.5) * box.width;
    result.push_back({output[0], {x - width / 2, y - width / 2, width, width}});
  }
  return result;
}

// Width of the largest face to search for, which sets the smallest scale of a level.
double largest_face(const cv::Mat& gray, const FaceSearchOptions& options) {
  const double fits = 1.1 * std::min(gray.cols, gray.rows);
  return options.max_face > 0 ? std::min(options.max_face, fits) : fits;
}

void scan_level(const cv::Mat& gray, double scale, const FaceNetworks& networks,
                FaceSearchWorkspace& workspace, std::vector<ScoredFace>& found) {
  const int half = half_for(scale, workspace.halves.size());
  const cv::Mat& source = workspace.halves[static_cast<std::size_t>(half)];
  const cv::Size size(std::max(4, cvRound(gray.cols * scale)),
                      std::max(4, cvRound(gray.rows * scale)));
  cv::Mat& level = workspace.level;
  cv::resize(source, level, size, 0, 0, cv::INTER_LINEAR);
  const auto whole = [](int side) { return (side + kScanCell - 1) / kScanCell * kScanCell; };
  cv::copyMakeBorder(level, level, kBorder, whole(size.height) - size.height + kBorder, kBorder,
                     whole(size.width) - size.width + kBorder, cv::BORDER_REPLICATE);
  scan_input(level, workspace, workspace.input);
  workspace.pixels += static_cast<std::int64_t>(level.total());
  const linalg::Shape input{4, level.rows / 2, level.cols / 2};
  const std::vector<float>& out =
      linalg::run_stack(networks.scan, workspace.input.data(), input, 1, workspace.stack);
  const linalg::Shape map = networks.scan.output(input);
  const auto plane = static_cast<std::size_t>(map.height) * static_cast<std::size_t>(map.width);
  const auto min_logit = static_cast<float>(std::log(kScanThreshold / (1 - kScanThreshold)));
  const double sx = static_cast<double>(gray.cols) / size.width;
  const double sy = static_cast<double>(gray.rows) / size.height;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                             static_cast<std::size_t>(x);
      if (out[at] < min_logit) continue;
      const auto value = [&](std::size_t k) { return static_cast<double>(out[k * plane + at]); };
      const double width = kScanFace * std::exp(std::clamp(value(3), -0.7, 0.7));
      const double middle_x = (x + 0.5) * kScanCell - kBorder + value(1) * kScanFace;
      const double middle_y = (y + 0.5) * kScanCell - kBorder + value(2) * kScanFace;
      found.push_back(
          {{(middle_x - width / 2) * sx, (middle_y - width / 2) * sy, width * sx, width * sx},
           logistic(value(0))});
    }
  }
}

}  // namespace

linalg::Network scan_network() {
  linalg::Network network;
  network.layers = {linalg::convolution(4, 8, 3, 3),   linalg::maximum(8, 2, 2),
                    linalg::convolution(8, 16, 3, 3),  linalg::convolution(16, 16, 3, 3),
                    linalg::convolution(16, 24, 3, 3), linalg::convolution(24, 4, 1, 1, false)};
  return network;
}

linalg::Network refine_network() {
  linalg::Network network;
  network.layers = {linalg::convolution(4, 12, 3, 3),
                    linalg::maximum(12, 2, 2),
                    linalg::convolution(12, 24, 3, 3),
                    linalg::convolution(24, 24, 3, 3),
                    linalg::maximum(24, 2, 2),
                    linalg::convolution(24, 48, 5, 5),
                    linalg::convolution(48, 4, 1, 1, false)};
  network.layers[5].pad_y = network.layers[5].pad_x = 0;
  return network;
}

linalg::Network verify_network() {
  linalg::Network network;
  network.layers = {linalg::convolution(4, 16, 3, 3),  linalg::maximum(16, 2, 2),
                    linalg::convolution(16, 32, 3, 3), linalg::convolution(32, 40, 3, 3),
                    linalg::maximum(40, 2, 2),         linalg::convolution(40, 64, 3, 3),
                    linalg::convolution(64, 64, 7, 7), linalg::convolution(64, 4, 1, 1, false)};
  network.layers[6].pad_y = network.layers[6].pad_x = 0;
  return network;
}

void FaceNetworks::require() const {
  scan.check();
  refine.check();
  verify.check();
  TARSIER_REQUIRE(linalg::can_stack(scan) && linalg::can_stack(refine) && linalg::can_stack(verify),
                  "a network has a convolution of another stride than 1");
  constexpr linalg::Shape kScanned{4, 32, 48};
  TARSIER_REQUIRE((scan.output(kScanned) == linalg::Shape{4, 16, 24}),
                  "the first network does not give 4 numbers for each {} px", kScanCell);
  TARSIER_REQUIRE(scan.cost(kScanned) < 1e8, "the first network is too large");
  const auto require_window = [](const linalg::Network& network, FaceWindow form,
                                 const char* name) {
    const linalg::Shape input{4, form.side / 2, form.side / 2};
    TARSIER_REQUIRE((network.output(input) == linalg::Shape{4, 1, 1}),
                    "the {} network does not give 4 numbers", name);
    TARSIER_REQUIRE(network.cost(input) < 1e8, "the {} network is too large", name);
  };
  require_window(refine, kRefineWindow, "second");
  require_window(verify, kVerifyWindow, "third");
  TARSIER_REQUIRE(likely_score > 0 && likely_score <= confident_score && confident_score < 1,
                  "scores {} and {}", likely_score, confident_score);
}

void FaceSearchOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(max_face == 0 || (max_face >= min_face && std::isfinite(max_face)),
                  "the largest face of {} px is below the smallest, {} px", max_face, min_face);
}

void make_halves(const cv::Mat& gray, double smallest_scale, std::vector<cv::Mat>& halves) {
  std::size_t count = 1;
  for (double scale = 0.5; scale >= smallest_scale; scale /= 2) ++count;
  halves.resize(count);
  halves[0] = gray;
  for (std::size_t i = 1; i < count; ++i) {
    const cv::Mat& from = halves[i - 1];
    // All levels need whole blocks at the same positions; an odd last row is duplicated.
    cv::Mat even = from;
    if (from.cols % 2 != 0 || from.rows % 2 != 0) {
      cv::copyMakeBorder(from, even, 0, from.rows % 2, 0, from.cols % 2, cv::BORDER_REPLICATE);
    }
    cv::Mat to;
    cv::resize(even, to, cv::Size(even.cols / 2, even.rows / 2), 0, 0, cv::INTER_AREA);
    halves[i] = to;
  }
}

int half_for(double scale, std::size_t count) {
  int level = 0;
  while (scale <= 0.5 && level + 1 < static_cast<int>(count)) {
    scale *= 2;
    ++level;
  }
  return level;
}

void scan_input(const cv::Mat& gray, FaceSearchWorkspace& workspace, std::vector<float>& input) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && gray.rows % 2 == 0 && gray.cols % 2 == 0,
                  "an image of type {}, {}x{}", gray.type(), gray.cols, gray.rows);
  const int rows = gray.rows / 2;  // of blocks
  const int cols = gray.cols / 2;
  const auto width = static_cast<std::size_t>(cols);
  // Sums of the values and of their squares: first of each block, then of the columns of blocks
  // around a row, then of the blocks around a block.
  workspace.sums.create(rows, cols, CV_32S);
  workspace.squares.create(rows, cols, CV_32S);
  for (int y = 0; y < rows; ++y) {
    const std::uint8_t* upper = gray.ptr(2 * y);
    const std::uint8_t* lower = gray.ptr(2 * y + 1);
    auto* sum = workspace.sums.ptr<std::int32_t>(y);
    auto* square = workspace.squares.ptr<std::int32_t>(y);
    for (int x = 0; x < cols; ++x) {
      const int a = upper[2 * x];
      const int b = upper[2 * x + 1];
      const int c = lower[2 * x];
      const int d = lower[2 * x + 1];
      sum[x] = a + b + c + d;
      square[x] = a * a + b * b + c * c + d * d;
    }
  }
  constexpr int kReach = kContrastReach;
  constexpr float kShare = 1.0F / (4 * (2 * kReach + 1) * (2 * kReach + 1));
  const auto row_at = [&](const cv::Mat& of, int y) {
    return of.ptr<std::int32_t>(std::clamp(y, 0, rows - 1));
  };
  // Column sums, with the first and last one replicated on both sides.
  std::vector<std::int32_t>& columns = workspace.columns;
  columns.assign(2 * (width + 2 * kReach), 0);
  std::int32_t* sums = columns.data() + kReach;
  std::int32_t* squares = sums + width + 2 * kReach;
  for (int y = -kReach; y <= kReach; ++y) {
    for (int x = 0; x < cols; ++x) {
      sums[x] += row_at(workspace.sums, y)[x];
      squares[x] += row_at(workspace.squares, y)[x];
    }
  }
  std::vector<float>& local = workspace.local;  // mean and 1 / (deviation + floor) for a row
  local.resize(2 * width);
  float* mean = local.data();
  float* gain = mean + width;
  const std::size_t plane = static_cast<std::size_t>(rows) * width;
  input.resize(4 * plane);
  for (int y = 0; y < rows; ++y) {
    for (std::int32_t* of : {sums, squares}) {
      std::fill_n(of - kReach, kReach, of[0]);
      std::fill_n(of + cols, kReach, of[cols - 1]);
    }
    std::int32_t sum = 0;
    std::int32_t square = 0;
    for (int x = -kReach; x < kReach; ++x) {
      sum += sums[x];
      square += squares[x];
    }
    for (int x = 0; x < cols; ++x) {
      sum += sums[x + kReach];
      square += squares[x + kReach];
      mean[x] = static_cast<float>(sum);
      gain[x] = static_cast<float>(square);
      sum -= sums[x - kReach];
      square -= squares[x - kReach];
    }
    for (int x = 0; x < cols; ++x) {
      const float m = kShare * mean[x];
      const float variance = kShare * gain[x] - m * m;
      mean[x] = m;
      gain[x] = 1 / (std::sqrt(std::max(0.0F, variance)) + kContrastFloor);
    }
    for (int half = 0; half < 2; ++half) {
      const std::uint8_t* value = gray.ptr(2 * y + half);
      float* even = input.data() + static_cast<std::size_t>(2 * half) * plane +
                    static_cast<std::size_t>(y) * width;
      float* odd = even + plane;
      for (int x = 0; x < cols; ++x) {
        even[x] = (static_cast<float>(value[2 * x]) - mean[x]) * gain[x];
        odd[x] = (static_cast<float>(value[2 * x + 1]) - mean[x]) * gain[x];
      }
    }
    const std::int32_t* entering = row_at(workspace.sums, y + kReach + 1);
    const std::int32_t* leaving = row_at(workspace.sums, y - kReach);
    for (int x = 0; x < cols; ++x) sums[x] += entering[x] - leaving[x];
    entering = row_at(workspace.squares, y + kReach + 1);
    leaving = row_at(workspace.squares, y - kReach);
    for (int x = 0; x < cols; ++x) squares[x] += entering[x] - leaving[x];
  }
}

void window_input(const cv::Mat& window, std::vector<float>& input) {
  TARSIER_REQUIRE(window.type() == CV_8UC1 && window.rows == window.cols && window.rows % 2 == 0,
                  "a window of type {}, {}x{}", window.type(), window.cols, window.rows);
  cv::Mat values;
  window.convertTo(values, CV_32F);
  input.resize(values.total());
  normalize_window(values.ptr<float>(), window.rows, false, input.data(), values.total() / 4);
}

std::vector<ScoredFace> suppress_overlaps(std::vector<ScoredFace> faces, double overlap) {
  // The position breaks ties, so that the order is deterministic.
  std::sort(faces.begin(), faces.end(), [](const ScoredFace& a, const ScoredFace& b) {
    return std::tuple(-a.score, a.box.x, a.box.y, a.box.width) <
           std::tuple(-b.score, b.box.x, b.box.y, b.box.width);
  });
  if (faces.empty()) return faces;
  // A grid with cells as wide as the widest box: boxes that intersect are in the same or in
  // neighbouring cells.
  constexpr int kMaxCells = 256;
  double cell = 1;
  cv::Rect2d all = faces[0].box;
  for (const ScoredFace& face : faces) {
    cell = std::max({cell, face.box.width, face.box.height});
    all |= face.box;
  }
  cell = std::max({cell, all.width / kMaxCells, all.height / kMaxCells});
  const auto number = [&](double length) { return static_cast<int>(length / cell); };
  const int cols = number(all.width) + 1;
  const int rows = number(all.height) + 1;
  std::vector<std::vector<cv::Rect2d>> cells(static_cast<std::size_t>(cols) *
                                             static_cast<std::size_t>(rows));
  const auto cell_at = [&](int x, int y) -> std::vector<cv::Rect2d>& {
    return cells[static_cast<std::size_t>(y) * static_cast<std::size_t>(cols) +
                 static_cast<std::size_t>(x)];
  };
  std::vector<ScoredFace> kept;
  for (const ScoredFace& face : faces) {
    const int x = number(face.box.x - all.x);
    const int y = number(face.box.y - all.y);
    const auto is_known = [&] {
      for (int v = std::max(0, y - 1); v <= std::min(rows - 1, y + 1); ++v) {
        for (int u = std::max(0, x - 1); u <= std::min(cols - 1, x + 1); ++u) {
          for (const cv::Rect2d& better : cell_at(u, v)) {
            if (is_same_face(better, face.box, overlap)) return true;
          }
        }
      }
      return false;
    };
    if (is_known()) continue;
    cell_at(x, y).push_back(face.box);
    kept.push_back(face);
  }
  return kept;
}

std::vector<ScoredFace> scan_faces(const cv::Mat& gray, const FaceNetworks& networks,
                                   const FaceSearchOptions& options,
                                   FaceSearchWorkspace& workspace) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "an image of type {}", gray.type());
  options.check();
  const double largest = std::max(options.min_face, largest_face(gray, options));
  make_halves(gray, kScanFace / largest, workspace.halves);
  std::vector<ScoredFace> found;
  std::vector<ScoredFace> all;
  for (double face = options.min_face;; face *= kScanStep) {
    found.clear();
    scan_level(gray, kScanFace / face, networks, workspace, found);
    if (found.size() > kMaxCandidatesPerLevel) {
      std::stable_sort(found.begin(), found.end(),
                       [](const ScoredFace& a, const ScoredFace& b) { return a.score > b.score; });
      found.resize(kMaxCandidatesPerLevel);
    }
    // Within a level, several cells respond to the same face. A neighbouring level's box may be
    // better, so the overlap threshold is high.
    for (ScoredFace& candidate : suppress_overlaps(std::move(found), 0.6)) all.push_back(candidate);
    if (face * kScanStep >= largest) break;
  }
  std::vector<ScoredFace> candidates = suppress_overlaps(std::move(all), 0.65);
  if (candidates.size() > static_cast<std::size_t>(options.max_candidates)) {
    candidates.resize(static_cast<std::size_t>(options.max_candidates));
  }
  return candidates;
}

std::vector<ScoredFace> search_faces(const cv::Mat& gray, const FaceNetworks& networks,
                                     const FaceSearchOptions& options,
                                     FaceSearchWorkspace& workspace) {
  const std::vector<ScoredFace> candidates = scan_faces(gray, networks, options, workspace);
  const double min_score = options.threshold > 0 ? options.threshold : networks.likely_score;
  std::vector<ScoredFace> faces;
  // Several candidates may move to one face: the third network evaluates it once.
  std::vector<ScoredFace> refined;
  workspace.candidates += static_cast<std::int64_t>(candidates.size());
  for (const WindowOutput& first :
       evaluate_boxes(candidates, networks.refine, kRefineWindow, false, workspace)) {
    const double score = logistic(first.logit);
    if (score >= (options.with_verification ? kRefineThreshold : min_score))
      refined.push_back({first.box, score});
  }
  refined = suppress_overlaps(std::move(refined), 0.6);
  if (!options.with_verification) return refined;
  // At most a quarter of the candidates is passed to the third network.
  const auto max_refined = static_cast<std::size_t>(std::max(1, options.max_candidates / 4));
  if (refined.size() > max_refined) refined.resize(max_refined);
  workspace.verified += static_cast<std::int64_t>(refined.size());
  for (const WindowOutput& second :
       evaluate_boxes(refined, networks.verify, kVerifyWindow, true, workspace)) {
    const double score = logistic(second.logit);
    // Levels extend slightly below the requested size.
    if (score >= min_score && second.box.width >= 0.85 * options.min_face) {
      faces.push_back({second.box, score});
    }
  }
  return suppress_overlaps(std::move(faces));
}

}  // namespace tarsier::face
