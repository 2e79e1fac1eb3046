// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/flow.h"

#include "tarsier/core/require.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/media/lazy_opencv.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kRadius = 10;             // px, of a patch
constexpr int kSide = 2 * kRadius + 1;  // of a patch
constexpr int kStoredSide = kSide + 2;  // with a margin for its gradients
constexpr int kPixels = kSide * kSide;  // in a patch
constexpr int kParameters = 6;          // of an affine map
constexpr double kSmoothing = 1;  // px; with less, the pixel grid would be visible after resampling
constexpr int kMinCoarsestSide = 48;      // px, of the coarsest image of a pyramid
constexpr int kMaxLevels = 5;             // above the full image
constexpr int kIterations = 20;           // max per alignment; most need three
constexpr double kConvergencePx = 0.003;  // px
constexpr double kMaxCorrection = 2;      // px; alignments with larger corrections are wrong
constexpr double kMaxZoom = 2.5;          // of a patch, in or out
// of a patch's shape from frame to frame, relative to its radius
constexpr double kMaxShapeChange = 0.35;
constexpr double kMinContrastGain = 0.2;     // min contrast relative to the first frame
constexpr int kCornerWindow = 5;             // px, window of a corner
constexpr double kMinCornerQuality = 0.001;  // of a corner, relative to the best of the image
// gradients of 0.7 per px in all directions: above noise
constexpr double kMinCornerStrength = 3e-5;
constexpr double kMaxSubPixel = 1.5;         // px; a corner that moves farther is a different one
constexpr double kCornerSpacingRatio = 0.6;  // relative to the spacing of points on an even grid
constexpr double kMinTrackDistanceRatio = 0.25;  // of `spacing`: closer tracks show the same point

using Parameters = cv::Matx<double, kParameters, 1>;
using Normal = cv::Matx<double, kParameters, kParameters>;

const cv::Size kWindow(kSide, kSide);

cv::Vec3b color_at(const cv::Mat& image, const cv::Point2f& point) {
  const int x = std::clamp(cvRound(point.x), 0, image.cols - 1);
  const int y = std::clamp(cvRound(point.y), 0, image.rows - 1);
  return image.channels() == 3 ? image.at<cv::Vec3b>(y, x)
                               : cv::Vec3b::all(image.at<std::uint8_t>(y, x));
}

int levels_of(cv::Size size) {
  int levels = 0;
  while (levels < kMaxLevels &&
         std::min(size.width, size.height) >> (levels + 1) >= kMinCoarsestSide)
    ++levels;
  return levels;
}

// The longer and the shorter half axis of the image of a unit circle.
cv::Vec2d half_axes(const cv::Matx22d& affine) {
  cv::Vec2d axes;
  cv::SVD::compute(affine, axes, cv::noArray(), cv::noArray(), cv::SVD::NO_UV);
  return axes;
}

// The place of a patch in an image: pixel x, relative to the centre, is at affine * x + shift.
struct Warp {
  cv::Matx22d affine = cv::Matx22d::eye();
  cv::Vec2d shift;
};

