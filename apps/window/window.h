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
  std::vector<Action> actions;  // buttons, where the window has such
  bool stages = false;          // show_stages() will be called where they are wanted
};

// What a stage of the work left (DebugSink): CV_8UC1 or CV_8UC3.
struct Stage {
  std::string name;
  cv::Mat image;
};

// What a view was made of.
struct FrameInfo {
  std::int64_t index = -1;  // Frame::index; -1: there was none yet
  double time = 0;          // s, Frame::time
  std::string name;         // Frame::name
  // When its last byte came, of live sources; nothing for files.
  std::optional<std::chrono::steady_clock::time_point> captured;
  std::string source;  // "file", or the name_of() a live source's state
  std::string detail;  // SourceStatus::detail of a live source
};

// A window on the desktop, or in a browser (pipe_window.h). All calls from one thread, the one that opened it. Any call throws
// Error(kBadInput) when the display goes away.
class Window {
 public:
  virtual ~Window() = default;

  // Shows the view's image, scaled to the window with its aspect kept; nothing where it is empty.
  // The first one opens the window in the image's size, or smaller where the screen is. `frame` is
  // the one that the view shows, null where a session shows none.
  virtual void show(const View& view, const FrameInfo* frame) = 0;

  // What the user did since the last call, in order; waits at most `timeout` for something. Mouse
  // positions are pixels of the image shown last (outside of 0..width-1, 0..height-1 beside it).
  // Held keys repeat only where that is of use (arrows, + -, delete, backspace): holding a switch
  // must not flicker it.
  [[nodiscard]] virtual std::vector<Event> poll(std::chrono::milliseconds timeout) = 0;

  // The user closed the window.
  [[nodiscard]] virtual bool closed() const = 0;

  // In full screen the pointer is hidden and the image fills the screen with its aspect kept.
  virtual void set_fullscreen(bool on) = 0;
  [[nodiscard]] virtual bool fullscreen() const = 0;

  // What the session offers now: moves sliders without an event. A window on the desktop keeps the
  // sliders of its options, and ignores others.
  virtual void offer(const std::vector<Action>& actions, const std::vector<Slider>& sliders) = 0;

  // Whether the user looks at the stages, so that those of the next frame are wanted.
  [[nodiscard]] virtual bool wants_stages() const { return false; }
  // Those of the frame that show() was called with last. A window without a place for them
  // ignores them.
  virtual void show_stages(const std::vector<Stage>& stages) { static_cast<void>(stages); }
};

// Where the environment has TARSIER_WINDOW=pipe:IN:OUT, all windows of this process are pipe windows
// (pipe_window.h): they need no display, no toolkit and no module.

// Loads the window module and looks whether there is a display, without opening anything. Call it
// before other threads start (it prepares the environment of the toolkit). Throws Error(kBadInput):
// no display, a display that does not answer, or no module (it is a package of its own); or
// TARSIER_WINDOW is set and wrong.
void prepare();

// Whether windows show View::status and actions() in places of their own, so that images need
// neither bar nor panel (Session::draw_status). Calls prepare() if need be.
[[nodiscard]] bool shows_status();

// Whether windows have a place for stages. Needs no prepare(), and does nothing.
[[nodiscard]] bool takes_stages();

// Opens a window; it appears with its first image. Calls prepare() if need be.
[[nodiscard]] std::unique_ptr<Window> open_window(const WindowOptions& options);

}  // namespace tarsier::window
