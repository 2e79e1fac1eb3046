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

// Shows what a plate::VideoReader reads. A still stands for itself; in the frames of a video or
// camera each vehicle gives events: opened when it is certain to be one, updated while it stays,
// closed when it has gone; or withdrawn. Where another video or camera begins, the vehicles of the
// last one have gone. (The images of a folder that are shown in sequence are one video.)
// Keys: space pauses, c boxes around characters, h help, q or Esc ends.
// State: {"plates": number, "events": number of closed ones so far, "paused"}.
class PlateSession final : public FrameSession {
 public:
  using OnPlate = std::function<void(const plate::PlateEvent& event)>;
  using MomentOf = std::function<plate::FrameMoment(const Frame& frame)>;

  // Both functions are called from on_frame, the first also from finish(). The second gives the
  // wall clock of frames of videos and cameras; empty: events have no such times. `debug` takes
  // each stage; it may be null, and must outlive the session.
  PlateSession(plate::VideoReader reader, OnPlate on_plate, MomentOf moment_of = {},
               DebugSink* debug = nullptr);

  // No more frames: the events of vehicles that are still in sight.
  void finish();

  // The wall clock was set forward by so much; see shift_unsynchronized() of tracker.h.
  void shift_unsynchronized(std::chrono::milliseconds by);

  // Of the latest frame.
  [[nodiscard]] const plate::VideoReaderResult& result() const { return result_; }
  [[nodiscard]] const std::vector<plate::Reading>& readings() const { return result_.plates; }
  // Vehicles in sight; empty for stills.
  [[nodiscard]] const std::vector<plate::LiveTrack>& tracks() const { return result_.tracks; }

 private:
  void tell(const std::vector<plate::PlateEvent>& events);
  void process(const Frame& frame) override;
  void processed() override;
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
