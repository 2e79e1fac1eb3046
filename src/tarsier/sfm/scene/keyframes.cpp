// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/keyframes.h"

#include "tarsier/core/require.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/media/lazy_opencv.h"

#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kReducedSide = 960;  // px
constexpr int kMaxCorners = 300;
constexpr std::size_t kMinCorners = 12;
constexpr double kMinTrackedShare = 0.3;  // share of the corners; with fewer, the track is lost
constexpr float kMaxForwardBackwardError_px = 1;  // px, forward and backward
constexpr double kMinMotionShare = 0.5;           // of min_motion, for a candidate
constexpr double kMaxMotionShare = 2;
// share of the sharpness, at half a window from the moment
constexpr double kDistancePenalty = 0.1;

cv::Mat reduced_gray(const cv::Mat& frame) {
  const cv::Mat gray = gray_of(frame);
  const double factor = static_cast<double>(kReducedSide) / std::max(gray.cols, gray.rows);
  if (factor >= 1) return frame.channels() == 3 ? gray : gray.clone();
  cv::Mat reduced;
  const cv::Size size(std::max(1, cvRound(gray.cols * factor)),
                      std::max(1, cvRound(gray.rows * factor)));
  cv::resize(gray, reduced, size, 0, 0, cv::INTER_AREA);
  return reduced;
}

double variance_of(const cv::Mat& image) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(image, mean, deviation);
  return deviation[0] * deviation[0];
}

double sharpness_of(const cv::Mat& gray) {
  cv::Mat laplacian;
  cv::Laplacian(gray, laplacian, CV_32F);
  return variance_of(laplacian) / (variance_of(gray) + 1);  // + 1: a uniform image has no variance
}

std::vector<cv::Point2f> corners_of(const cv::Mat& gray) {
  std::vector<cv::Point2f> corners;
  const double min_distance = std::max(gray.cols, gray.rows) / 60.0;
  cv::goodFeaturesToTrack(gray, corners, kMaxCorners, 0.01, min_distance);
  return corners;
}

void track(const cv::Mat& from, const cv::Mat& to, const std::vector<cv::Point2f>& start,
           std::vector<cv::Point2f>& end, std::vector<unsigned char>& forward_status) {
  std::vector<float> ignored;
  lazy_opencv::optical_flow_pyr_lk(from, to, start, end, forward_status, ignored, {21, 21}, 4,
                                   {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 30, 0.01},
                                   cv::OPTFLOW_USE_INITIAL_FLOW);
}

}  // namespace

KeyframePicker::KeyframePicker(const KeyframeOptions& options) : options_(options) {
  options_.check();
}

void KeyframePicker::set_reference(const cv::Mat& gray) {
  reference_ = gray;
  corners_ = corners_of(gray);
  tracked_corners_ = corners_;
}

// Measures the motion of a frame since the reference.
void KeyframePicker::measure(Candidate& candidate) {
  candidate.motion = 0;
  candidate.is_lost = false;
  if (corners_.size() < kMinCorners) {
    // There are no corners to track: try this frame.
    set_reference(candidate.gray);
    return;
  }
  std::vector<cv::Point2f> positions = tracked_corners_;
  std::vector<cv::Point2f> back = corners_;
  std::vector<unsigned char> forward_status;
  std::vector<unsigned char> backward_status;
  track(reference_, candidate.gray, corners_, positions, forward_status);
  track(candidate.gray, reference_, positions, back, backward_status);
  std::vector<double> motions;
  const cv::Rect2f inside(0, 0, static_cast<float>(candidate.gray.cols),
                          static_cast<float>(candidate.gray.rows));
  for (std::size_t k = 0; k < corners_.size(); ++k) {
    const cv::Point2f error = back[k] - corners_[k];
    const bool is_good = forward_status[k] != 0 && backward_status[k] != 0 &&
                         inside.contains(positions[k]) &&
                         std::hypot(error.x, error.y) <= kMaxForwardBackwardError_px;
    if (!is_good) continue;
    tracked_corners_[k] = positions[k];
    const cv::Point2f shift = positions[k] - corners_[k];
    motions.push_back(std::hypot(shift.x, shift.y));
  }
  if (static_cast<double>(motions.size()) <
      std::max<double>(kMinCorners / 2.0,
                       kMinTrackedShare * static_cast<double>(corners_.size()))) {
    candidate.is_lost = true;
    return;
  }
  const auto median = motions.begin() + static_cast<std::ptrdiff_t>(motions.size() / 2);
  std::nth_element(motions.begin(), median, motions.end());
  candidate.motion = *median / std::hypot(candidate.gray.cols, candidate.gray.rows);
}

// Sets or clears the moment at which a key frame is due.
void KeyframePicker::update_trigger(const Candidate& candidate, std::size_t index) {
  lost_ = candidate.is_lost ? lost_ + 1 : 0;
  if (trigger_) {
    // The corners are found again after a blur, and the camera has not moved away.
    const bool has_returned =
        !candidate.is_lost && candidate.motion < kMinMotionShare * options_.min_motion;
    if (has_returned) trigger_.reset();
    return;
  }
  if (candidate.motion >= options_.min_motion || lost_ >= std::max(1, options_.window / 2))
    trigger_ = index;
}

