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

// Buffers that are reused from frame to frame, and the memory of --steady and --face auto. Use one
// state per stream. A change of the frame size resets it.
class CartoonState {
 public:
  CartoonState();
  ~CartoonState();
  CartoonState(CartoonState&&) noexcept;
  CartoonState& operator=(CartoonState&&) noexcept;

  // Discards what was learned from earlier frames (after a cut, or for another source).
  void reset();

  // Faces of the last frame (kAlien, kSmooth with FaceMode::kAuto), px of the frame.
  [[nodiscard]] const std::vector<cv::Rect>& faces() const;

  struct Impl;
  [[nodiscard]] Impl& impl() { return *impl_; }

 private:
  std::unique_ptr<Impl> impl_;
};

// Converts one frame, CV_8UC3 BGR and at least 16x16, into the image of options.mode, CV_8UC3 of
// the same size. The result is valid until the next call with the same state. For kNone it is the
// frame itself. After the first frame (same size, same options) no memory is allocated. Uses
// cv::getNumThreads() threads; the result does not depend on their number. `debug` receives the
// image of each stage, and `timers` the duration of each stage; both may be null. Throws
// std::invalid_argument (frame type, options); ModelError if FaceMode::kAuto finds no cascade file;
// Interrupted if `stop` is requested while Quality::kReference paints, the only slow stage.
[[nodiscard]] const cv::Mat& cartoonize(const cv::Mat& frame, const CartoonOptions& options,
                                        CartoonState& state, DebugSink* debug = nullptr,
                                        Timers* timers = nullptr, const std::stop_token& stop = {});

// Blends the outline that helps a user to place the face onto `image`, with `opacity` 0..1: an
// ellipse 70 % of the height, aspect 0.72, two eyes, a lower lip, "Put your face here".
void draw_face_outline(cv::Mat& image, double opacity);

}  // namespace tarsier::cartoon
