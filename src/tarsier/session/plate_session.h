// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate_text/reading.h"
#include "tarsier/plate_video/tracker.h"
#include "tarsier/session/session.h"

#include <functional>
#include <string>
#include <vector>

namespace tarsier {

// Reads plates in what it is shown. A still stands for itself; the frames of a film or camera are
// followed, and each vehicle gives one event when it has gone.
// Keys: space pauses, c boxes around characters, h help, q or Esc ends.
// State: {"plates": number, "events": number so far, "paused"}.
class PlateSession final : public Session {
 public:
  using Read = std::function<std::vector<plate::Reading>(const Frame& frame)>;
  using OnPlate = std::function<void(const plate::PlateEvent& event)>;

  // Both functions are called from on_frame, the second also from finish(). Throws
  // std::invalid_argument for bad options.
  PlateSession(Read read, OnPlate on_plate, const plate::TrackerOptions& options);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // No more frames: the events of vehicles that are still in sight.
  void finish();

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
  plate::TrackerOptions options_;
  plate::TrackerState state_;
  std::vector<plate::Reading> readings_;
  std::vector<plate::LiveTrack> tracks_;
  std::vector<std::string> last_events_;  // for the list in the corner
  std::int64_t events_ = 0;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  std::string source_;
  bool still_ = true;
  bool paused_ = false;
  bool characters_ = true;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