// Whether all frames around the moment have arrived, or the camera is moving too far away.
bool KeyframePicker::is_due() const {
  if (!trigger_) return false;
  const std::size_t frames_after = static_cast<std::size_t>(options_.window - 1) / 2;
  return buffer_.size() > *trigger_ + frames_after ||
         buffer_.back().motion > kMaxMotionShare * options_.min_motion;
}

// Chooses the best of buffer_[begin, end). The frames after it are measured again from there.
std::optional<Keyframe> KeyframePicker::choose(std::size_t begin, std::size_t end,
                                               std::size_t trigger) {
  const double half = std::max(1.0, options_.window / 2.0);
  std::optional<std::size_t> best;
  double best_score = -1;
  const auto distance_of = [&](std::size_t k) {
    return std::abs(static_cast<double>(k) - static_cast<double>(trigger));
  };
  for (std::size_t k = begin; k < end; ++k) {
    const Candidate& candidate = buffer_[k];
    const bool is_in_range = candidate.motion >= kMinMotionShare * options_.min_motion &&
                             candidate.motion <= kMaxMotionShare * options_.min_motion;
    // The moment itself is always allowed, as a fast camera may leave no other frame. A frame after
    // a cut needs corners of its own, so that a fade to black gives no key frame.
    const bool is_allowed = candidate.is_lost ? corners_of(candidate.gray).size() >= kMinCorners
                                              : is_in_range || k == trigger;
    if (!is_allowed) continue;
    const double score =
        candidate.sharpness * (1 - kDistancePenalty * std::min(1.0, distance_of(k) / half));
    if (score > best_score) {
      best_score = score;
      best = k;
    }
  }
  if (!best) {
    buffer_.clear();
    trigger_.reset();
    lost_ = 0;
    return std::nullopt;
  }
  const Candidate chosen = buffer_[*best];
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(*best) + 1);
  trigger_.reset();
  lost_ = 0;
  set_reference(chosen.gray);
  for (std::size_t k = 0; k < buffer_.size(); ++k) {
    measure(buffer_[k]);
    update_trigger(buffer_[k], k);
  }
  ++count_;
  return Keyframe{chosen.image, chosen.index, chosen.time, chosen.motion, chosen.sharpness};
}

std::optional<Keyframe> KeyframePicker::offer(const cv::Mat& frame, std::int64_t index,
                                              double time) {
  const bool is_frame =
      frame.dims == 2 && !frame.empty() && (frame.type() == CV_8UC3 || frame.type() == CV_8UC1);
  TARSIER_REQUIRE(is_frame, "{}x{}, type {} is not an 8-bit frame", frame.cols, frame.rows,
                  frame.type());
  TARSIER_REQUIRE(size_.empty() || frame.size() == size_, "{}x{} px behind {}x{}", frame.cols,
                  frame.rows, size_.width, size_.height);
  TARSIER_REQUIRE(size_.empty() || index > last_index_, "frame {} behind {}", index, last_index_);
  const bool is_first = size_.empty();
  size_ = frame.size();
  last_index_ = index;
  if (count_ >= options_.max_count) return std::nullopt;

  Candidate candidate;
  candidate.gray = reduced_gray(frame);
  candidate.index = index;
  candidate.time = time;
  candidate.sharpness = sharpness_of(candidate.gray);
  if (is_first) {
    set_reference(candidate.gray);
    ++count_;
    return Keyframe{frame.clone(), index, time, 0, candidate.sharpness};
  }
  measure(candidate);
  candidate.image = frame.clone();  // the caller may reuse the memory of `frame`
  buffer_.push_back(std::move(candidate));
  update_trigger(buffer_.back(), buffer_.size() - 1);
  while (!trigger_ && buffer_.size() > static_cast<std::size_t>(options_.window))
    buffer_.pop_front();
  if (!is_due()) return std::nullopt;
  const std::size_t before = static_cast<std::size_t>(options_.window) / 2;
  const std::size_t begin = *trigger_ - std::min(*trigger_, before);
  return choose(begin, buffer_.size(), *trigger_);
}

std::optional<Keyframe> KeyframePicker::finish() {
  if (buffer_.empty() || count_ >= options_.max_count) return std::nullopt;
  const std::size_t size = buffer_.size();
  const std::size_t window = std::min(size, static_cast<std::size_t>(options_.window));
  const Candidate& last = buffer_.back();
  const bool has_moved = trigger_ || last.motion >= kMinMotionShare * options_.min_motion;
  std::optional<Keyframe> result;
  if (has_moved) result = choose(size - window, size, size - 1);
  buffer_.clear();
  trigger_.reset();
  return result;
}

}  // namespace tarsier::sfm
