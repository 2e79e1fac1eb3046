// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include "ui/controls.h"
#include "ui/overlay.h"
#include "ui/session.h"
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier {

// The base of sessions that process each frame and draw the result on it. It stores the frame,
// measures the time, handles the common actions (SessionControls) and composes the view. The
// drawing goes to the sink. The shown image is the drawing with a status bar below and, if
// requested, the panel of keys. A session implements process(), draw(), state() and status(), and
// its own actions if it has some.
class FrameSession : public Session {
 public:
  View on_frame(const Frame& frame, const SourceStatus& source) final;
  View on_idle(const SourceStatus& source) final;
  // An action that changes the drawing redraws the frame. The drawing of a still then goes to the
  // sink again; each frame of a video is written only once.
  View on_event(const Event& event) final;
  [[nodiscard]] std::vector<Action> actions() const final;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Duration of process() for the latest frame.
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }

 protected:
  // `title` is the title of the panel of keys.
  explicit FrameSession(std::string title, int pause_key = key::kSpace)
      : title_(std::move(title)), controls_(true, pause_key) {}

  // Processes a frame. Its time is measured.
  virtual void process(const Frame& frame) = 0;
  // Called before process() for a still and for the first frame of another source: state from
  // earlier frames is no longer valid.
  virtual void restart() {}
  // Called between process() and draw(); not measured.
  virtual void on_processed() {}
  // Draws on a copy of the frame (CV_8UC3). It may replace the copy by an image of another size.
  virtual void draw(cv::Mat& image) = 0;
  // An object with fixed key names; "paused" is added to it.
  [[nodiscard]] virtual nlohmann::json state() const = 0;
  // The result in a few words; the state of the source and of the pause are added.
  [[nodiscard]] virtual std::string status() const = 0;
  [[nodiscard]] virtual std::vector<Action> own_actions() const { return {}; }
  // Performs one of them; returns true if the frame must be redrawn.
  virtual bool act(const std::string& name) {
    static_cast<void>(name);
    return false;
  }
  // A slider was moved; returns true if the frame must be redrawn.
  virtual bool slide(const Event& event) {
    static_cast<void>(event);
    return false;
  }
  // A mouse event; returns true if the frame must be redrawn.
  virtual bool mouse(const Event& event) {
    static_cast<void>(event);
    return false;
  }
  // No frame came for a while; returns true if the frame must be redrawn.
  virtual bool idle() { return false; }

  // Prepares the image that draw() draws on.
  virtual void begin_drawing(cv::Mat& image) { frame().copyTo(image); }
  // Draws on a copy of the drawing that is shown but does not go to the sink.
  virtual void draw_shown(cv::Mat& image) { static_cast<void>(image); }
  // Draws what is shown before the first drawing exists; false: nothing is shown.
  virtual bool draw_placeholder(cv::Mat& image) {
    static_cast<void>(image);
    return false;
  }
  // Whether anybody looks at the view. If not, View::image is the drawing itself.
  [[nodiscard]] virtual bool is_shown() const { return true; }
  // Text of the bar instead of the status; empty: the status.
  [[nodiscard]] virtual std::string message() const { return ""; }

  // Text at the right of the bar.
  [[nodiscard]] virtual std::string note() const { return timer_.text(still()) + "   h: help"; }
  // Lines of the panel of keys before those of the actions.
  [[nodiscard]] virtual std::vector<image::draw::HelpLine> help_lines() const { return {}; }

  // Redraws the latest frame, also for the sink. Before the first frame nothing is drawn.
  View redraw();
  // Drops the drawing until the next one is made.
  void drop_drawing() { output_.release(); }
  // The next view asks the host to switch full screen.
  void toggle_fullscreen() { toggles_fullscreen_ = true; }

  [[nodiscard]] bool paused() const { return controls_.paused(); }
  [[nodiscard]] bool shows_help() const { return controls_.help(); }
  // The source's state, as last reported by the host.
  [[nodiscard]] const SourceStatus& source() const { return source_; }

  // The latest frame; its image is empty before the first.
  [[nodiscard]] const Frame& latest() const { return latest_; }
  [[nodiscard]] const cv::Mat& frame() const { return latest_.image; }
  // Whether the latest frame is a still.
  [[nodiscard]] bool still() const { return latest_.still; }
  // The drawing of the latest frame; empty before the first.
  [[nodiscard]] const cv::Mat& drawing() const { return output_; }

 private:
  void set_source(const SourceStatus& source);
  bool update_drawing();
  View view(bool fresh);

  std::string title_;
  SessionControls controls_;
  FrameTimer timer_;
  SourceStatus source_;
  std::string source_warning_;  // of the source
  bool toggles_fullscreen_ = false;
  Frame latest_;
  cv::Mat output_;
  cv::Mat shown_;
};

}  // namespace tarsier
