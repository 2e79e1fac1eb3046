// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/undistort.h"
#include "tarsier/planar/pipelines/calibrator.h"

#include <opencv2/core/mat.hpp>

#include "ui/frame_session.h"
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// Calibrates a camera while a person moves a board in front of it. Shows which views a live
// planar::Calibrator accepts and where the board was not yet seen, and recalibrates with every
// view.
// Keys: space takes the current view in any case; z drops the last view, x all; c calibrates now; u
// shows the undistorted image; m the coverage; p pauses; h help; q or Esc quits. State: {"views",
// "coverage", "verdict", "missing": [..], "cells": number of views that touch each cell, rows of
// columns, "per_view": [{"points", "rms" px, "tilt" degrees; the latter two from the latest
// calibration}], "calibrated", "rms", "fx", "refusal", "straight", "paused"}.
class CalibrateSession final : public FrameSession {
 public:
  // Throws std::invalid_argument unless the calibrator is a live one.
  explicit CalibrateSession(planar::Calibrator calibrator);

  // The state of the calibrator; calibrator_state().images has the accepted views. Frames of
  // another size than the first one are shown but not used.
  [[nodiscard]] const planar::CalibratorState& calibrator_state() const { return state_; }
  [[nodiscard]] const std::optional<planar::CalibrationResult>& result() const { return result_; }
  [[nodiscard]] std::string view_status() const { return view_status_; }

 private:
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  void draw_shown(cv::Mat& image) override;
  bool act(const std::string& name) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::string note() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;

  void apply(const planar::CalibratorAnswer& answer);
  void drop_views(bool all);
  void calibrate_now();
  // The calibrated camera; null if there is none.
  [[nodiscard]] const planar::calibration::Calibration* current_calibration() const {
    return result_ && result_->ok() ? &result_->calibration : nullptr;
  }
  [[nodiscard]] const planar::calibration::Coverage* coverage() const;
  [[nodiscard]] std::string advice() const;

  planar::Calibrator calibrator_;
  planar::CalibratorState state_;
  std::optional<planar::CalibrationResult> result_;
  std::string view_status_ = "no board";
  std::optional<geometry::Undistorter> undistorter_;  // of the latest calibration
  int flash_ = 0;  // remaining frames that show that a view was accepted
  bool shows_undistorted_ = false;
  bool shows_coverage_ = true;
};

}  // namespace tarsier
