// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/face/shape/show.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/session.h"
#include <string>
#include <vector>

namespace tarsier {

// Shows the images of a set one by one.
// State: {"image", "images", "path", "missing", "mirrored", "numbers", "symmetry", "lines",
// "help"}.
class LandmarkSetSession final : public Session {
 public:
  // Throws std::invalid_argument for a set without samples.
  LandmarkSetSession(face::shape::LandmarkSet set, std::string set_path,
                     const face::shape::LandmarkStyle& style, bool mirrored);

  View on_frame(const Frame&, const SourceStatus&) override { return view(); }
  View on_idle(const SourceStatus&) override { return view(); }
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

 private:
  void open();
  View view();

  face::shape::LandmarkSet set_;
  std::string set_path_;
  face::shape::LandmarkStyle style_;
  bool mirrored_ = false;
  SessionControls controls_;
  int current_ = 0;
  cv::Mat image_;
  std::string read_error_;
  cv::Mat shown_;
};

// Shows a shape model with one slider for each of its first modes, in standard deviations, and an
// animation of one mode after the other (each on_idle is one step). State: {"mode", "modes",
// "values", "animated", "help"}.
class ShapeModelSession final : public Session {
 public:
  explicit ShapeModelSession(face::shape::ShapeModel model);

  View on_frame(const Frame&, const SourceStatus&) override { return view(); }
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override;

 private:
  View view();

  face::shape::ShapeModel model_;
  Eigen::VectorXd sigmas_;  // b / deviation
  int mode_ = 0;
  int phase_ = 0;
  bool animated_ = true;
  SessionControls controls_;
  cv::Mat shown_;
};

}  // namespace tarsier
