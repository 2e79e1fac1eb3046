// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/tracking/event.h"
#include "tarsier/plate/tracking/region.h"
#include "tarsier/plate/tracking/vote.h"

#include <opencv2/core/mat.hpp>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

// Tracks plates through the frames of one camera and makes one event per vehicle.
//
//   TrackerState state;
//   for each frame:
//     for (const PlateEvent& event : step_tracker(options, state, {index, time, image, readings}))
//     .. for (const LiveTrack& track : live_tracks(options, state)) draw it
//   for (const PlateEvent& event : flush_tracker(options, state)) ..
namespace tarsier::plate {

struct TrackerOptions {
  Region region;            // a plate counts if the centre of its box is inside
  double lost_after = 1.5;  // s without a reading after which a vehicle is out of view
  // s after that during which a returning vehicle of the same text counts as the same one. Its
  // event is reported only after this time.
  double return_within = 10;
  double parked_return_within = 120;  // the same for a vehicle that stood still, at the same place
  int min_readings = 3;               // a track with fewer readings is not a vehicle
  // Minimum confidence of the voted text. Not needed if ten or more readings resemble the text.
  double min_confidence = 0.5;
  double min_standing = 0.8;  // the same for a track that never moved: it may be a sign
  // For a track that has not moved: minimum mean of its readings' log odds of being a plate
  // (Reading::plate). A sign may give the same text for hours, so its vote has a high confidence.
  double min_standing_odds = 0;
  double min_single = 0.05;  // minimum confidence of the best single reading
  // Also accepts texts without a digit. Few plates have such texts, but many signs do.
  bool words = false;
  int max_readings = 500;  // maximum number of readings listed in an event
  VoteOptions voting;

  [[nodiscard]] OptionFields fields() {
    return {
        {"lost_after", lost_after, range(0.05, 60), "--lost-after",
         "s without a reading until a vehicle counts as gone"},
        {"return_within", return_within, range(0, 3600), "--return-within",
         "s in which the same text means the same vehicle again"},
        {"parked_return_within", parked_return_within, range(0, 86400), "--parked-return-within",
         "s, the same for a vehicle that stood still"},
        {"min_readings", min_readings, range(1, 1000), "--min-readings",
         "frames in which a vehicle must be read"},
        {"min_confidence", min_confidence, range(0, 1)},
        {"min_standing", min_standing, range(0, 1)},
        {"min_standing_odds", min_standing_odds, range(-100, 100)},
        {"min_single", min_single, range(0, 1)},
        {"words", words, "--words", "also accept texts without a digit (a few plates, many signs)"},
        {"max_readings", max_readings, range(10, 100'000)}};
  }
  void check() const;
};

// The data of one vehicle, internal to the tracker.
struct Track;

struct TrackerState {
  TrackerState();
  ~TrackerState();
  TrackerState(TrackerState&&) noexcept;
  TrackerState& operator=(TrackerState&&) noexcept;

  std::vector<std::unique_ptr<Track>> tracks;
  std::int64_t next_id = 1;
  double time = 0;                    // of the latest frame, s
  std::vector<PlateEvent> withdrawn;  // kept until take_updates()
};

struct TrackedFrame {
  std::int64_t index = 0;
  double time = 0;  // s since the source's first frame; a step back counts as no time passing
  cv::Mat image;    // source of the best crops; if empty, there are no crops
  std::vector<Reading> readings;
  FrameMoment moment{};  // wall-clock time; without it, events have no wall-clock times
  std::string source{};  // copied into events; all frames until a flush have one source
};

// A vehicle in view.
struct LiveTrack {
  std::int64_t id = 0;
  cv::Rect box;       // in the latest frame; predicted if it was not read there
  bool read = false;  // whether it was read in the latest frame
  std::string text;   // voted so far
  double confidence = 0;
  std::string country;
  double first_time = 0;
  std::int64_t frames = 0;
  bool confirmed = false;  // read often and confidently enough for an event
};

// Processes one frame. Readings are assigned to the vehicles whose predicted box (constant
// velocity) they overlap and whose text they resemble, one to one by falling score. The other
// readings begin new vehicles. Returns the events of vehicles that have gone. Throws
// std::invalid_argument for a time that is not finite.
[[nodiscard]] std::vector<PlateEvent> step_tracker(const TrackerOptions& options,
                                                   TrackerState& state, const TrackedFrame& frame);

// Closes all remaining vehicles and returns their events in the order of time.
[[nodiscard]] std::vector<PlateEvent> flush_tracker(const TrackerOptions& options,
                                                    TrackerState& state);

// Returns the updates since the last call, for callers that record vehicles while these are in
// view. Call it after step_tracker(), before handling the events of step_tracker(), and after
// flush_tracker().
//
// kOpened: the vehicle is confirmed. kUpdated: its text has changed, it is out of view, or enough
// time has passed (half of its stay so far, between 2 and 60 s). kWithdrawn, listed last: an opened
// vehicle is not a vehicle, or is an earlier one that returned. A vehicle that is confirmed only
// when it has gone is closed without being opened.
[[nodiscard]] std::vector<PlateEvent> take_updates(const TrackerOptions& options,
                                                   TrackerState& state);

// The wall clock was set forward by `by`: corrects the times of vehicles last read while it was not
// synchronized.
void shift_unsynchronized(TrackerState& state, std::chrono::milliseconds by);

// Oldest first.
[[nodiscard]] std::vector<LiveTrack> live_tracks(const TrackerOptions& options,
                                                 const TrackerState& state);

}  // namespace tarsier::plate
