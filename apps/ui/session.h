// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame.h"
#include "tarsier/media/frame_source.h"

#include <opencv2/core/mat.hpp>

#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Something a person did, wherever the session is shown.
struct Event {
  enum class Kind { kKey, kMouse, kAction, kSlider };
  enum class Mouse {
    kMove,
    kLeftDown,
    kLeftUp,
    kRightDown,
    kRightUp,
    kMiddleDown,
    kMiddleUp,
    kWheel,
    kDouble
  };
  Kind kind = Kind::kKey;
  int key = 0;  // kKey: an ASCII code, or one of Key
  Mouse mouse = Mouse::kMove;
  double x = 0;  // kMouse: pixel in the view's image, centres at integers
  double y = 0;
  int wheel = 0;  // kWheel: notches, + away from the user
  bool shift = false;
  bool control = false;
  std::string name;  // kAction, kSlider: which one
  double value = 0;  // kSlider
};

namespace key {
inline constexpr int kEscape = 27;
inline constexpr int kEnter = 13;
inline constexpr int kSpace = 32;
inline constexpr int kLeft = 0x10001;
inline constexpr int kRight = 0x10002;
inline constexpr int kUp = 0x10003;
inline constexpr int kDown = 0x10004;
inline constexpr int kDelete = 0x10005;
inline constexpr int kBackspace = 8;
inline constexpr int kTab = 9;
}  // namespace key

[[nodiscard]] Event key_event(int key);
[[nodiscard]] Event action_event(std::string name);
[[nodiscard]] Event slider_event(std::string name, double value);

// A named action of the user: by key in a window, by button in a browser, by line on stdin.
struct Action {
  std::string name;  // "sketch"
  std::string help;  // "pencil sketch"
  int key = 0;       // 0: none
};

// The name of the action that an event means, "" for none: a key of its own (Caps Lock and Shift do
// not matter where nothing else has that key), else, where there are such actions, Escape and q for
// "quit", h and ? for "help", the right arrow, space and Enter for "next", the left arrow for
// "previous".
[[nodiscard]] std::string action_of(const Event& event, const std::vector<Action>& actions);

// A number the user can move.
struct Slider {
  std::string name;  // "threshold"
  double low = 0;
  double high = 1;
  double step = 1;
  double value = 0;
};

// What a session shows after a frame or an event.
struct View {
  // CV_8UC3, what to show; valid until the next call on the session.
  cv::Mat image;
  // CV_8UC3, what goes to the sink (no status text on it); empty: nothing new to write.
  cv::Mat output;
  // One line.
  std::string status;
  // An object with steady key names, for --json and other hosts.
  nlohmann::json state;
  // The user asked to end.
  bool finished = false;
  // The host is asked to switch between window and full screen.
  bool toggle_fullscreen = false;
};

// An interactive program without window, thread or clock: a state machine over frames and events.
// The host calls from one thread; what the session shows is a function of the calls alone.
class Session {
 public:
  virtual ~Session() = default;
  // A new frame. `source` is the state of where it came from.
  virtual View on_frame(const Frame& frame, const SourceStatus& source) = 0;
  // No frame came for a while (a stalled camera): redraws the status. Default: the last view again.
  virtual View on_idle(const SourceStatus& source) = 0;
  virtual View on_event(const Event& event) = 0;
  [[nodiscard]] virtual std::vector<Action> actions() const = 0;
  [[nodiscard]] virtual std::vector<Slider> sliders() const = 0;

  // Whether View::image has the status and the panel of keys drawn on it; it has them at first. A
  // host that shows View::status and actions() in a place of its own leaves them out.
  void draw_status(bool on) { draws_status_ = on; }

 protected:
  [[nodiscard]] bool draws_status() const { return draws_status_; }

 private:
  bool draws_status_ = true;
};

}  // namespace tarsier
