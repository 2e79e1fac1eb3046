// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/debug_sink.h"
#include "tarsier/core/timer.h"

#include "ui/frame_session.h"
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier {

struct CartoonSessionOptions {
  std::string save_folder = ".";  // where "save" writes tarsier-0001.png, tarsier-0002.png ..
  // Draw status, banners and help on the shown image; off if nobody looks.
  bool overlay = true;
  DebugSink* debug = nullptr;  // also receives each stage (--debug-dir); must outlive the session
  Timers* timers = nullptr;    // also receives the times; must outlive the session
  // Ends a frame of Quality::kReference early: on_frame() then throws Interrupted.
  std::stop_token stop;

  void check() const;  // throws std::invalid_argument
};

// The interactive cartoon program.
//
// Actions (key): sketch (s), paint (p), cartoon (c), evil (e; the key again: evil-sketch),
// evil-sketch, alien (a), smooth (m), none (n), debug (d: all stages side by side), pause (space),
// save (w), fullscreen (f), steady (t), threshold-up (+) and threshold-down (-) for the lines of
// the mode, help (h), quit (Esc, q). Sliders: "sketch-threshold", "evil-threshold", 0..255.
//
// After a switch to alien, an outline shows for about two seconds of frame time where to put the
// face (not for stills, not with FaceMode::kAuto).
//
// View.state: "mode"; "fps" from the frames' times, smoothed; "age_ms", the age of a live frame
// when it was shown; "source", see name_of(SourceState); "paused", "debug", "steady", "help":
// booleans; "faces": [[x,y,w,h]..] px in the frame; "frame": Frame::index, -1 before the first;
// "ms": the processing time of the last image, without decoding and overlay; "sketch_threshold",
// "evil_threshold"; "saved": the last saved file, if any.
//
// View.output is the clean image of each new frame; empty when idle or paused. For a still, events
// that change the image also give a new output.
class CartoonSession final : public FrameSession {
 public:
  // Starts with the options of `cartoonizer`.
  explicit CartoonSession(cartoon::Cartoonizer cartoonizer, CartoonSessionOptions options = {});

  [[nodiscard]] std::vector<Slider> sliders() const override;

 private:
  // Keeps the stages of a frame for the debug view and forwards them.
  class Stages final : public DebugSink {
   public:
    explicit Stages(DebugSink* next) : next_(next) {}
    void begin(bool keep);
    void image(std::string_view name, const cv::Mat& image) override;
    [[nodiscard]] cv::Mat tiled(cv::Size size) const;  // empty if none was kept

   private:
    DebugSink* next_;
    bool keep_ = false;
    std::vector<cv::Mat> images_;
    std::vector<std::string> names_;
  };

  void process(const Frame& frame) override;
  void on_processed() override;
  bool idle() override;
  void begin_drawing(cv::Mat& image) override { image = result_.image; }
  void draw(cv::Mat& image) override { static_cast<void>(image); }
  void draw_shown(cv::Mat& image) override;
  bool draw_placeholder(cv::Mat& image) override;
  [[nodiscard]] bool is_shown() const override { return options_.overlay; }
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::string note() const override { return "h: help"; }
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;
  bool slide(const Event& event) override;

  // Processes the latest frame with the current settings.
  void draw_cartoon();
  // A setting changed: a still is processed again at once, a video with its next frame.
  bool changed();
  [[nodiscard]] bool has_image() const { return !result_.image.empty(); }
  [[nodiscard]] double fps() const { return interval_s_ > 0 ? 1 / interval_s_ : 0; }
  [[nodiscard]] double outline_opacity() const;
  void draw_banner(cv::Mat& image) const;
  void set_mode(cartoon::Mode mode);
  void change_threshold(int direction);
  void show_message(std::string text);
  void save();

  CartoonSessionOptions options_;
  cartoon::Cartoonizer cartoonizer_;
  cartoon::CartoonOptions settings_;  // with the user's changes
  cartoon::CartoonizerState state_;
  Stages stages_;
  cartoon::CartoonResult result_;  // of the latest frame; no image before the first
  cv::Mat debug_view_;
  bool debug_ = false;
  double age_ms_ = 0;
  std::optional<double> last_time_;      // of the previous frame
  double interval_s_ = 0;                // smoothed time between frames
  std::optional<double> outline_since_;  // frame time
  bool outline_requested_ = false;       // from the next frame
  std::string message_;
  double message_since_ = 0;
  std::string saved_;
};

}  // namespace tarsier
