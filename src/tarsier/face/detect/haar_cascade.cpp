// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/haar_cascade.h"

#include "tarsier/core/at.h"
#include "tarsier/core/best_kernels.h"
#include "tarsier/core/require.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numeric>

namespace tarsier::face {
namespace {

constexpr float kThresholdTolerance =
    1e-5F;                           // tolerance of a stage's threshold for rounding errors
constexpr float kMinDenseScale = 2;  // below this scale only every second window is evaluated
constexpr int kRowsAtOnce = 8;

// Row length for all scales, so that a rectangle has the same offset in all of them.
int stride_of(int width) { return (width + 1 + 2 * kHaarPadding + 63) / 64 * 64; }

cv::Size scaled(cv::Size size, float scale) {
  return {cvRound(static_cast<float>(size.width) * scale),
          cvRound(static_cast<float>(size.height) * scale)};
}

bool is_within(cv::Size a, cv::Size b) { return a.width <= b.width && a.height <= b.height; }

bool are_similar(const cv::Rect& a, const cv::Rect& b, double eps) {
  const double slack = 0.5 * eps * (std::min(a.width, b.width) + std::min(a.height, b.height));
  return std::abs(a.x - b.x) <= slack && std::abs(a.y - b.y) <= slack &&
         std::abs(a.br().x - b.br().x) <= slack && std::abs(a.br().y - b.br().y) <= slack;
}

// Reads the rectangles of a feature; false if the kernels do not support them.
bool read_feature(const cv::FileNode& from, std::array<cv::Rect, 3>& rects,
                  std::array<float, 3>& weights) {
  if (static_cast<int>(from["tilted"]) != 0) return false;
  const cv::FileNode all = from["rects"];
  if (all.size() < 2 || all.size() > 3) return false;
  std::size_t count = 0;
  for (const cv::FileNode& rect : all) {
    if (rect.size() != 5) return false;
    rects[count] = {static_cast<int>(rect[0]), static_cast<int>(rect[1]), static_cast<int>(rect[2]),
                    static_cast<int>(rect[3])};
    weights[count++] = static_cast<float>(rect[4]);
  }
  return true;
}

}  // namespace

std::optional<HaarCascade> HaarCascade::read(const std::string& path) {
  const cv::FileStorage file(path, cv::FileStorage::READ);
  if (!file.isOpened()) return std::nullopt;
  const cv::FileNode root = file["cascade"];
  if (!root.isMap() || static_cast<std::string>(root["stageType"]) != "BOOST" ||
      static_cast<std::string>(root["featureType"]) != "HAAR") {
    return std::nullopt;
  }
  HaarCascade result;
  result.window_ = {static_cast<int>(root["width"]), static_cast<int>(root["height"])};
  const cv::Rect whole({}, result.window_);
  if (result.window_.width < 4 || result.window_.height < 4 || result.window_.width > 512 ||
      result.window_.height > 512) {
    return std::nullopt;
  }
  std::vector<std::array<cv::Rect, 3>> rects;
  std::vector<std::array<float, 3>> weights;
  for (const cv::FileNode& feature : root["features"]) {
    if (!read_feature(feature, rects.emplace_back(), weights.emplace_back())) return std::nullopt;
    for (const cv::Rect& rect : rects.back())
      if (rect.width < 0 || rect.height < 0 || (rect & whole) != rect) return std::nullopt;
  }
  std::vector<HaarNode>& nodes = result.nodes_[0];
  for (const cv::FileNode& stage : root["stages"]) {
    const cv::FileNode weak = stage["weakClassifiers"];
    result.stages_.push_back({static_cast<std::int32_t>(result.trees_.size()),
                              static_cast<std::int32_t>(weak.size()),
                              static_cast<float>(stage["stageThreshold"]) - kThresholdTolerance});
    for (const cv::FileNode& tree : weak) {
      const cv::FileNode numbers =
          tree["internalNodes"];  // of each node: below, above, feature, threshold
      const cv::FileNode leaves = tree["leafValues"];
      const int count = static_cast<int>(numbers.size() / 4);
      if (count < 1 || count > kMaxHaarNodes || numbers.size() != 4 * at(count) ||
          leaves.size() != at(count) + 1) {
        return std::nullopt;
      }
      result.trees_.push_back({static_cast<std::int32_t>(nodes.size()), count});
      for (int k = 0; k < count; ++k) {
        const int below = static_cast<int>(numbers[4 * k]);
        const int above = static_cast<int>(numbers[4 * k + 1]);
        const int feature = static_cast<int>(numbers[4 * k + 2]);
        const auto is_child = [&](int child) {  // a later node, or a leaf
          return child > 0 ? child > k && child < count : -child <= count;
        };
        if (!is_child(below) || !is_child(above) || feature < 0 ||
            feature >= static_cast<int>(rects.size())) {
          return std::nullopt;
        }
        HaarNode& node = nodes.emplace_back();
        node.weights = weights[at(feature)];
        node.threshold = static_cast<float>(numbers[4 * k + 3]);
        node.below = std::max(below, 0);
        node.above = std::max(above, 0);
        if (below <= 0) node.below_value = static_cast<float>(leaves[-below]);
        if (above <= 0) node.above_value = static_cast<float>(leaves[-above]);
        result.rects_.push_back(rects[at(feature)]);
      }
    }
  }
  if (result.stages_.empty()) return std::nullopt;
  result.nodes_[1] = nodes;
  return result;
}

RectOffsets HaarCascade::offsets_of(const cv::Rect& rect, bool split) const {
  const auto offset_at = [&](int x, int y) {
    return y * stride_ + (split ? (x & 1) * (stride_ / 2) + x / 2 : x);
  };
  const cv::Point end = rect.br();
  return {offset_at(rect.x, rect.y), offset_at(end.x, rect.y), offset_at(rect.x, end.y),
          offset_at(end.x, end.y)};
}

void HaarCascade::lay_out(int stride) {
  if (stride == stride_) return;
  stride_ = stride;
  for (const bool split : {false, true}) {
    std::vector<HaarNode>& nodes = nodes_[split ? 1 : 0];
    for (std::size_t n = 0; n < nodes.size(); ++n)
      for (std::size_t r = 0; r < 3; ++r) nodes[n].rects[r] = offsets_of(rects_[n][r], split);
    inner_[split ? 1 : 0] = offsets_of({1, 1, window_.width - 2, window_.height - 2}, split);
  }
}

std::vector<float> HaarCascade::scales_between(cv::Size image, double step, cv::Size min,
                                               cv::Size max) const {
  std::vector<float> scales;
  float nearest = 0;
  double distance = 0;
  for (double factor = 1;; factor *= step) {
    const cv::Size exact(cvRound(window_.width * factor), cvRound(window_.height * factor));
    if (!is_within(exact, image)) break;
    const auto scale = static_cast<float>(factor);
    const cv::Size size = scaled(window_, scale);
    const double difference = std::hypot(min.width - size.width, min.height - size.height);
    if (nearest == 0 || difference < distance) {
      nearest = scale;
      distance = difference;
    }
    if (is_within(min, size) && is_within(size, max)) scales.push_back(scale);
  }
  if (scales.empty() && nearest > 0) scales.push_back(nearest);
  return scales;
}

void HaarCascade::prepare(const cv::Mat& gray, Level& level) const {
  const cv::Size size(cvRound(static_cast<float>(gray.cols) / level.scale),
                      cvRound(static_cast<float>(gray.rows) / level.scale));
  level.step = level.scale >= kMinDenseScale ? 1 : 2;
  const auto windows = [&](int pixels, int own) {
    return (std::max(pixels + 1 - own, 0) + level.step - 1) / level.step;
  };
  level.columns = windows(size.width, window_.width);
  level.rows = windows(size.height, window_.height);
  if (level.columns == 0 || level.rows == 0) return;
  cv::Mat small;
  cv::resize(gray, small, size, 1. / static_cast<double>(level.scale),
             1. / static_cast<double>(level.scale), cv::INTER_LINEAR_EXACT);
  // One extra row, because the kernels read beyond the last row.
  level.sum.create(size.height + 2, stride_);
  level.squares.create(size.height + 2, stride_);
  const cv::Rect inner(0, 0, size.width + 1, size.height + 1);
  if (level.step == 1) {
    cv::Mat sum = level.sum(inner);
    cv::Mat squares = level.squares(inner);
    cv::integral(small, sum, squares, CV_32S, CV_32S);
    return;
  }
  cv::Mat1i sum;
  cv::Mat1i squares;
  cv::integral(small, sum, squares, CV_32S, CV_32S);
  const auto split = [&](const cv::Mat1i& from, cv::Mat1i& to) {
    for (int y = 0; y < from.rows; ++y) {
      const int* in = from[y];
      int* even = to[y];
      int* odd = even + stride_ / 2;
      for (int x = 0; x + 1 < from.cols; x += 2) {
        even[x / 2] = in[x];
        odd[x / 2] = in[x + 1];
      }
      if (from.cols % 2 != 0) even[from.cols / 2] = in[from.cols - 1];
    }
  };
  split(sum, level.sum);
  split(squares, level.squares);
}

void HaarCascade::search_row(const Level& level, int row, std::vector<cv::Rect>& found) const {
  const HaarKernels& kernels = haar_kernels();
  const std::size_t layout = level.step == 1 ? 0 : 1;
  const int y = row * level.step;
  const int* sum = level.sum[y];
  thread_local std::vector<float> norms;
  thread_local std::vector<std::int32_t> windows;
  norms.resize(at(level.columns + kHaarPadding));
  windows.clear();
  const double area = (window_.width - 2) * (window_.height - 2);
  kernels.norms(sum, level.squares[y], inner_[layout], area, level.columns, norms.data());
  for (int i = 0; i < level.columns; ++i)
    if (norms[at(i)] > 0) windows.push_back(i);
  const HaarNode* nodes = nodes_[layout].data();
  const auto pass = [&](const HaarStage& stage, int count) {
    return kernels.pass(stage, trees_.data(), nodes, sum, norms.data(), windows.data(), count);
  };
  const int first = pass(stages_.front(), static_cast<int>(windows.size()));
  // The window after one that fails the first stage is skipped.
  int count = 0;
  for (int i = 0, k = 0; i < level.columns; ++i) {
    while (k < first && windows[at(k)] < i) ++k;
    if (k < first && windows[at(k)] == i) {
      windows[at(count++)] = i;
    } else if (norms[at(i)] > 0) {
      ++i;
    }
  }
  for (std::size_t s = 1; s < stages_.size() && count > 0; ++s) count = pass(stages_[s], count);
  for (int k = 0; k < count; ++k) {
    const cv::Point corner(windows[at(k)] * level.step, y);
    found.emplace_back(cv::Point(cvRound(static_cast<float>(corner.x) * level.scale),
                                 cvRound(static_cast<float>(corner.y) * level.scale)),
                       scaled(window_, level.scale));
  }
}

std::vector<cv::Rect> HaarCascade::find(const cv::Mat& gray, double step, cv::Size min,
                                        cv::Size max) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && step > 1, "type {}, step {}", gray.type(), step);
  if (max.width <= 0 || max.height <= 0) max = gray.size();
  const std::vector<float> scales = scales_between(gray.size(), step, min, max);
  std::vector<cv::Rect> found;
  if (scales.empty()) return found;
  lay_out(stride_of(cvRound(static_cast<float>(gray.cols) / scales.front())));
  std::vector<Level> levels(scales.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(levels.size())), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      levels[at(k)].scale = scales[at(k)];
      prepare(gray, levels[at(k)]);
    }
  });
  struct Part {
    const Level* level;
    int first;  // row
    std::vector<cv::Rect> found = {};
  };
  std::vector<Part> parts;
  for (const Level& level : levels)
    for (int row = 0; level.columns > 0 && row < level.rows; row += kRowsAtOnce)
      parts.push_back({&level, row});
  cv::parallel_for_(cv::Range(0, static_cast<int>(parts.size())), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      Part& part = parts[at(k)];
      const int end = std::min(part.first + kRowsAtOnce, part.level->rows);
      for (int row = part.first; row < end; ++row) search_row(*part.level, row, part.found);
    }
  });
  for (const Part& part : parts) found.insert(found.end(), part.found.begin(), part.found.end());
  return found;
}

