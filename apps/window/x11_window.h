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

// Adds features to highgui's window over our own connection to the X server: every key in order
// (highgui keeps only the last one between two polls), a hidden pointer, full screen without a
// window manager (a kiosk), and detection of a lost server before the toolkit ends the process.
class X11Window {
 public:
  // Null if there is no X server.
  [[nodiscard]] static std::unique_ptr<X11Window> connect();
  ~X11Window();
  X11Window(const X11Window&) = delete;
  X11Window& operator=(const X11Window&) = delete;

  // Takes over this process's window of the given name; false if it does not exist (yet).
  bool attach(const std::string& name);
  void detach();

  [[nodiscard]] bool alive();  // the server still responds
  // The window was destroyed; set by take_keys().
  [[nodiscard]] bool destroyed() const;
  [[nodiscard]] cv::Size screen_size() const;
  [[nodiscard]] bool has_window_manager();

  // Over the window. Repeat the call, because the toolkit sets pointers, too.
  void hide_pointer(bool hidden);
  void set_geometry(const cv::Rect& where);  // only without a window manager
  // Where the window's client area begins on the screen, px (without the frame of the window
  // manager).
  [[nodiscard]] std::optional<cv::Point> origin();
  [[nodiscard]] std::optional<cv::Rect> geometry();

  // Keys pressed since the last call.
  [[nodiscard]] std::vector<Event> take_keys();

  // Returns when the window has an event or `timeout` has passed.
  void wait(std::chrono::milliseconds timeout);

 private:
  struct Impl;
  explicit X11Window(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::window
