// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/debug_sink.h"
#include "tarsier/core/timer.h"

#include "ui/session.h"
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier {

struct CartoonSessionOptions {
  std::string save_folder = ".";  // where "save" puts tarsier-0001.png, tarsier-0002.png ..
  bool overlay = true;  // status, banners and help on the shown image; off where nobody looks
  DebugSink* debug = nullptr;  // also takes each stage (--debug-dir); must outlive the session
  Timers* timers = nullptr;    // also takes the times; must outlive the session
  std::stop_token stop;  // ends a frame of Quality::kReference early: on_frame() throws Interrupted

  void check() const;  // throws std::invalid_argument
};

// The cartoonifier as a person drives it.
//
// Actions (key): sketch (s), paint (p), cartoon (c), evil (e; the key again: evil-sketch),
// evil-sketch, alien (a), smooth (m), none (n), debug (d: all stages side by side), pause (space),
// save (w), fullscreen (f), steady (t), threshold-up (+), threshold-down (-): of the lines that the
// mode draws, help (h), quit (Esc, q). Sliders: "sketch-threshold", "evil-threshold", 0..255.
//
// Switching to alien shows for about two seconds of the frames' time where to put the face (not for
// stills, not with FaceMode::kAuto).
//
// View.state: "mode"; "fps" of the frames' times, smoothed; "age_ms" of a live frame when it was
// shown; "source", see name_of(SourceState); "paused", "debug", "steady", "help": booleans;
// "faces": [[x,y,w,h]..] px in the frame; "frame": Frame::index, -1 before the first; "ms": what
// the last image took, without decoding and overlay; "sketch_threshold", "evil_threshold";
// "saved": the file last saved, if any.
//
// View.output is the clean image of each new frame; empty for idle and while paused. For a still
// image, events that change the image give a new output, too.
class CartoonSession final : public Session {
 public:
  // The options of `cartoonizer` are those to begin with.
  explicit CartoonSession(const cartoon::Cartoonizer& cartoonizer,
                          const CartoonSessionOptions& options = {});
  ~CartoonSession() override;

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier
