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
constexpr double kMinFollowed = 0.3;  // share of the corners; with fewer, the track is lost
constexpr float kMaxReturnError = 1;  // px, forward and backward
constexpr double kMinShare = 0.5;     // of min_motion, for a candidate
constexpr double kMaxShare = 2;
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
  const double apart = std::max(gray.cols, gray.rows) / 60.0;
  cv::goodFeaturesToTrack(gray, corners, kMaxCorners, 0.01, apart);
  return corners;
}

void follow(const cv::Mat& from, const cv::Mat& to, const std::vector<cv::Point2f>& start,
            std::vector<cv::Point2f>& end, std::vector<unsigned char>& found) {
  std::vector<float> ignored;
  lazy_opencv::optical_flow_pyr_lk(from, to, start, end, found, ignored, {21, 21}, 4,
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
  followed_ = corners_;
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
  std::vector<cv::Point2f> there = followed_;
  std::vector<cv::Point2f> back = corners_;
  std::vector<unsigned char> found;
  std::vector<unsigned char> found_back;
  follow(reference_, candidate.gray, corners_, there, found);
  follow(candidate.gray, reference_, there, back, found_back);
  std::vector<double> motions;
  std::vector<cv::Point2f> shifts;
  const cv::Rect2f inside(0, 0, static_cast<float>(candidate.gray.cols),
                          static_cast<float>(candidate.gray.rows));
  for (std::size_t k = 0; k < corners_.size(); ++k) {
    const cv::Point2f error = back[k] - corners_[k];
    const bool is_good = found[k] != 0 && found_back[k] != 0 && inside.contains(there[k]) &&
                         std::hypot(error.x, error.y) <= kMaxReturnError;
    if (!is_good) continue;
    followed_[k] = there[k];
    const cv::Point2f shift = there[k] - corners_[k];
    motions.push_back(std::hypot(shift.x, shift.y));
  }
  if (static_cast<double>(motions.size()) <
      std::max<double>(kMinCorners / 2.0, kMinFollowed * static_cast<double>(corners_.size()))) {
    candidate.is_lost = true;
    return;
  }
  const auto middle = motions.begin() + static_cast<std::ptrdiff_t>(motions.size() / 2);
  std::nth_element(motions.begin(), middle, motions.end());
  candidate.motion = *middle / std::hypot(candidate.gray.cols, candidate.gray.rows);
}

// Sets or clears the moment at which a key frame is due.
void KeyframePicker::watch(const Candidate& candidate, std::size_t place) {
  lost_ = candidate.is_lost ? lost_ + 1 : 0;
  if (moment_) {
    // The corners are found again after a blur, and the camera has not moved away.
    const bool is_back = !candidate.is_lost && candidate.motion < kMinShare * options_.min_motion;
    if (is_back) moment_.reset();
    return;
  }
  if (candidate.motion >= options_.min_motion || lost_ >= std::max(1, options_.window / 2))
    moment_ = place;
}

// Whether all frames around the moment have arrived, or the camera is moving too far away.
bool KeyframePicker::is_due() const {
  if (!moment_) return false;
  const std::size_t ahead = static_cast<std::size_t>(options_.window - 1) / 2;
  return waiting_.size() > *moment_ + ahead ||
         waiting_.back().motion > kMaxShare * options_.min_motion;
}

// Chooses the best of waiting_[begin, end). The frames after it are measured again from there.
std::optional<Keyframe> KeyframePicker::choose(std::size_t begin, std::size_t end,
                                               std::size_t moment) {
  const double half = std::max(1.0, options_.window / 2.0);
  std::optional<std::size_t> best;
  double most = -1;
  const auto distance_of = [&](std::size_t k) {
    return std::abs(static_cast<double>(k) - static_cast<double>(moment));
  };
  for (std::size_t k = begin; k < end; ++k) {
    const Candidate& candidate = waiting_[k];
    const bool is_near = candidate.motion >= kMinShare * options_.min_motion &&
                         candidate.motion <= kMaxShare * options_.min_motion;
    // The moment itself is always allowed, as a fast camera may leave no other frame. A frame after
    // a cut needs corners of its own, so that a fade to black gives no key frame.
    const bool is_allowed = candidate.is_lost ? corners_of(candidate.gray).size() >= kMinCorners
                                              : is_near || k == moment;
    if (!is_allowed) continue;
    const double score =
        candidate.sharpness * (1 - kDistancePenalty * std::min(1.0, distance_of(k) / half));
    if (score > most) {
      most = score;
      best = k;
    }
  }
  if (!best) {
    waiting_.clear();
    moment_.reset();
    lost_ = 0;
    return std::nullopt;
  }
  const Candidate chosen = waiting_[*best];
  waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(*best) + 1);
  moment_.reset();
  lost_ = 0;
  set_reference(chosen.gray);
  for (std::size_t k = 0; k < waiting_.size(); ++k) {
    measure(waiting_[k]);
    watch(waiting_[k], k);
  }
  ++count_;
  return Keyframe{chosen.image, chosen.index, chosen.time, chosen.motion, chosen.sharpness};
}

std::optional<Keyframe> KeyframePicker::offer(const cv::Mat& frame, std::int64_t index,
                                              double time) {
  const bool is_frame =
      frame.dims == 2 && !frame.empty() && (frame.type() == CV_8UC3 || frame.type() == CV_8UC1);
  TARSIER_REQUIRE(is_frame, "{}x{}, type {} is no 8-bit frame", frame.cols, frame.rows,
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
  waiting_.push_back(std::move(candidate));
  watch(waiting_.back(), waiting_.size() - 1);
  while (!moment_ && waiting_.size() > static_cast<std::size_t>(options_.window))
    waiting_.pop_front();
  if (!is_due()) return std::nullopt;
  const std::size_t before = static_cast<std::size_t>(options_.window) / 2;
  const std::size_t begin = *moment_ - std::min(*moment_, before);
  return choose(begin, waiting_.size(), *moment_);
}

std::optional<Keyframe> KeyframePicker::finish() {
  if (waiting_.empty() || count_ >= options_.max_count) return std::nullopt;
  const std::size_t size = waiting_.size();
  const std::size_t window = std::min(size, static_cast<std::size_t>(options_.window));
  const Candidate& last = waiting_.back();
  const bool has_moved = moment_ || last.motion >= kMinShare * options_.min_motion;
  std::optional<Keyframe> result;
  if (has_moved) result = choose(size - window, size, size - 1);
  waiting_.clear();
  moment_.reset();
  return result;
}

}  // namespace tarsier::sfm
