// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate_text/reading.h"
#include "tarsier/plate_video/tracker.h"
#include "tarsier/session/session.h"

#include <chrono>
#include <functional>
#include <string>
#include <vector>

namespace tarsier {

// Reads plates in what it is shown. A still stands for itself; the frames of a film or camera are
// followed, and each vehicle gives events: opened when it is certain to be one, updated while it
// stays, closed when it has gone; or withdrawn. Where another film or camera begins, the vehicles
// of the last one have gone. (The pictures of a folder that are shown in sequence are one film.)
// Keys: space pauses, c boxes around characters, h help, q or Esc ends.
// State: {"plates": number, "events": number of closed ones so far, "paused"}.
class PlateSession final : public Session {
 public:
  using Read = std::function<std::vector<plate::Reading>(const Frame& frame)>;
  using OnPlate = std::function<void(const plate::PlateEvent& event)>;
  using MomentOf = std::function<plate::FrameMoment(const Frame& frame)>;

  // All functions are called from on_frame, the second also from finish(). The last one gives the
  // wall clock of frames of films and cameras; empty: events have no such times. Throws
  // std::invalid_argument for bad options.
  PlateSession(Read read, OnPlate on_plate, const plate::TrackerOptions& options,
               MomentOf moment_of = {});

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // No more frames: the events of vehicles that are still in sight.
  void finish();

  // The wall clock was set forward by so much; see shift_unsynchronized() of tracker.h.
  void shift_unsynchronized(std::chrono::milliseconds by);

  // Of the latest frame; for frames of a film, those within the region.
  [[nodiscard]] const std::vector<plate::Reading>& readings() const { return readings_; }
  // Vehicles in sight; empty for stills.
  [[nodiscard]] const std::vector<plate::LiveTrack>& tracks() const { return tracks_; }

 private:
  void tell(const std::vector<plate::PlateEvent>& events);
  void draw();
  View view(bool fresh);

  Read read_;
  OnPlate on_plate_;
  MomentOf moment_of_;
  plate::TrackerOptions options_;
  plate::TrackerState state_;
  std::vector<plate::Reading> readings_;
  std::vector<plate::LiveTrack> tracks_;
  std::vector<std::string> last_events_;  // for the list in the corner
  std::int64_t events_ = 0;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  std::string name_;    // of the film or camera
  std::string source_;  // its state, where it is not live
  bool still_ = true;
  bool paused_ = false;
  bool characters_ = true;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
