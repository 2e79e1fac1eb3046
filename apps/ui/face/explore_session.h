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

// An image that a face is drawn over: its points and what the model makes of them.
struct ExploredImage {
  cv::Mat image;            // CV_8UC3
  Eigen::Matrix2Xd points;  // 2 x n, px
};

// Plays with an appearance model: a slider for each of the first modes of its shape and of its
// look, in standard deviations; the face that they make, by itself or over an image.
// Sliders "shape 1" .., "look 1" ..: the first four of each in a window, all of them where the host has room for them
// (draw_status(false)); keys: 0 the mean, r a random face, f the face of the image,
// o over the image or by itself, m mesh; n and p choose a mode, + and - move it, also those
// without a slider; h help, q or Esc ends.
// State: {"shape": [..], "look": [..] (deviations), "mode", "over", "mesh"}.
class ExploreSession final : public Session {
 public:
  // The model must outlive the session; it must be one that can be drawn (see Synthesis).
  ExploreSession(const face::appearance::AppearanceModel& model, std::optional<ExploredImage> image,
                 std::uint64_t seed);

  View on_frame(const Frame&, const SourceStatus&) override { return view(); }
  View on_idle(const SourceStatus&) override { return view(); }
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override;

  // The face as it is, without bars and help: what `-o` writes.
  [[nodiscard]] cv::Mat image() const;

 private:
  void take_from_image();
  [[nodiscard]] double* value_of(const std::string& name);
  [[nodiscard]] std::string mode_name() const;
  View view();

  const face::appearance::AppearanceModel& model_;
  face::appearance::Synthesis synthesis_;
  std::optional<ExploredImage> base_;
  face::shape::ShapeFit placed_;      // of the image's points
  face::appearance::Explained seen_;  // of the image
  Eigen::VectorXd shape_;             // b / deviation
  Eigen::VectorXd look_;              // c / deviation
  std::uint64_t seed_;
  int mode_ = 0;  // that + and - move: those of the shape, then those of the look
  bool over_ = false;
  bool mesh_ = false;
  SessionControls controls_;
  cv::Mat shown_;
};

// The two first modes of a shape model and two sliders: the shape they make among the shapes that
// were learnt from. State: {"values": [a, b], "training"}.
class ShapePlayground final : public Session {
 public:
  // `shapes`: what the model was learnt from.
  ShapePlayground(face::shape::ShapeModel model, const std::vector<Eigen::Matrix2Xd>& shapes);

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
  bool training_ = true;
  SessionControls controls_;
  cv::Mat shown_;
};

}  // namespace tarsier