// A patch prepared for alignment. Effects of gain and offset are projected out.
class Template {
 public:
  explicit Template(const std::vector<float>& patch) {
    double mean = 0;
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const float* at = patch.data() + static_cast<std::ptrdiff_t>(y + 1) * kStoredSide + x + 1;
        const float dx = (at[1] - at[-1]) / 2;
        const float dy = (at[kStoredSide] - at[-kStoredSide]) / 2;
        const float u = static_cast<float>(x - kRadius) / kRadius;
        const float v = static_cast<float>(y - kRadius) / kRadius;
        const int i = y * kSide + x;
        values_[i] = *at;
        mean += static_cast<double>(*at);
        const float slopes[kParameters] = {dx, dy, dx * u, dx * v, dy * u, dy * v};
        for (int k = 0; k < kParameters; ++k) slopes_[k][i] = slopes[k];
      }
    }
    for (float& value : values_) value -= static_cast<float>(mean / kPixels);
    square_ = dot(values_, values_);
    Normal normal;
    for (auto& slopes : slopes_) {
      double sum = 0;
      for (const float slope : slopes) sum += static_cast<double>(slope);
      const auto offset = static_cast<float>(sum / kPixels);
      const auto gain = static_cast<float>(square_ > 0 ? dot(slopes, values_) / square_ : 0.0);
      for (int i = 0; i < kPixels; ++i) slopes[i] -= offset + gain * values_[i];
    }
    for (int k = 0; k < kParameters; ++k)
      for (int l = 0; l < kParameters; ++l) normal(k, l) = dot(slopes_[k], slopes_[l]);
    // Damps directions that the patch does not determine; the minimum is unchanged.
    const double damping = 1e-3 * cv::trace(normal) / kParameters;
    for (int k = 0; k < kParameters; ++k) normal(k, k) += damping;
    inverse_ = normal.inv(cv::DECOMP_CHOLESKY, &is_usable_);
    is_usable_ = is_usable_ && square_ > 0;
  }

  // Refines `warp`. Returns the correlation, or nothing where it left the image or diverged.
  [[nodiscard]] std::optional<double> align(const cv::Mat& image, Warp& warp) const {
    if (!is_usable_) return std::nullopt;
    float seen[kPixels];
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      if (!sample(image, warp, seen)) return std::nullopt;
      const double gain = dot(seen, values_) / square_;
      if (gain < kMinContrastGain) return std::nullopt;
      Parameters right;
      for (int k = 0; k < kParameters; ++k) right(k) = dot(slopes_[k], seen) / gain;
      const Parameters step = inverse_ * right;
      // The step moves the patch, so the image moves in the opposite direction.
      const cv::Matx22d turn(1 + step(2) / kRadius, step(3) / kRadius, step(4) / kRadius,
                             1 + step(5) / kRadius);
      if (std::abs(cv::determinant(turn)) < 0.1) return std::nullopt;
      warp.affine = warp.affine * turn.inv();
      warp.shift -= warp.affine * cv::Vec2d(step(0), step(1));
      double largest = 0;
      for (int k = 0; k < kParameters; ++k) largest = std::max(largest, std::abs(step(k)));
      if (largest < kConvergencePx) break;
    }
    if (!sample(image, warp, seen)) return std::nullopt;
    double sum = 0;
    for (const float value : seen) sum += static_cast<double>(value);
    const double square = dot(seen, seen) - sum * sum / kPixels;
    return dot(seen, values_) / std::sqrt(std::max(1e-9, square * square_));
  }

 private:
  [[nodiscard]] static double dot(const float* a, const float* b) {
    double sum = 0;
    for (int y = 0; y < kSide; ++y) {
      float row = 0;
      for (int x = 0; x < kSide; ++x) row += a[y * kSide + x] * b[y * kSide + x];
      sum += static_cast<double>(row);
    }
    return sum;
  }

  // Bilinear; false if a pixel is outside.
  [[nodiscard]] static bool sample(const cv::Mat& image, const Warp& warp, float* out) {
    for (const int v : {-kRadius, kRadius}) {
      for (const int u : {-kRadius, kRadius}) {
        const cv::Vec2d corner = warp.affine * cv::Vec2d(u, v) + warp.shift;
        if (!(corner[0] >= 0 && corner[1] >= 0 && corner[0] < image.cols - 1 &&
              corner[1] < image.rows - 1)) {
          return false;
        }
      }
    }
    const cv::Matx22f affine = warp.affine;
    const cv::Vec2f shift = warp.shift;
    const auto stride = static_cast<std::ptrdiff_t>(image.step1());
    const auto* pixels = image.ptr<float>();
    for (int v = -kRadius; v <= kRadius; ++v) {
      for (int u = -kRadius; u <= kRadius; ++u) {
        const auto a = static_cast<float>(u);
        const auto b = static_cast<float>(v);
        // Rounding could put a corner one pixel outside.
        const float x = std::max(0.0F, affine(0, 0) * a + affine(0, 1) * b + shift[0]);
        const float y = std::max(0.0F, affine(1, 0) * a + affine(1, 1) * b + shift[1]);
        const int left = std::min(static_cast<int>(x), image.cols - 2);
        const int top = std::min(static_cast<int>(y), image.rows - 2);
        const float right = x - static_cast<float>(left);
        const float down = y - static_cast<float>(top);
        const float* p = pixels + top * stride + left;
        const float above = p[0] + right * (p[1] - p[0]);
        const float below = p[stride] + right * (p[stride + 1] - p[stride]);
        *out++ = above + down * (below - above);
      }
    }
    return true;
  }

  float values_[kPixels];
  float slopes_[kParameters][kPixels];
  double square_ = 0;
  Normal inverse_;
  bool is_usable_ = false;
};

}  // namespace

