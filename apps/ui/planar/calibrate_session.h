// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/undistort.h"
#include "tarsier/planar/pipelines/calibrator.h"

#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/session.h"
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// Calibrates a camera while a person moves a board in front of it: shows what a live
// planar::Calibrator takes and where the board was not yet seen, and computes the camera again with
// every view.
// Keys: space takes the view now, whatever it is; z forgets the last one, x all; c calibrates now;
// u shows the straightened image; m what is covered; p pauses; h help; q or Esc ends. State:
// {"views", "coverage", "verdict", "missing": [..], "cells": views that touch each cell, rows of
// columns, "per_view": [{"points", "rms" px, "tilt" degrees; these two of the latest calibration}],
// "calibrated", "rms", "fx", "refusal", "straight", "paused"}.
class CalibrateSession final : public Session {
 public:
  // Throws std::invalid_argument unless the calibrator is a live one.
  explicit CalibrateSession(planar::Calibrator calibrator);

  // Frames of another size than the first one are shown and not used. Throws nothing of its own.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // What was seen so far; the views that were taken are state().images.
  [[nodiscard]] const planar::CalibratorState& state() const { return state_; }
  [[nodiscard]] const std::optional<planar::CalibrationResult>& result() const { return result_; }
  [[nodiscard]] std::string verdict() const { return verdict_; }

 private:
  void apply(const planar::CalibratorAnswer& answer);
  void forget(bool all);
  void calibrate_now();
  void draw();
  void draw_text();
  [[nodiscard]] bool ok() const { return result_ && result_->ok(); }
  [[nodiscard]] const planar::calibration::Coverage* coverage() const;
  [[nodiscard]] std::string advice() const;
  View view(bool fresh);

  planar::Calibrator calibrator_;
  planar::CalibratorState state_;
  std::optional<planar::CalibrationResult> result_;
  std::string verdict_ = "no board";
  std::string source_;
  Frame frame_;
  cv::Mat shown_;
  cv::Mat output_;
  std::optional<geometry::Straightener> straightener_;  // of the latest calibration
  int flash_ = 0;                                       // frames that still tell of a view taken
  bool straight_ = false;
  bool shows_coverage_ = true;
  SessionControls controls_{true, 'p'};  // space takes a view
};

}  // namespace tarsier
