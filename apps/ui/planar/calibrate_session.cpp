// SPDX-License-Identifier: MIT
#include "ui/planar/calibrate_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/planar/calibration/coverage.h"
#include "tarsier/planar/calibration/draw_board.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

using planar::calibration::ViewDecision;

constexpr int kAcceptedFrames = 8;  // frames that show that a view was accepted
constexpr double kCoverageTint = 0.22;
const cv::Scalar kGood(90, 220, 90);
const cv::Scalar kWait(60, 200, 255);
const cv::Scalar kPlain(235, 235, 235);

std::string words_of(ViewDecision decision) {
  switch (decision) {
    case ViewDecision::kAccepted:
      return "view accepted";
    case ViewDecision::kReplaced:
      return "accepted: sharper than before";
    case ViewDecision::kNoBoard:
      return "no board detected";
    case ViewDecision::kMoving:
      return "hold the board still";
    case ViewDecision::kBlurred:
      return "blurred: add light or hold still";
    case ViewDecision::kTooSimilar:
      return "too similar: move the board";
    case ViewDecision::kFull:
      break;
  }
  return "enough views: q to quit";
}

}  // namespace

CalibrateSession::CalibrateSession(planar::Calibrator calibrator)
    : FrameSession("Calibrate", 'p'), calibrator_(std::move(calibrator)) {  // space takes a view
  TARSIER_REQUIRE(calibrator_.options().live, "a session needs a live calibrator");
}

const planar::calibration::Coverage* CalibrateSession::coverage() const {
  return state_.collector ? &state_.collector->coverage() : nullptr;
}

void CalibrateSession::process(const Frame& frame) {
  if (flash_ > 0) --flash_;
  apply(calibrator_.process(frame, state_));
}

void CalibrateSession::apply(const planar::CalibratorAnswer& answer) {
  view_status_ = answer.decision ? std::string(name_of(*answer.decision)) : "another size";
  if (!answer.is_accepted()) return;
  flash_ = kAcceptedFrames;
  calibrate_now();
}

void CalibrateSession::drop_views(bool all) {
  do {
    calibrator_.forget_last(state_);
  } while (all && !state_.views.empty());
  flash_ = 0;
  result_.reset();
  if (!state_.views.empty()) calibrate_now();
  if (!result_) shows_undistorted_ = false;
}

void CalibrateSession::calibrate_now() {
  std::optional<geometry::Camera> start;
  if (current_calibration() != nullptr) start = current_calibration()->camera;
  result_ = calibrator_.calibrate(state_, start);
  undistorter_.reset();
  if (current_calibration() == nullptr) shows_undistorted_ = false;
}

bool CalibrateSession::act(const std::string& name) {
  if (name == "take") apply(calibrator_.take(state_));
  if (name == "undo") drop_views(false);
  if (name == "restart") drop_views(true);
  if (name == "calibrate" && coverage() != nullptr) calibrate_now();
  if (name == "straight")
    shows_undistorted_ = !shows_undistorted_ && current_calibration() != nullptr;
  if (name == "coverage") shows_coverage_ = !shows_coverage_;
  return true;
}

std::vector<Action> CalibrateSession::own_actions() const {
  return {{"take", "accept this view now", key::kSpace},
          {"undo", "remove the last view", 'z'},
          {"restart", "remove all views", 'x'},
          {"calibrate", "calibrate now", 'c'},
          {"straight", "show the undistorted image", 'u'},
          {"coverage", "show the coverage", 'm'}};
}

// The next thing to do, in one line.
std::string CalibrateSession::advice() const {
  if (coverage() == nullptr) return "";
  const std::vector<std::string> missing = coverage()->missing();
  if (!missing.empty()) return "show: " + missing.front();
  return "enough: q to quit";
}

void CalibrateSession::draw(cv::Mat& image) {
  if (shows_undistorted_ && current_calibration() != nullptr && frame().size() == state_.size) {
    try {
      if (!undistorter_) {
        const geometry::Camera& from = current_calibration()->camera;
        undistorter_.emplace(from, geometry::undistorted_camera(from));
      }
      image = (*undistorter_)(frame());
    } catch (const Error&) {  // a distortion that cannot be inverted at the border
      shows_undistorted_ = false;
      view_status_ = "cannot be undistorted";
    }
  } else {
    if (shows_coverage_ && coverage() != nullptr) draw_coverage(image, *coverage(), kCoverageTint);
    if (!state_.board.empty()) draw_view(image, state_.board, calibrator_.options().board);
  }
}

