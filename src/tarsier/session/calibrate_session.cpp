// SPDX-License-Identifier: MIT
#include "tarsier/session/calibrate_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/planar/calibration/coverage.h"
#include "tarsier/planar/calibration/draw_board.h"
#include "tarsier/session/overlay.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier {
namespace {

using planar::calibration::Verdict;

constexpr int kPatience = 15;    // frames without a board, then it is looked for ..
constexpr int kSearchEvery = 3;  // .. in every third one
constexpr int kTurns = 3;        // searches in vain, then the other way to look is tried
constexpr int kFlash = 8;        // frames that a view taken is told of
constexpr double kCoverageTint = 0.22;
const cv::Scalar kGood(90, 220, 90);
const cv::Scalar kWait(60, 200, 255);
const cv::Scalar kPlain(235, 235, 235);

std::string words_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kTaken:
      return "taken";
    case Verdict::kReplaced:
      return "taken: sharper than before";
    case Verdict::kNoBoard:
      return "no board seen";
    case Verdict::kMoving:
      return "hold the board still";
    case Verdict::kBlurred:
      return "blurred: more light, or hold still";
    case Verdict::kAlike:
      return "seen before: move on";
    case Verdict::kFull:
      break;
  }
  return "that is enough: q ends";
}

}  // namespace

void CalibrateSessionOptions::check() const {
  board.check();
  calibrate.check();
  collect.check();
  TARSIER_REQUIRE(search_px >= 160 && search_px <= 4000, "search_px {}", search_px);
}

CalibrateSession::CalibrateSession(CalibrateSessionOptions options) : options_(std::move(options)) {
  options_.check();
}

std::vector<planar::calibration::BoardView> CalibrateSession::views() const {
  return collector_ ? collector_->views() : std::vector<planar::calibration::BoardView>();
}

View CalibrateSession::on_frame(const Frame& frame, const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  if (paused_ && !frame_.image.empty()) return view(false);
  frame_ = frame;
  if (flash_ > 0) --flash_;
  if (!collector_) {
    size_ = frame.image.size();
    planar::calibration::CollectorOptions collect = options_.collect;
    collect.still_px *= std::max(1.0, std::max(size_.width, size_.height) / 640.0);
    collector_.emplace(options_.board, size_, collect);
  }
  if (frame.image.size() == size_) {
    look(frame);
  } else {
    board_ = {};
    verdict_ = "another size";
  }
  draw();
  return view(true);
}

void CalibrateSession::look(const Frame& frame) {
  const bool waits = !frame.still && empty_frames_ >= kPatience;
  if (waits && empty_frames_ % kSearchEvery != 0) {
    ++empty_frames_;
    return;
  }
  planar::calibration::FindOptions find;
  find.search_px = options_.search_px;
  find.patient = frame.still;
  find.even_light = !frame.still && even_light_;
  board_ = planar::calibration::find_board(frame.image, options_.board, find);
  empty_frames_ = board_.empty() ? empty_frames_ + 1 : 0;
  misses_ = board_.empty() ? misses_ + 1 : 0;
  if (misses_ > 0 && misses_ % kTurns == 0) even_light_ = !even_light_;
  sharpness_ = planar::calibration::sharpness_of(frame.image, board_, options_.board);
  apply(collector_->offer(board_, sharpness_, frame.still));
}

void CalibrateSession::apply(const planar::calibration::ViewCollector::Answer& answer) {
  verdict_ = name_of(answer.verdict);
  if (answer.verdict != Verdict::kTaken && answer.verdict != Verdict::kReplaced) return;
  TakenView taken{frame_.index, frame_.time, {}};
  if (options_.keep_pictures) taken.image = frame_.image.clone();
  if (answer.verdict == Verdict::kTaken) {
    taken_.push_back(std::move(taken));
  } else {
    taken_[answer.index] = std::move(taken);
  }
  flash_ = kFlash;
  calibrate_now();
}

void CalibrateSession::take_now() {
  if (frame_.image.empty() || board_.empty() || frame_.image.size() != size_) {
    verdict_ = name_of(Verdict::kNoBoard);
    return;
  }
  if (static_cast<int>(taken_.size()) >= options_.collect.most) {
    verdict_ = name_of(Verdict::kFull);
    return;
  }
  apply(collector_->force(board_, sharpness_));
}

void CalibrateSession::forget(bool all) {
  if (!collector_) return;
  while (!taken_.empty()) {
    collector_->undo();
    taken_.pop_back();
    if (!all) break;
  }
  flash_ = 0;
  calibration_.reset();
  if (!taken_.empty()) calibrate_now();
  if (!calibration_) straight_ = false;
}

void CalibrateSession::calibrate_now() {
  planar::calibration::CalibrateOptions how = options_.calibrate;
  if (calibration_ && calibration_->ok()) how.start = calibration_->camera;
  calibration_ = planar::calibration::calibrate(views(), options_.board, size_, how);
  straightener_.reset();
  if (!calibration_->ok()) straight_ = false;
}

View CalibrateSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(name_of(source.state));
  return view(false);
}

View CalibrateSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  if (name == "quit") finished_ = true;
  if (name == "pause") paused_ = !paused_;
  if (name == "help") help_ = !help_;
  if (name == "take") take_now();
  if (name == "undo") forget(false);
  if (name == "restart") forget(true);
  if (name == "calibrate" && collector_) calibrate_now();
  if (name == "straight") straight_ = !straight_ && calibration_ && calibration_->ok();
  if (name == "coverage") coverage_ = !coverage_;
  if (!frame_.image.empty()) draw();
  return view(false);
}

std::vector<Action> CalibrateSession::actions() const {
  return {{"take", "take this view now", key::kSpace},
          {"undo", "forget the last view", 'z'},
          {"restart", "forget all views", 'x'},
          {"calibrate", "calibrate now", 'c'},
          {"straight", "the straightened picture", 'u'},
          {"coverage", "what is covered", 'm'},
          {"pause", "pause and go on", 'p'},
          {"help", "this list", 'h'},
          {"quit", "end", 'q'}};
}

// What to do next, in a line.
std::string CalibrateSession::advice() const {
  if (!collector_) return "";
  const std::vector<std::string> missing = collector_->coverage().missing();
  if (!missing.empty()) return "show: " + missing.front();
  return "enough: q ends";
}

void CalibrateSession::draw() {
  frame_.image.copyTo(output_);
  if (straight_ && calibration_ && calibration_->ok() && frame_.image.size() == size_) {
    try {
      if (!straightener_) {
        const geometry::Camera& from = calibration_->camera;
        straightener_.emplace(from, geometry::undistorted_camera(from));
      }
      output_ = (*straightener_)(frame_.image);
    } catch (const Error&) {  // a distortion that cannot be undone at the border
      straight_ = false;
      verdict_ = "cannot be straightened";
    }
  } else {
    if (coverage_ && collector_) draw_coverage(output_, collector_->coverage(), kCoverageTint);
    if (!board_.empty()) draw_view(output_, board_, options_.board);
  }
  output_.copyTo(shown_);
  draw_text();
}

void CalibrateSession::draw_text() {
  const bool took = flash_ > 0;
  std::string line = straight_ ? "straightened: lines of the world are straight" : verdict_;
  for (const Verdict verdict :
       {Verdict::kTaken, Verdict::kReplaced, Verdict::kNoBoard, Verdict::kMoving, Verdict::kBlurred,
        Verdict::kAlike, Verdict::kFull}) {
    if (line == name_of(verdict)) {
      line = words_of(verdict);
      break;
    }
  }
  if (took && !straight_) line = fmt::format("view {} taken", taken_.size());
  image::draw::TextStyle style;
  style.color = straight_ ? kPlain : took ? kGood : board_.empty() ? kPlain : kWait;
  style.backing = image::draw::Backing::kBox;
  const int margin = std::max(4, shown_.cols / 100);
  const cv::Rect box = image::draw::put_text(shown_, line, {margin, margin}, style);
  style.height_px = std::max(8.0, 0.75 * image::draw::fitting_text_height(shown_.size()));
  style.color = kPlain;
  image::draw::put_text(shown_, advice(), {margin, box.y + box.height + margin / 2}, style);
  if (took && !straight_) {
    cv::rectangle(shown_, cv::Rect(0, 0, shown_.cols, shown_.rows), kGood,
                  std::max(2, shown_.cols / 160));
  }
  std::string right;
  if (calibration_ && calibration_->ok()) {
    // Short: the bar gives its right half at most.
    right = fmt::format("fx {:.1f}+-{:.1f} rms {:.2f}", calibration_->camera.fx,
                        calibration_->deviations.fx, calibration_->camera.rms);
  } else if (!taken_.empty()) {
    right = "not yet calibrated";
  }
  const double share = collector_ ? collector_->coverage().share() : 0;
  image::draw::status_bar(shown_,
                          fmt::format("{} {}, {:.0f} % covered", taken_.size(),
                                      taken_.size() == 1 ? "view" : "views", 100 * share),
                          right);
  if (help_) draw_help(shown_, "Calibrate", actions());
}

View CalibrateSession::view(bool fresh) {
  View view;
  view.image = shown_;
  if (fresh) view.output = output_;
  const double share = collector_ ? collector_->coverage().share() : 0;
  view.status =
      fmt::format("{} views, {:.0f} % covered, {}{}{}", taken_.size(), 100 * share, verdict_,
                  paused_ ? ", paused" : "", source_.empty() ? "" : ", " + source_);
  nlohmann::json& state = view.state;
  state["views"] = taken_.size();
  state["coverage"] = std::round(share * 1e3) / 1e3;
  state["verdict"] = verdict_;
  state["missing"] = collector_ ? collector_->coverage().missing() : std::vector<std::string>();
  const bool ok = calibration_ && calibration_->ok();
  state["calibrated"] = ok;
  state["rms"] = ok ? std::round(calibration_->camera.rms * 1e4) / 1e4 : 0.0;
  state["fx"] = ok ? std::round(calibration_->camera.fx * 1e3) / 1e3 : 0.0;
  state["refusal"] = calibration_ ? calibration_->refusal : "";
  state["straight"] = straight_;
  state["paused"] = paused_;
  view.finished = finished_;
  return view;
}

}  // namespace tarsier
