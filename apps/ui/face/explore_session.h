// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/session.h"
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// An image over which a face is drawn: its points, to which the model is fitted.
struct ExploredImage {
  cv::Mat image;            // CV_8UC3
  Eigen::Matrix2Xd points;  // 2 x n, px
};

// Explores an appearance model with sliders for the first modes of shape and of appearance
// ("look"), in standard deviations. Shows the resulting face, alone or over an image. Sliders:
// "shape 1" .., "look 1" ..: the first four of each in a window, all of them if the host has room
// for them (draw_status(false)). Keys: 0 the mean, r a random face, f the face of the image, o over
// the image or alone, m mesh; n and p choose a mode, + and - move it, also modes without a slider;
// h help, q or Esc quits. State: {"shape": [..], "look": [..] (deviations), "mode", "over",
// "mesh"}.
class ExploreSession final : public Session {
 public:
  // The model must outlive the session and must be drawable (see Synthesis).
  ExploreSession(const face::appearance::AppearanceModel& model, std::optional<ExploredImage> image,
                 std::uint64_t seed);

  View on_frame(const Frame&, const SourceStatus&) override { return view(); }
  View on_idle(const SourceStatus&) override { return view(); }
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override;

  // The face without bars and help, as written by `-o`.
  [[nodiscard]] cv::Mat image() const;

 private:
  void reset_to_image();
  [[nodiscard]] double* value_of(const std::string& name);
  [[nodiscard]] std::string mode_name() const;
  View view();

  const face::appearance::AppearanceModel& model_;
  face::appearance::Synthesis synthesis_;
  std::optional<ExploredImage> base_;
  face::shape::ShapeFit image_shape_;              // the fit to the image's points
  face::appearance::TextureFit image_appearance_;  // of the image
  Eigen::VectorXd shape_;                          // b / deviation
  Eigen::VectorXd appearance_;                     // c / deviation
  std::uint64_t seed_;
  int mode_ = 0;  // moved by + and -: modes of the shape, then modes of the look
  bool over_image_ = false;
  bool mesh_ = false;
  SessionControls controls_;
  cv::Mat shown_;
};

// Two sliders for the first two modes of a shape model. Shows the resulting shape among the
// training shapes. State: {"values": [a, b], "training"}.
class ShapeSpaceSession final : public Session {
 public:
  // `shapes` are the training shapes of the model.
  ShapeSpaceSession(face::shape::ShapeModel model, const std::vector<Eigen::Matrix2Xd>& shapes);

  View on_frame(const Frame&, const SourceStatus&) override { return view(); }
  View on_idle(const SourceStatus&) override { return view(); }
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override;
  [[nodiscard]] cv::Mat image() const;

 private:
  View view();

  face::shape::ShapeModel model_;
  std::vector<Eigen::Matrix2Xd> aligned_;  // in the model's frame
  std::vector<Eigen::VectorXd> scores_;    // b / deviation of each
  Eigen::VectorXd sigmas_;
  bool shows_training_shapes_ = true;
  SessionControls controls_;
  cv::Mat shown_;
};

}  // namespace tarsier
