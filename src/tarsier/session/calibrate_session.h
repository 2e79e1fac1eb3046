// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/undistort.h"
#include "tarsier/planar/calibration/calibrate.h"
#include "tarsier/planar/calibration/collector.h"
#include "tarsier/session/session.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

struct CalibrateSessionOptions {
  planar::calibration::BoardSpec board;
  planar::calibration::CalibrateOptions calibrate;
  // min_sharpness, min_move, most; still_px is of a picture 640 px wide, and scaled to others.
  planar::calibration::CollectorOptions collect{0.12, 2.0, 0.05, 12, 40};
  // px, the larger side of the picture in which the board is looked for: the search then takes tens
  // of milliseconds, with a board or without.
  int search_px = 480;
  bool keep_pictures = false;  // of the views
  void check() const;          // throws std::invalid_argument
};

// A view that was taken.
struct TakenView {
  std::int64_t index = 0;  // of the frame
  double time = 0;         // s
  cv::Mat image;           // where pictures are kept
};

// Calibrates a camera while a person moves a board in front of it: takes a view whenever the board
// is still, sharp and shows something new, tells where the board was not yet seen, and computes the
// camera again with every view. While no board is seen for long, it is looked for in every third
// frame only, so that the picture does not falter.
// Keys: space takes the view now, whatever it is; z forgets the last one, x all; c calibrates now;
// u shows the straightened picture; m what is covered; p pauses; h help; q or Esc ends. State:
// {"views", "coverage", "verdict", "missing": [..], "calibrated", "rms", "fx", "refusal",
// "straight", "paused"}.
class CalibrateSession final : public Session {
 public:
  explicit CalibrateSession(CalibrateSessionOptions options);

  // Frames of another size than the first one are shown and not used. Throws nothing of its own.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  [[nodiscard]] const std::vector<TakenView>& taken() const { return taken_; }
  [[nodiscard]] std::vector<planar::calibration::BoardView> views() const;
  [[nodiscard]] cv::Size size() const { return size_; }
  [[nodiscard]] const std::optional<planar::calibration::Calibration>& calibration() const {
    return calibration_;
  }
  [[nodiscard]] std::string verdict() const { return verdict_; }

 private:
  void look(const Frame& frame);
  void apply(const planar::calibration::ViewCollector::Answer& answer);
  void take_now();
  void forget(bool all);
  void calibrate_now();
  void draw();
  void draw_text();
  [[nodiscard]] std::string advice() const;
  View view(bool fresh);

  CalibrateSessionOptions options_;
  std::optional<planar::calibration::ViewCollector> collector_;
  std::vector<TakenView> taken_;  // as the collector's views
  std::optional<planar::calibration::Calibration> calibration_;
  planar::calibration::BoardView board_;  // of the latest frame
  double sharpness_ = 0;
  cv::Size size_;
  std::string verdict_ = "no board";
  std::string source_;
  Frame frame_;
  cv::Mat shown_;
  cv::Mat output_;
  std::optional<geometry::Straightener> straightener_;  // of the latest calibration
  int empty_frames_ = 0;                                // since a board was seen
  int misses_ = 0;                                      // searches of these
  bool even_light_ = false;                             // how it is looked for: see FindOptions
  int flash_ = 0;                                       // frames that still tell of a view taken
  bool straight_ = false;
  bool coverage_ = true;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
