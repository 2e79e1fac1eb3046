// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include "ui/session.h"
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::window {

// What highgui has no way to do, done to its window over a connection of our own to the X server:
// every key in its order (highgui keeps only the last one between two polls), the hidden pointer,
// full screen where no window manager runs (a kiosk), and noticing that the server is gone before
// the toolkit ends the process over it.
class X11Window {
 public:
  // Nothing if there is no X server to connect to.
  [[nodiscard]] static std::unique_ptr<X11Window> connect();
  ~X11Window();
  X11Window(const X11Window&) = delete;
  X11Window& operator=(const X11Window&) = delete;

  // Takes over the window of this process with the given name; false if it is not there (yet).
  bool attach(const std::string& name);
  void detach();

  [[nodiscard]] bool alive();            // the server still answers
  [[nodiscard]] bool destroyed() const;  // someone destroyed the window; seen by take_keys()
  [[nodiscard]] cv::Size screen_size() const;
  [[nodiscard]] bool has_window_manager();

  void hide_pointer(bool hidden);     // over the window; repeat it, the toolkit sets pointers too
  void place(const cv::Rect& where);  // only without a window manager
  // Where the window's own area begins on the screen, px; its frame is the window manager's.
  [[nodiscard]] std::optional<cv::Point> origin();
  [[nodiscard]] std::optional<cv::Rect> placement();

  // Keys pressed since the last call.
  [[nodiscard]] std::vector<Event> take_keys();

  // Returns when there is an event for the window or `timeout` has passed.
  void wait(std::chrono::milliseconds timeout);

 private:
  struct Impl;
  explicit X11Window(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::window