void CalibrateSession::draw_shown(cv::Mat& image) {
  const bool accepted = flash_ > 0;
  if (accepted && !shows_undistorted_) {
    cv::rectangle(image, cv::Rect(0, 0, image.cols, image.rows), kGood,
                  std::max(2, image.cols / 160));
  }
  if (!draws_status()) return;
  std::string line =
      shows_undistorted_ ? "undistorted: straight lines appear straight" : view_status_;
  for (const ViewDecision decision :
       {ViewDecision::kAccepted, ViewDecision::kReplaced, ViewDecision::kNoBoard,
        ViewDecision::kMoving, ViewDecision::kBlurred, ViewDecision::kTooSimilar,
        ViewDecision::kFull}) {
    if (line == name_of(decision)) {
      line = words_of(decision);
      break;
    }
  }
  if (accepted && !shows_undistorted_) line = fmt::format("view {} accepted", state_.views.size());
  image::draw::TextStyle style;
  style.color = shows_undistorted_     ? kPlain
                : accepted             ? kGood
                : state_.board.empty() ? kPlain
                                       : kWait;
  style.backing = image::draw::Backing::kBox;
  const int margin = std::max(4, image.cols / 100);
  const cv::Rect box = image::draw::put_text(image, line, {margin, margin}, style);
  style.height_px = std::max(8.0, 0.75 * image::draw::fitting_text_height(image.size()));
  style.color = kPlain;
  image::draw::put_text(image, advice(), {margin, box.y + box.height + margin / 2}, style);
}

// Short, because the bar has space for it only in its right half.
std::string CalibrateSession::note() const {
  const planar::calibration::Calibration* const now = current_calibration();
  if (now == nullptr) return state_.views.empty() ? "" : "not yet calibrated";
  return fmt::format("fx {:.1f}+-{:.1f} rms {:.2f}", now->camera.fx, now->deviations.fx,
                     now->camera.rms);
}

std::string CalibrateSession::status() const {
  return fmt::format("{}, {:.0f} % covered, {}", count_text(state_.views.size(), "view"),
                     100 * (coverage() != nullptr ? coverage()->share() : 0), view_status_);
}

nlohmann::json CalibrateSession::state() const {
  nlohmann::json state;
  state["views"] = state_.views.size();
  state["coverage"] = coverage() != nullptr ? std::round(coverage()->share() * 1e3) / 1e3 : 0.0;
  state["verdict"] = view_status_;
  state["missing"] = coverage() != nullptr ? coverage()->missing() : std::vector<std::string>();
  state["cells"] = nlohmann::json::array();
  if (const auto* covered = coverage()) {
    for (auto at = covered->cells.begin(); at < covered->cells.end();
         at += planar::calibration::kCoverageColumns)
      state["cells"].push_back(std::vector<int>(at, at + planar::calibration::kCoverageColumns));
  }
  state["per_view"] = nlohmann::json::array();
  for (std::size_t k = 0; k < state_.views.size(); ++k) {
    nlohmann::json line{{"points", state_.views[k].points.size()}};
    if (result_ && k < result_->calibration.views.size()) {
      const planar::calibration::ViewReport& report = result_->calibration.views[k];
      line["rms"] = std::round(report.rms * 1e4) / 1e4;
      line["tilt"] = std::round(report.tilt_deg * 10) / 10;
    }
    state["per_view"].push_back(std::move(line));
  }
  const planar::calibration::Calibration* const now = current_calibration();
  state["calibrated"] = now != nullptr;
  state["rms"] = now != nullptr ? std::round(now->camera.rms * 1e4) / 1e4 : 0.0;
  state["fx"] = now != nullptr ? std::round(now->camera.fx * 1e3) / 1e3 : 0.0;
  state["refusal"] = result_ ? result_->calibration.refusal : "";
  state["straight"] = shows_undistorted_;
  return state;
}

}  // namespace tarsier