struct FlowTracker::LiveTrack {
  Track track;
  int last = 0;                             // last frame
  cv::Vec2d offset;                         // px, from the patch's centre to the point
  cv::Matx22d affine = cv::Matx22d::eye();  // patch to current frame
  std::vector<float> patch;                 // kStoredSide x kStoredSide, smoothed
};

FlowTracker::FlowTracker(const FlowOptions& options) : options_(options) { options.check(); }

FlowTracker::~FlowTracker() = default;

void FlowTracker::add(const cv::Mat& image) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of type {}", image.type());
  TARSIER_REQUIRE(
      image.cols >= 64 && image.rows >= 64 && image.cols <= 32'000 && image.rows <= 32'000,
      "an image of {} x {} px", image.cols, image.rows);
  TARSIER_REQUIRE(count_ == 0 || image.size() == size_,
                  "an image of {} x {} px after one of {} x {} px", image.cols, image.rows,
                  size_.width, size_.height);
  size_ = image.size();
  spacing_ = std::max(3.0, kCornerSpacingRatio *
                               std::sqrt(static_cast<double>(size_.area()) / options_.max_points));
  const cv::Mat gray = gray_of(image);
  // Derivatives are used for the backward tracking and for the next frame's forward tracking.
  std::vector<cv::Mat> pyramid;
  lazy_opencv::optical_flow_pyramid(gray, pyramid, kWindow, levels_of(size_));
  cv::Mat smooth;
  gray.convertTo(smooth, CV_32F);
  cv::GaussianBlur(smooth, smooth, {}, kSmoothing);

  if (!live_tracks_.empty()) {
    track_points(image, pyramid, smooth);
    remove_duplicates();
    // After remove_duplicates(), so that new points can take the place of those that end here.
    std::erase_if(live_tracks_, [&](LiveTrack& live) {
      if (live.last > count_) return false;
      end(live);
      return true;
    });
  }
  begin(image, gray, smooth);
  pyramid_ = std::move(pyramid);
  ++count_;
}

void FlowTracker::track_points(const cv::Mat& image, const std::vector<cv::Mat>& pyramid,
                               const cv::Mat& smooth) {
  std::vector<cv::Point2f> before;
  before.reserve(live_tracks_.size());
  for (const LiveTrack& live : live_tracks_) before.push_back(live.track.points.back());
  std::vector<cv::Point2f> after;
  std::vector<cv::Point2f> back;
  std::vector<std::uint8_t> forward_found;
  std::vector<std::uint8_t> backward_found;
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 30, 0.01);
  const int levels = levels_of(size_);
  lazy_opencv::optical_flow_pyr_lk(pyramid_, pyramid, before, after, forward_found, cv::noArray(),
                                   kWindow, levels, criteria);
  lazy_opencv::optical_flow_pyr_lk(pyramid, pyramid_, after, back, backward_found, cv::noArray(),
                                   kWindow, levels, criteria);
  std::vector<std::uint8_t> is_tracked(live_tracks_.size(), 0);
  cv::parallel_for_(
      cv::Range(0, static_cast<int>(live_tracks_.size())), [&](const cv::Range& range) {
        for (auto i = static_cast<std::size_t>(range.start);
             i < static_cast<std::size_t>(range.end); ++i) {
          if (forward_found[i] == 0 || backward_found[i] == 0) continue;
          if (!(cv::norm(back[i] - before[i]) <= options_.back_px)) continue;
          LiveTrack& live = live_tracks_[i];
          const cv::Vec2d guess(static_cast<double>(after[i].x), static_cast<double>(after[i].y));
          Warp warp{live.affine, guess - live.affine * live.offset};
          const auto correlation = Template(live.patch).align(smooth, warp);
          if (!correlation || *correlation < options_.min_correlation) continue;
          const cv::Vec2d point = warp.affine * live.offset + warp.shift;
          if (!(cv::norm(point - guess) <= kMaxCorrection)) continue;
          const cv::Vec2d axes = half_axes(warp.affine);
          const double zoom = cv::determinant(warp.affine);
          if (!(zoom > 0 && axes[0] <= kMaxZoom && axes[1] >= 1 / kMaxZoom)) continue;
          const cv::Matx22d change = live.affine.inv() * warp.affine - cv::Matx22d::eye();
          if (!(half_axes(change)[0] <= kMaxShapeChange)) continue;
          live.affine = warp.affine;
          live.track.points.emplace_back(static_cast<float>(point[0]),
                                         static_cast<float>(point[1]));
          live.track.sizes.push_back(static_cast<float>(kSide * std::sqrt(zoom)));
          live.track.colors.push_back(color_at(image, live.track.points.back()));
          is_tracked[i] = 1;
        }
      });
  std::vector<LiveTrack> rest;
  for (std::size_t i = 0; i < live_tracks_.size(); ++i) {
    if (is_tracked[i] != 0)
      rest.push_back(std::move(live_tracks_[i]));
    else
      end(live_tracks_[i]);
  }
  live_tracks_ = std::move(rest);
}

