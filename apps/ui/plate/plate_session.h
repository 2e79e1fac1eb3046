// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/plate/reader/video_reader.h"

#include "ui/frame_session.h"
#include <chrono>
#include <functional>
#include <string>
#include <vector>

namespace tarsier {

// Shows the plates that a plate::VideoReader reads. Each still is independent. In a video or camera
// each vehicle gives events: opened when it is certainly a vehicle, updated while it is visible,
// and closed when it has left; or withdrawn. When another video or camera starts, all vehicles have
// left. (Images of a folder that are shown in sequence are one video.) Keys: space pauses, c
// character boxes, h help, q or Esc quits.
// State: {"plates": number, "events": number of closed events so far, "paused"}.
class PlateSession final : public FrameSession {
 public:
  using OnPlate = std::function<void(const plate::PlateEvent& event)>;
  using MomentOf = std::function<plate::FrameMoment(const Frame& frame)>;

  // Both functions are called from on_frame(), `on_plate` also from on_idle() (vehicles whose
  // camera is lost) and finish(). `moment_of` gives the wall clock for frames of videos and
  // cameras; if it is empty, events have no such times. `debug` receives each stage; it may be null
  // and must outlive the session.
  PlateSession(plate::VideoReader reader, OnPlate on_plate, MomentOf moment_of = {},
               DebugSink* debug = nullptr);

  // No more frames: reports the events of vehicles that are still visible.
  void finish();

  // The wall clock was set forward by `by`; see shift_unsynchronized() of tracker.h.
  void shift_unsynchronized(std::chrono::milliseconds by);

  // The result of the latest frame.
  [[nodiscard]] const plate::VideoReaderResult& result() const { return result_; }
  [[nodiscard]] const std::vector<plate::Reading>& readings() const { return result_.plates; }
  // Visible vehicles; empty for stills.
  [[nodiscard]] const std::vector<plate::LiveTrack>& tracks() const { return result_.tracks; }

 private:
  void report(const std::vector<plate::PlateEvent>& events);
  void process(const Frame& frame) override;
  void on_processed() override;
  bool idle() override;
  void draw(cv::Mat& image) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;

  plate::VideoReader reader_;
  OnPlate on_plate_;
  MomentOf moment_of_;
  DebugSink* debug_;
  plate::VideoReaderState state_;
  plate::VideoReaderResult result_;
  std::vector<std::string> last_events_;  // for the list in the corner
  std::int64_t events_ = 0;
  bool characters_ = true;
};

}  // namespace tarsier
