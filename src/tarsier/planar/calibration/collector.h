// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/calibration/coverage.h"
#include "tarsier/planar/calibration/detect.h"

#include <cstddef>
#include <string_view>
#include <vector>

namespace tarsier::planar::calibration {

struct CollectorOptions {
  // 1/px, minimum of sharpness_of(): an edge wider than 1 / min_sharpness px is blurred. 0 disables
  // the check. Dots are not checked.
  double min_sharpness = 0.12;
  // px per frame: maximum mean motion of the board's points since the last offered view. 0 disables
  // the check.
  double still_px = 0;
  // A new view differs from each kept view: its points are at least min_move (relative to the
  // image's larger side) away in the mean, or its tilt differs by at least min_turn_deg.
  double min_move = 0.05;
  double min_turn_deg = 12;
  int max_views = 40;  // maximum number of views

  [[nodiscard]] OptionFields fields() {
    return {{"min_sharpness", min_sharpness, range_below(0, 1)},
            {"still_px", still_px, at_least(0)},
            {"min_move", min_move, range_below(0, 1)},
            {"min_turn_deg", min_turn_deg, at_least(0)},
            {"most", max_views, range(3, 500)}};
  }
  void check() const { check_fields(*this); }
};

enum class ViewDecision {
  kAccepted,
  kReplaced,  // replaced a similar but less sharp view
  kNoBoard,
  kMoving,
  kBlurred,
  kTooSimilar,  // too similar to a kept view
  kFull
};
[[nodiscard]] std::string_view name_of(ViewDecision decision);  // "taken", "no board", "moving", ..

// Selects sharp and different views from the frames of a video or camera.
class ViewCollector {
 public:
  ViewCollector(const BoardSpec& spec, cv::Size size, const CollectorOptions& options);

  struct Answer {
    ViewDecision decision = ViewDecision::kNoBoard;
    std::size_t index = 0;  // of the view, if it was taken or replaced another one
  };
  // Offers the next view, in the order of time; also offer empty views, because they interrupt the
  // motion. `is_still`: a single image, whose motion is not checked.
  Answer offer(const BoardView& view, double sharpness, bool is_still = false);
  // Takes the view without any check, because a person requested it; not if it is empty.
  Answer force(const BoardView& view, double sharpness);
  void undo();  // removes the last view taken, if any
  void remove(std::size_t index);

  [[nodiscard]] const std::vector<BoardView>& views() const { return views_; }
  [[nodiscard]] const Coverage& coverage() const { return coverage_; }

 private:
  void recount();

  BoardSpec spec_;
  CollectorOptions options_;
  std::vector<BoardView> views_;
  std::vector<double> sharpness_;
  std::vector<cv::Point2d> tilts_;
  BoardView last_;
  Coverage coverage_;
};

}  // namespace tarsier::planar::calibration
