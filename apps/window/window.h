// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/session/session.h"

#include <opencv2/core/mat.hpp>

#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::window {

struct WindowOptions {
  std::string title;
  bool fullscreen = false;
  std::vector<Slider> sliders;  // shown below the picture; not in full screen
};

// A window on the desktop. All calls from one thread, the one that opened it. Any call throws
// Error(kBadInput) when the display goes away.
class Window {
 public:
  virtual ~Window() = default;

  // Shows `image` (CV_8UC3), scaled to the window with its aspect kept. The first picture opens the
  // window in the picture's size, or smaller where the screen is.
  virtual void show(const cv::Mat& image) = 0;

  // What the user did since the last call, in order; waits at most `timeout` for something. Mouse
  // positions are pixels of the picture shown last (outside of 0..width-1, 0..height-1 beside it).
  // Held keys repeat only where that is of use (arrows, + -, delete, backspace): holding a switch
  // must not flicker it.
  [[nodiscard]] virtual std::vector<Event> poll(std::chrono::milliseconds timeout) = 0;

  // The user closed the window.
  [[nodiscard]] virtual bool closed() const = 0;

  // In full screen the pointer is hidden and the picture fills the screen with its aspect kept.
  virtual void set_fullscreen(bool on) = 0;
  [[nodiscard]] virtual bool fullscreen() const = 0;

  // Moves a slider of the options without an event. Unknown names are ignored.
  virtual void set_slider(std::string_view name, double value) = 0;
};

// Loads the window module and looks whether there is a display, without opening anything. Call it
// before other threads start (it prepares the environment of the toolkit). Throws Error(kBadInput):
// no display, a display that does not answer, or no module (it is a package of its own).
void prepare();

// Opens a window; it appears with its first picture. Calls prepare() if need be.
[[nodiscard]] std::unique_ptr<Window> open_window(const WindowOptions& options);

}  // namespace tarsier::window