// Of tracks that met, the oldest continues. The last points of the others are wrong.
void FlowTracker::remove_duplicates() {
  cv::Mat occupied(size_, CV_8UC1, cv::Scalar(0));
  const int radius = std::max(1, cvRound(kMinTrackDistanceRatio * spacing_));
  std::erase_if(live_tracks_, [&](LiveTrack& live) {
    Track& track = live.track;
    const cv::Point pixel(cvRound(track.points.back().x), cvRound(track.points.back().y));
    if (!cv::Rect({}, size_).contains(pixel) || occupied.at<std::uint8_t>(pixel) != 0) {
      track.points.pop_back();
      track.colors.pop_back();
      track.sizes.pop_back();
      end(live);
      return true;
    }
    cv::circle(occupied, pixel, radius, cv::Scalar(1), cv::FILLED);
    return false;
  });
}

void FlowTracker::end(LiveTrack& live) {
  if (live.track.points.size() >= 2) done_.push_back(std::move(live.track));
}

void FlowTracker::begin(const cv::Mat& image, const cv::Mat& gray, const cv::Mat& smooth) {
  const int missing = options_.max_points - static_cast<int>(live_tracks_.size());
  const int margin = kRadius + 2;
  if (missing <= 0) return;
  // Local maxima that are near neither a tracked point nor a better maximum.
  cv::Mat corners;
  cv::cornerMinEigenVal(gray, corners, kCornerWindow);
  double best = 0;
  cv::minMaxLoc(corners, nullptr, &best);
  const auto min_strength =
      static_cast<float>(std::max(kMinCornerStrength, kMinCornerQuality * best));
  cv::Mat highest;
  cv::dilate(corners, highest, cv::Mat());
  cv::Mat free(size_, CV_8UC1, cv::Scalar(0));
  free(cv::Rect(margin, margin, size_.width - 2 * margin, size_.height - 2 * margin)) = 1;
  const int radius = cvRound(spacing_);
  const double cell = std::max(size_.width, size_.height) / static_cast<double>(options_.grid);
  const int across = static_cast<int>(size_.width / cell) + 1;
  const int down = static_cast<int>(size_.height / cell) + 1;
  std::vector<int> in_cell(static_cast<std::size_t>(across) * static_cast<std::size_t>(down), 0);
  const auto enter = [&](const cv::Point& pixel) {
    cv::circle(free, pixel, radius, cv::Scalar(0), cv::FILLED);
    const int column = std::min(static_cast<int>(pixel.x / cell), across - 1);
    const int row = std::min(static_cast<int>(pixel.y / cell), down - 1);
    return in_cell[static_cast<std::size_t>(row) * static_cast<std::size_t>(across) +
                   static_cast<std::size_t>(column)]++;
  };
  for (const LiveTrack& live : live_tracks_)
    enter({cvRound(live.track.points.back().x), cvRound(live.track.points.back().y)});
  struct Corner {
    float strength = 0;
    cv::Point pixel;
    int rank = 0;  // number of better corners in its cell
  };
  std::vector<Corner> candidates;
  for (int y = margin; y < size_.height - margin; ++y) {
    const float* strength = corners.ptr<float>(y);
    const float* around = highest.ptr<float>(y);
    const std::uint8_t* is_free = free.ptr(y);
    for (int x = margin; x < size_.width - margin; ++x) {
      if (is_free[x] != 0 && strength[x] >= min_strength && strength[x] >= around[x])
        candidates.push_back({strength[x], {x, y}, 0});
    }
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Corner& a, const Corner& b) { return a.strength > b.strength; });
  std::erase_if(candidates, [&](Corner& corner) {
    if (free.at<std::uint8_t>(corner.pixel) == 0) return true;
    corner.rank = enter(corner.pixel);
    return false;
  });
  // The emptiest cells first; within them the strongest corners.
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Corner& a, const Corner& b) { return a.rank < b.rank; });
  if (static_cast<int>(candidates.size()) > missing)
    candidates.resize(static_cast<std::size_t>(missing));
  if (candidates.empty()) return;

  std::vector<cv::Point2f> points;
  points.reserve(candidates.size());
  for (const Corner& corner : candidates) points.emplace_back(corner.pixel);
  cv::cornerSubPix(gray, points, {3, 3}, {-1, -1},
                   {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 20, 0.01});
  // If too many tracks began together they would also end together, and the frames before and after
  // would have no matches.
  const int max_length = options_.reach - 1;
  const int share =
      (static_cast<int>(live_tracks_.size() + points.size()) + max_length - 1) / max_length;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const cv::Point pixel = candidates[i].pixel;
    const cv::Point2f center(pixel);
    if (!(cv::norm(points[i] - center) <= kMaxSubPixel)) points[i] = center;
    LiveTrack live;
    live.track = {count_, {points[i]}, {color_at(image, points[i])}, {static_cast<float>(kSide)}};
    live.last = count_ + max_length - static_cast<int>(i) / share % max_length;
    live.offset = {static_cast<double>(points[i].x - center.x),
                   static_cast<double>(points[i].y - center.y)};
    for (int y = -kRadius - 1; y <= kRadius + 1; ++y) {
      const float* in = smooth.ptr<float>(pixel.y + y) + pixel.x;
      live.patch.insert(live.patch.end(), in - kRadius - 1, in + kRadius + 2);
    }
    live_tracks_.push_back(std::move(live));
  }
}