const HaarKernels& haar_kernels() { return best_kernels(haar_baseline, haar_avx2, haar_avx512); }

std::vector<cv::Rect> grouped_boxes(const std::vector<cv::Rect>& boxes, int min, double eps) {
  if (min <= 0 || boxes.empty()) return boxes;
  std::vector<int> labels;
  const int count = cv::partition(boxes, labels, [eps](const cv::Rect& a, const cv::Rect& b) {
    return are_similar(a, b, eps);
  });
  struct Group {
    cv::Rect sum{};
    int size = 0;
    cv::Rect mean{};
  };
  std::vector<Group> groups(at(count));
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    Group& group = groups[at(labels[i])];
    group.sum.x += boxes[i].x;
    group.sum.y += boxes[i].y;
    group.sum.width += boxes[i].width;
    group.sum.height += boxes[i].height;
    ++group.size;
  }
  for (Group& group : groups) {
    const float share = 1.F / static_cast<float>(group.size);
    const auto mean = [share](int sum) { return cvRound(static_cast<float>(sum) * share); };
    group.mean = {mean(group.sum.x), mean(group.sum.y), mean(group.sum.width),
                  mean(group.sum.height)};
  }
  std::erase_if(groups, [min](const Group& group) { return group.size <= min; });
  std::vector<cv::Rect> kept;
  for (const Group& group : groups) {
    const auto hides = [&](const Group& other) {
      if (&other == &group || !(other.size > std::max(3, group.size) || group.size < 3))
        return false;
      const int dx = cvRound(other.mean.width * eps);
      const int dy = cvRound(other.mean.height * eps);
      const cv::Rect around(other.mean.x - dx, other.mean.y - dy, other.mean.width + 2 * dx,
                            other.mean.height + 2 * dy);
      return (group.mean & around) == group.mean;
    };
    if (std::none_of(groups.begin(), groups.end(), hides)) kept.push_back(group.mean);
  }
  return kept;
}

}  // namespace tarsier::face
