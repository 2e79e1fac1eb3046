// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include "ui/session.h"
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::window {

struct WindowOptions {
  std::string title;
  bool fullscreen = false;
  std::vector<Slider> sliders;  // shown below the image; not in full screen
  std::vector<Action> actions;  // shown as buttons if the window supports them
  bool stages = false;          // the session calls show_stages() on request
};

// An intermediate image of a stage (DebugSink): CV_8UC1 or CV_8UC3.
struct Stage {
  std::string name;
  cv::Mat image;
};

// The frame that a view was made from.
struct FrameInfo {
  std::int64_t index = -1;  // Frame::index; -1: none yet
  double time = 0;          // s, Frame::time
  std::string name;         // Frame::name
  // For live sources: when its last byte arrived; nullopt for files.
  std::optional<std::chrono::steady_clock::time_point> captured;
  std::string source;  // "file", or the name_of() a live source's state
  std::string detail;  // SourceStatus::detail of a live source
};

// A window on the desktop, or in a browser (pipe_window.h). All calls must come from the thread
// that opened it. Any call throws Error(ErrorKind::kInput) when the display is lost.
class Window {
 public:
  virtual ~Window() = default;

  // Shows the view's image, scaled to the window with its aspect ratio kept; nothing if it is
  // empty. The first image opens the window in the image's size, or smaller if the screen is.
  // `frame` is the frame of the view; null for sessions without frames.
  virtual void show(const View& view, const FrameInfo* frame) = 0;

  // The user's input since the last call, in order; waits at most `timeout` for input. Mouse
  // positions are pixels of the last shown image (outside 0..width-1, 0..height-1 if beside it). A
  // held key repeats only where that is useful (arrows, + -, delete, backspace), so that switches
  // do not flicker.
  [[nodiscard]] virtual std::vector<Event> poll(std::chrono::milliseconds timeout) = 0;

  // Whether the user closed the window.
  [[nodiscard]] virtual bool closed() const = 0;

  // In full screen the pointer is hidden and the image fills the screen with its aspect ratio kept.
  virtual void set_fullscreen(bool on) = 0;
  [[nodiscard]] virtual bool fullscreen() const = 0;

  // Sets the session's current actions and sliders, without an event. A window on the desktop keeps
  // the sliders of its options and ignores others.
  virtual void set_controls(const std::vector<Action>& actions,
                            const std::vector<Slider>& sliders) = 0;

  // Whether the user looks at stages, so that those of the next frame are requested.
  [[nodiscard]] virtual bool wants_stages() const { return false; }
  // Shows the stages of the frame last passed to show(). A window that cannot show them ignores
  // them.
  virtual void show_stages(const std::vector<Stage>& stages) { static_cast<void>(stages); }
};

// If the environment has TARSIER_WINDOW=pipe:IN:OUT, all windows of this process are pipe windows
// (pipe_window.h), which need no display, toolkit or module.

// Loads the window module and checks for a display, without opening anything. Call it before other
// threads start (it prepares the environment of the toolkit). Throws Error(ErrorKind::kInput): no
// display, a display that does not answer, or no module (it is a separate package); or an invalid
// TARSIER_WINDOW.
void prepare();

// Whether windows show View::status and actions() themselves, so that images need no bar and no
// panel (Session::draw_status). Calls prepare() if needed.
[[nodiscard]] bool shows_status();

// Whether windows can show stages. Works before prepare() and has no side effects.
[[nodiscard]] bool supports_stages();

// Opens a window, which appears with its first image. Calls prepare() if needed.
[[nodiscard]] std::unique_ptr<Window> open_window(const WindowOptions& options);

}  // namespace tarsier::window
