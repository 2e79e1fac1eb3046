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

// An input of the user, from any kind of host.
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
  int key = 0;  // kKey: an ASCII code, or a constant of namespace key
  Mouse mouse = Mouse::kMove;
  double x = 0;  // kMouse: pixel in the view's image, centres at integers
  double y = 0;
  int wheel = 0;  // kWheel: notches, + away from the user
  bool shift = false;
  bool control = false;
  std::string name;  // kAction, kSlider: its name
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

// A named action of the user: a key in a window, a button in a browser, a line on stdin.
struct Action {
  std::string name;  // "sketch"
  std::string help;  // "pencil sketch"
  int key = 0;       // 0: none
};

// The name of the action that an event means, "" for none. First the keys of the actions themselves
// (Caps Lock and Shift do not matter unless another action has that key). Then, if such actions
// exist: Escape and q for "quit", h and ? for "help", the right arrow, space and Enter for "next",
// the left arrow for "previous".
[[nodiscard]] std::string action_of(const Event& event, const std::vector<Action>& actions);

// A number that the user can change.
struct Slider {
  std::string name;  // "threshold"
  double low = 0;
  double high = 1;
  double step = 1;
  double value = 0;
};

// What a session shows after a frame or an event.
struct View {
  // CV_8UC3, the image to show; valid until the next call on the session.
  cv::Mat image;
  // CV_8UC3, the image for the sink (without status text); empty: nothing new to write.
  cv::Mat output;
  // One line of text.
  std::string status;
  // An object with fixed key names, for --json and other hosts.
  nlohmann::json state;
  // The user asked to quit.
  bool finished = false;
  // Asks the host to switch between window and full screen.
  bool toggle_fullscreen = false;
};

// An interactive program without window, thread or clock: a state machine over frames and events.
// The host calls it from one thread. What it shows depends only on these calls.
class Session {
 public:
  virtual ~Session() = default;
  // Processes a new frame. `source` is the state of the frame's source.
  virtual View on_frame(const Frame& frame, const SourceStatus& source) = 0;
  // No frame came for a while (a stalled camera): redraws the status on the last view.
  virtual View on_idle(const SourceStatus& source) = 0;
  virtual View on_event(const Event& event) = 0;
  [[nodiscard]] virtual std::vector<Action> actions() const = 0;
  [[nodiscard]] virtual std::vector<Slider> sliders() const = 0;

  // Whether the status and the panel of keys are drawn on View::image (default). A host that shows
  // View::status and actions() elsewhere switches this off.
  void draw_status(bool on) { draws_status_ = on; }

 protected:
  [[nodiscard]] bool draws_status() const { return draws_status_; }

 private:
  bool draws_status_ = true;
};

}  // namespace tarsier
