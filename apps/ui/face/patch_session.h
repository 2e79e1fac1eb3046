// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/regression/patches.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/session.h"
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// An image on which patches are tested.
struct PatchImage {
  std::string name;
  cv::Mat gray;             // CV_8UC1
  Eigen::Matrix2Xd points;  // px, where the patches are tested
};

// Shows the patches of a model one by one: the position on the mean face, the weights and their
// gradient and, if there is an image, the search window and the response there. A click on the mean
// face selects the nearest patch. State: {"patch", "patches", "image", "search", "response",
// "peak": [dx, dy] from the point in px of the patches, or null, "help"}.
class PatchSession final : public Session {
 public:
  // Throws std::invalid_argument if patches, shape and points do not fit together.
  PatchSession(face::regression::PatchModels model, face::shape::ShapeModel shape,
               std::optional<PatchImage> image);

  View on_frame(const Frame&, const SourceStatus&) override { return view(); }
  View on_idle(const SourceStatus&) override { return view(); }
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

 private:
  void compute_responses();
  [[nodiscard]] int patch_at(double x, double y) const;
  void click(double x, double y);
  void draw_face();
  void draw_patch();
  void draw_image();
  View view();

  face::regression::PatchModels model_;
  face::shape::ShapeModel shape_;
  std::optional<PatchImage> image_;
  std::vector<face::regression::PointResponse> responses_;
  int current_ = 0;
  int search_ = 21;
  SessionControls controls_;
  cv::Rect face_;          // the mean face in the view
  double face_scale_ = 1;  // px of the view per px of the patches' frame
  cv::Mat shown_;
};

}  // namespace tarsier
