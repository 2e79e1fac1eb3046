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
  // 1/px, of sharpness_of(): a step of 1 / this many px is blurred. 0: any. Dots are not judged.
  double min_sharpness = 0.12;
  // px a frame, mean over the board's points since the last view offered: more is motion. 0: any.
  double still_px = 0;
  // What is new: the mean distance to every view taken before, as a share of the image's larger
  // side, or the tilt.
  double min_move = 0.05;
  double min_turn_deg = 12;
  int most = 40;  // views

  [[nodiscard]] OptionFields fields() {
    return {{"min_sharpness", min_sharpness, range_below(0, 1)},
            {"still_px", still_px, at_least(0)},
            {"min_move", min_move, range_below(0, 1)},
            {"min_turn_deg", min_turn_deg, at_least(0)},
            {"most", most, range(3, 500)}};
  }
  void check() const { check_fields(*this); }
};

enum class Verdict {
  kTaken,
  kReplaced,  // a view like one taken before, but sharper: in its place
  kNoBoard,
  kMoving,
  kBlurred,
  kAlike,  // nothing new
  kFull
};
[[nodiscard]] std::string_view name_of(Verdict verdict);  // "taken", "no board", "moving", ..

// Chooses sharp views that differ from the stream of a video's or a camera's views.
class ViewCollector {
 public:
  ViewCollector(const BoardSpec& spec, cv::Size size, const CollectorOptions& options);

  struct Answer {
    Verdict verdict = Verdict::kNoBoard;
    std::size_t index = 0;  // of the view, where it was taken or replaced another one
  };
  // The next view, in the order of time; also those without a board, which break a motion.
  // `is_still`: an image of its own, whose motion is not judged.
  Answer offer(const BoardView& view, double sharpness, bool is_still = false);
  // Takes the view whatever it is (a person asked for it); not without a board.
  Answer force(const BoardView& view, double sharpness);
  void undo();  // the last view taken; nothing where there is none
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