FlowResult FlowTracker::finish() {
  for (LiveTrack& live : live_tracks_) end(live);
  live_tracks_.clear();
  FlowResult result;
  result.features.resize(static_cast<std::size_t>(count_));
  std::map<std::pair<int, int>, std::vector<Match>> matches;
  std::vector<int> indices;
  for (const Track& track : done_) {
    indices.clear();
    for (std::size_t k = 0; k < track.points.size(); ++k) {
      Features& features = result.features[static_cast<std::size_t>(track.start) + k];
      indices.push_back(static_cast<int>(features.points.size()));
      features.points.push_back(track.points[k]);
      features.colors.push_back(track.colors[k]);
      features.sizes.push_back(track.sizes[k]);
    }
    // Indices grow from track to track, so each list is sorted.
    for (std::size_t i = 0; i < indices.size(); ++i) {
      for (std::size_t j = i + 1; j < indices.size(); ++j) {
        matches[{track.start + static_cast<int>(i), track.start + static_cast<int>(j)}].push_back(
            {indices[i], indices[j]});
      }
    }
  }
  for (auto& [pair, common] : matches)
    result.pairs.push_back({pair.first, pair.second, std::move(common)});
  done_.clear();
  pyramid_.clear();
  count_ = 0;
  return result;
}

}  // namespace tarsier::sfm
