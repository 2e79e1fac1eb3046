// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/face_networks.h"

#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <tuple>

namespace tarsier::face {
namespace {

constexpr int kBorder = 8;  // px of a level repeated around it, so that faces may touch its edge
constexpr int kContrastWindow = 33;     // px: twice a face
constexpr float kContrastFloor = 8;     // grey values
constexpr double kScanThreshold = 0.1;  // of the first network: its misses are final
constexpr std::size_t kMaxFinds =
    3000;  // of a level: whatever a picture holds, the work has an end
constexpr double kJudgeThreshold = 0.15;  // of the second
constexpr double kClearlyNot = -3;        // logit of the third

double logistic(double x) { return 1 / (1 + std::exp(-x)); }

double intersection(const cv::Rect2d& a, const cv::Rect2d& b) { return (a & b).area(); }

bool is_same(const cv::Rect2d& a, const cv::Rect2d& b, double overlap) {
  const double common = intersection(a, b);
  const double all = a.area() + b.area() - common;
  return common > overlap * std::max(1e-9, all) ||
         common > 0.75 * std::max(1e-9, std::min(a.area(), b.area()));
}

// Planes of the four pixels of each 2 x 2 block.
template <typename Value>
void split_blocks(int rows, int cols, const Value& value, std::vector<float>& planes) {
  const int height = rows / 2;
  const int width = cols / 2;
  const std::size_t plane = static_cast<std::size_t>(height) * static_cast<std::size_t>(width);
  planes.resize(4 * plane);
  for (int y = 0; y < 2 * height; ++y) {
    float* even = planes.data() + static_cast<std::size_t>(y % 2 * 2) * plane +
                  static_cast<std::size_t>(y / 2) * static_cast<std::size_t>(width);
    float* odd = even + plane;
    value(y, even, odd, width);
  }
}

// What a box holds, as a network sees it. `flipped`: mirrored.
void cut_window(const std::vector<cv::Mat>& halves, const cv::Rect2d& box, FaceWindow form,
                bool flipped, cv::Mat& window) {
  const double scale = form.box / box.width;
  const int level = half_for(scale, halves.size());
  const double unit = std::ldexp(1.0, level);  // px of the picture in one of this half
  const double step = 1 / (scale * unit);
  const double left = (box.x + box.width / 2) / unit - 0.5 * form.side * step;
  const double top = (box.y + box.height / 2) / unit - 0.5 * form.side * step;
  // Pixel centres: window (u + 0.5) * step + left - 0.5.
  const double x0 = left + 0.5 * step - 0.5;
  const double y0 = top + 0.5 * step - 0.5;
  const cv::Matx23d source_from_window =
      flipped ? cv::Matx23d(-step, 0, x0 + (form.side - 1) * step, 0, step, y0)
              : cv::Matx23d(step, 0, x0, 0, step, y0);
  cv::warpAffine(halves[static_cast<std::size_t>(level)], window, source_from_window,
                 cv::Size(form.side, form.side), cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
}

struct Judgement {
  double logit = 0;
  cv::Rect2d box;
};

// What the network says of the window; with `both` the mean of that and of its mirror image, unless
// the first is clear: no.
Judgement judge_box(const std::vector<cv::Mat>& halves, const cv::Rect2d& box,
                    const linalg::Network& network, FaceWindow form, bool both,
                    linalg::Workspace& workspace, std::vector<float>& input) {
  double sum[4] = {};
  const double share = both ? 0.5 : 1;
  cv::Mat window;
  for (const bool flipped : {false, true}) {
    if (flipped && !both) break;
    if (flipped && sum[0] < share * kClearlyNot) return {sum[0] / share, box};
    cut_window(halves, box, form, flipped, window);
    window_input(window, input);
    const std::vector<float>& out =
        linalg::run(network, input.data(), {4, form.side / 2, form.side / 2}, workspace);
    for (std::size_t i = 0; i < 4; ++i) {
      sum[i] += share * static_cast<double>(i == 1 && flipped ? -out[i] : out[i]);
    }
  }
  const double width = box.width * std::exp(std::clamp(sum[3], -0.5, 0.5));
  const double x = box.x + box.width / 2 + std::clamp(sum[1], -0.5, 0.5) * box.width;
  const double y = box.y + box.height / 2 + std::clamp(sum[2], -0.5, 0.5) * box.width;
  return {sum[0], {x - width / 2, y - width / 2, width, width}};
}

// Smallest scale of a level, from the size of the largest face.
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
  const std::vector<float>& out = linalg::run(networks.scan, workspace.input.data(),
                                              {4, level.rows / 2, level.cols / 2}, workspace.scan);
  const linalg::Shape map = workspace.scan.shapes.back();
  const auto plane = static_cast<std::size_t>(map.height) * static_cast<std::size_t>(map.width);
  const auto least = static_cast<float>(std::log(kScanThreshold / (1 - kScanThreshold)));
  const double sx = static_cast<double>(gray.cols) / size.width;
  const double sy = static_cast<double>(gray.rows) / size.height;
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                             static_cast<std::size_t>(x);
      if (out[at] < least) continue;
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

linalg::Network judge_network() {
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

linalg::Network check_network() {
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
  judge.check();
  check.check();
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
  require_window(judge, kJudgeWindow, "second");
  require_window(check, kCheckWindow, "third");
  TARSIER_REQUIRE(likely > 0 && likely <= sure && sure < 1, "scores {} and {}", likely, sure);
}

void FaceSearchOptions::check() const {
  TARSIER_REQUIRE(min_face >= kScanFace && std::isfinite(min_face),
                  "the smallest face is of {} px at least, got {}", kScanFace, min_face);
  TARSIER_REQUIRE(max_face == 0 || (max_face >= min_face && std::isfinite(max_face)),
                  "the largest face of {} px is below the smallest, {} px", max_face, min_face);
  TARSIER_REQUIRE(threshold >= 0 && threshold < 1, "threshold {}", threshold);
  TARSIER_REQUIRE(max_places >= 1 && max_places <= 10000, "{} places", max_places);
}

void make_halves(const cv::Mat& gray, double smallest_scale, std::vector<cv::Mat>& halves) {
  std::size_t count = 1;
  for (double scale = 0.5; scale >= smallest_scale; scale /= 2) ++count;
  halves.resize(count);
  halves[0] = gray;
  for (std::size_t i = 1; i < count; ++i) {
    const cv::Mat& from = halves[i - 1];
    // The same place at every level needs whole blocks; an odd last row is given a twin.
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
                  "a picture of type {}, {}x{}", gray.type(), gray.cols, gray.rows);
  const cv::Size window(kContrastWindow, kContrastWindow);
  cv::boxFilter(gray, workspace.mean, CV_32F, window, {-1, -1}, true, cv::BORDER_REPLICATE);
  cv::sqrBoxFilter(gray, workspace.square, CV_32F, window, {-1, -1}, true, cv::BORDER_REPLICATE);
  split_blocks(
      gray.rows, gray.cols,
      [&](int y, float* even, float* odd, int width) {
        const std::uint8_t* v = gray.ptr(y);
        const auto* m = workspace.mean.ptr<float>(y);
        const auto* s = workspace.square.ptr<float>(y);
        const auto contrast = [&](int x) {
          const float deviation = std::sqrt(std::max(0.0F, s[x] - m[x] * m[x]));
          return (static_cast<float>(v[x]) - m[x]) / (deviation + kContrastFloor);
        };
        for (int x = 0; x < width; ++x) {
          even[x] = contrast(2 * x);
          odd[x] = contrast(2 * x + 1);
        }
      },
      input);
}

void window_input(const cv::Mat& window, std::vector<float>& input) {
  TARSIER_REQUIRE(window.type() == CV_8UC1 && window.rows % 2 == 0 && window.cols % 2 == 0,
                  "a window of type {}, {}x{}", window.type(), window.cols, window.rows);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(window, mean, deviation);
  const auto offset = static_cast<float>(mean[0]);
  const auto scale = static_cast<float>(1 / (deviation[0] + 4));
  split_blocks(
      window.rows, window.cols,
      [&](int y, float* even, float* odd, int width) {
        const std::uint8_t* v = window.ptr(y);
        for (int x = 0; x < width; ++x) {
          even[x] = (static_cast<float>(v[2 * x]) - offset) * scale;
          odd[x] = (static_cast<float>(v[2 * x + 1]) - offset) * scale;
        }
      },
      input);
}

std::vector<ScoredFace> suppress_overlaps(std::vector<ScoredFace> faces, double overlap) {
  // The place breaks ties, so that the order is always the same.
  std::sort(faces.begin(), faces.end(), [](const ScoredFace& a, const ScoredFace& b) {
    return std::tuple(-a.score, a.box.x, a.box.y, a.box.width) <
           std::tuple(-b.score, b.box.x, b.box.y, b.box.width);
  });
  std::vector<ScoredFace> kept;
  for (const ScoredFace& face : faces) {
    const bool known = std::any_of(kept.begin(), kept.end(), [&](const ScoredFace& better) {
      return is_same(better.box, face.box, overlap);
    });
    if (!known) kept.push_back(face);
  }
  return kept;
}

std::vector<ScoredFace> scan_faces(const cv::Mat& gray, const FaceNetworks& networks,
                                   const FaceSearchOptions& options,
                                   FaceSearchWorkspace& workspace) {
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "a picture of type {}", gray.type());
  options.check();
  const double largest = std::max(options.min_face, largest_face(gray, options));
  make_halves(gray, kScanFace / largest, workspace.halves);
  std::vector<ScoredFace> found;
  std::vector<ScoredFace> all;
  for (double face = options.min_face;; face *= kScanStep) {
    found.clear();
    scan_level(gray, kScanFace / face, networks, workspace, found);
    if (found.size() > kMaxFinds) {
      std::stable_sort(found.begin(), found.end(),
                       [](const ScoredFace& a, const ScoredFace& b) { return a.score > b.score; });
      found.resize(kMaxFinds);
    }
    // Within a level the same face fires in several cells; a neighbouring level's box may be
    // better.
    for (ScoredFace& place : suppress_overlaps(std::move(found), 0.6)) all.push_back(place);
    if (face * kScanStep >= largest) break;
  }
  std::vector<ScoredFace> places = suppress_overlaps(std::move(all), 0.65);
  if (places.size() > static_cast<std::size_t>(options.max_places)) {
    places.resize(static_cast<std::size_t>(options.max_places));
  }
  return places;
}

std::vector<ScoredFace> search_faces(const cv::Mat& gray, const FaceNetworks& networks,
                                     const FaceSearchOptions& options,
                                     FaceSearchWorkspace& workspace) {
  const std::vector<ScoredFace> places = scan_faces(gray, networks, options, workspace);
  const double least = options.threshold > 0 ? options.threshold : networks.likely;
  std::vector<ScoredFace> faces;
  // Several places move onto one face: it is looked at closely once.
  std::vector<ScoredFace> judged;
  for (const ScoredFace& place : places) {
    const Judgement first = judge_box(workspace.halves, place.box, networks.judge, kJudgeWindow,
                                      false, workspace.judge, workspace.input);
    ++workspace.places;
    const double score = logistic(first.logit);
    if (score >= (options.checked ? kJudgeThreshold : least)) judged.push_back({first.box, score});
  }
  judged = suppress_overlaps(std::move(judged), 0.6);
  if (!options.checked) return judged;
  // A quarter of the places at most is worth the third.
  const auto most = static_cast<std::size_t>(std::max(1, options.max_places / 4));
  if (judged.size() > most) judged.resize(most);
  for (const ScoredFace& place : judged) {
    const Judgement second = judge_box(workspace.halves, place.box, networks.check, kCheckWindow,
                                       true, workspace.check, workspace.input);
    ++workspace.checked;
    const double score = logistic(second.logit);
    // Levels reach a little below the size that was asked for.
    if (score >= least && second.box.width >= 0.85 * options.min_face) {
      faces.push_back({second.box, score});
    }
  }
  return suppress_overlaps(std::move(faces));
}

}  // namespace tarsier::face
