// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/overlay.h"
#include "ui/session.h"
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier {

// The base of sessions that work on each frame and draw on it what they found. It keeps the frame,
// measures the time, does what all of them can do (SessionControls), and puts the view together:
// the drawing is what goes to the sink; the same with a bar below, and the panel of keys where it
// was asked for, is what is shown. A session gives process(), draw(), state() and status(), and its
// own actions where it has some.
class FrameSession : public Session {
 public:
  View on_frame(const Frame& frame, const SourceStatus& source) final;
  View on_idle(const SourceStatus& source) final;
  // An action that changes the drawing draws the frame again. The drawing of a still then goes to
  // the sink once more; of a video each frame is written once.
  View on_event(const Event& event) final;
  [[nodiscard]] std::vector<Action> actions() const final;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of process(), of the latest frame.
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }

 protected:
  // `title` is that of the panel of keys.
  explicit FrameSession(std::string title, int pause_key = key::kSpace)
      : title_(std::move(title)), controls_(true, pause_key) {}

  // The work on a frame, whose time is measured.
  virtual void process(const Frame& frame) = 0;
  // Before process(), of a still and of the first frame of another source: what is known from
  // earlier frames holds no longer.
  virtual void restart() {}
  // Behind process() and before draw(); not measured.
  virtual void processed() {}
  // On a copy of the frame (CV_8UC3); may replace it by an image of another size.
  virtual void draw(cv::Mat& image) = 0;
  // An object with steady key names; "paused" is added to it.
  [[nodiscard]] virtual nlohmann::json state() const = 0;
  // What was found, in a few words; what the source is and whether it is paused are added to them.
  [[nodiscard]] virtual std::string status() const = 0;
  [[nodiscard]] virtual std::vector<Action> own_actions() const { return {}; }
  // One of them; true: the frame is to be drawn again.
  virtual bool act(const std::string& name) {
    static_cast<void>(name);
    return false;
  }
  // A slider was moved; true: the frame is to be drawn again.
  virtual bool slide(const Event& event) {
    static_cast<void>(event);
    return false;
  }
  // What the mouse did; true: the frame is to be drawn again.
  virtual bool mouse(const Event& event) {
    static_cast<void>(event);
    return false;
  }
  // No frame came for a while; true: the frame is to be drawn again.
  virtual bool idle() { return false; }

  // What draw() draws on.
  virtual void begin_drawing(cv::Mat& image) { frame().copyTo(image); }
  // On a copy of the drawing that is shown and does not go to the sink.
  virtual void draw_shown(cv::Mat& image) { static_cast<void>(image); }
  // What is shown as long as there is no drawing; false: nothing.
  virtual bool draw_waiting(cv::Mat& image) {
    static_cast<void>(image);
    return false;
  }
  // Whether anybody looks. If not, View::image is the drawing itself.
  [[nodiscard]] virtual bool is_shown() const { return true; }
  // What the bar says in place of the status; empty: nothing.
  [[nodiscard]] virtual std::string message() const { return ""; }

  // What the bar says at its right.
  [[nodiscard]] virtual std::string note() const { return timer_.words(still()) + "   h: help"; }
  // Of the panel of keys, before those of the actions.
  [[nodiscard]] virtual std::vector<image::draw::HelpLine> help_lines() const { return {}; }

  // Draws the latest frame again, for the sink too. Before the first frame nothing is drawn.
  View redrawn();
  // There is no drawing until the next one is made.
  void drop_drawing() { output_.release(); }
  // The next view asks the host for it.
  void toggle_fullscreen() { toggles_fullscreen_ = true; }

  [[nodiscard]] bool paused() const { return controls_.paused(); }
  [[nodiscard]] bool shows_help() const { return controls_.help(); }
  // Where the frames come from, as the host said last.
  [[nodiscard]] const SourceStatus& source() const { return source_; }

  // The latest frame; its image is empty before the first.
  [[nodiscard]] const Frame& latest() const { return latest_; }
  [[nodiscard]] const cv::Mat& frame() const { return latest_.image; }
  // Whether it stands for itself.
  [[nodiscard]] bool still() const { return latest_.still; }
  // What draw() made of it; empty before the first.
  [[nodiscard]] const cv::Mat& drawing() const { return output_; }

 private:
  void hear(const SourceStatus& source);
  bool draw_again();
  View view(bool fresh);

  std::string title_;
  SessionControls controls_;
  FrameTimer timer_;
  SourceStatus source_;
  std::string trouble_;  // of the source
  bool toggles_fullscreen_ = false;
  Frame latest_;
  cv::Mat output_;
  cv::Mat shown_;
};

}  // namespace tarsier
