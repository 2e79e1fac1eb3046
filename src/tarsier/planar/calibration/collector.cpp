// SPDX-License-Identifier: MIT
#include "tarsier/planar/calibration/collector.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <utility>

namespace tarsier::planar::calibration {
namespace {

constexpr double kMinSharpnessRatio =
    1.15;  // a view replaces a similar one if it is this much sharper
constexpr std::array<std::string_view, 7> kNames{"taken",   "replaced", "no board", "moving",
                                                 "blurred", "alike",    "full"};

}  // namespace

std::string_view name_of(ViewDecision decision) {
  return kNames[static_cast<std::size_t>(decision)];
}

ViewCollector::ViewCollector(const BoardSpec& spec, cv::Size size, const CollectorOptions& options)
    : spec_(spec), options_(options) {
  spec.check();
  options.check();
  TARSIER_REQUIRE(size.width > 0 && size.height > 0, "{}x{} px", size.width, size.height);
  coverage_.size = size;
}

ViewCollector::Answer ViewCollector::offer(const BoardView& view, double sharpness, bool is_still) {
  const BoardView before = std::exchange(last_, view);
  if (view.empty()) return {ViewDecision::kNoBoard};
  if (!is_still && options_.still_px > 0 &&
      (before.empty() || !(view_distance(before, view) <= options_.still_px))) {
    return {ViewDecision::kMoving};
  }
  const bool checks_sharpness =
      spec_.kind == BoardKind::kChess || spec_.kind == BoardKind::kCharuco;
  if (checks_sharpness && sharpness < options_.min_sharpness) return {ViewDecision::kBlurred};
  const double min_distance =
      options_.min_move * std::max(coverage_.size.width, coverage_.size.height);
  const cv::Point2d tilt = tilt_of(view, spec_, coverage_.size);
  std::size_t near = views_.size();
  int similar = 0;
  for (std::size_t i = 0; i < views_.size(); ++i) {
    if (view_distance(view, views_[i]) >= min_distance ||
        cv::norm(tilt - tilts_[i]) >= options_.min_turn_deg)
      continue;
    near = i;
    ++similar;
  }
  if (similar > 0) {
    if (similar > 1 || sharpness < kMinSharpnessRatio * sharpness_[near])
      return {ViewDecision::kTooSimilar};
    views_[near] = view;
    tilts_[near] = tilt;
    sharpness_[near] = sharpness;
    recount();
    return {ViewDecision::kReplaced, near};
  }
  if (static_cast<int>(views_.size()) >= options_.max_views) return {ViewDecision::kFull};
  return force(view, sharpness);
}

ViewCollector::Answer ViewCollector::force(const BoardView& view, double sharpness) {
  if (view.empty()) return {ViewDecision::kNoBoard};
  views_.push_back(view);
  sharpness_.push_back(sharpness);
  tilts_.push_back(tilt_of(view, spec_, coverage_.size));
  coverage_.add(view, spec_);
  return {ViewDecision::kAccepted, views_.size() - 1};
}

void ViewCollector::undo() {
  if (!views_.empty()) remove(views_.size() - 1);
}

void ViewCollector::remove(std::size_t index) {
  TARSIER_REQUIRE(index < views_.size(), "view {} of {}", index, views_.size());
  views_.erase(views_.begin() + static_cast<std::ptrdiff_t>(index));
  tilts_.erase(tilts_.begin() + static_cast<std::ptrdiff_t>(index));
  sharpness_.erase(sharpness_.begin() + static_cast<std::ptrdiff_t>(index));
  recount();
}

void ViewCollector::recount() { coverage_ = coverage_of(views_, spec_, coverage_.size); }

}  // namespace tarsier::planar::calibration
