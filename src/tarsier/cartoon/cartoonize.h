// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/options.h"
#include "tarsier/core/debug_sink.h"
#include "tarsier/core/timer.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <memory>
#include <stop_token>
#include <vector>

namespace tarsier::cartoon {

// Buffers that are reused from frame to frame, and what --steady and --face auto remember. One per
// stream; a size change resets it.
class CartoonState {
 public:
  CartoonState();
  ~CartoonState();
  CartoonState(CartoonState&&) noexcept;
  CartoonState& operator=(CartoonState&&) noexcept;

  // Forgets what was learned from earlier frames (a cut, another source).
  void reset();

  // Faces of the last frame (kAlien, kSmooth with FaceMode::kAuto), px in the frame.
  [[nodiscard]] const std::vector<cv::Rect>& faces() const;

  struct Impl;
  [[nodiscard]] Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

// One frame, CV_8UC3 BGR at least 16x16, to the image of options.mode, CV_8UC3 of the same size.
// The result stays valid until the next call with the same state. For kNone it is the frame itself.
// In steady state (same size, same options) nothing is allocated. Uses cv::getNumThreads() threads;
// the result does not depend on their number. `debug` takes each stage; `timers`, if given, the
// time of each. Throws std::invalid_argument (frame type, options); ModelError when FaceMode::kAuto
// finds no cascade file; Interrupted when `stop` fires while it paints with Quality::kReference,
// the only stage that takes long.
[[nodiscard]] const cv::Mat& cartoonize(const cv::Mat& frame, const CartoonOptions& options,
                                        CartoonState& state, DebugSink* debug = nullptr,
                                        Timers* timers = nullptr, const std::stop_token& stop = {});

// The outline that helps a user to put the face in the right place, blended onto `image` with
// `opacity` 0..1: an ellipse 70 % of the height, aspect 0.72, two eyes, a lower lip, "Put your face
// here".
void draw_face_outline(cv::Mat& image, double opacity);

}  // namespace tarsier::cartoon
