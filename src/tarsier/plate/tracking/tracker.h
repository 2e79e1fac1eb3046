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

// Follows plates through the frames of one camera and makes one event of each vehicle.
//
//   TrackerState state;
//   for each frame:
//     for (const PlateEvent& event : step_tracker(options, state, {index, time, image, readings}))
//     .. for (const LiveTrack& track : live_tracks(options, state)) draw it
//   for (const PlateEvent& event : flush_tracker(options, state)) ..
namespace tarsier::plate {

struct TrackerOptions {
  Region region;            // a plate counts if the centre of its box is inside
  double lost_after = 1.5;  // s without a reading after which a vehicle is out of sight
  // s after that in which a vehicle of the same text is taken for the same one, come back. Its
  // event is only reported when they are over.
  double return_within = 10;
  double parked_return_within = 120;  // the same of one that stood still, at its place
  int min_readings = 3;               // a vehicle read less often is none
  // Of the voted text: below it is no vehicle, unless ten readings or more resemble it
  double min_confidence = 0.5;
  double min_standing = 0.8;  // the same of what never moved: it may be a sign
  // Of what has not moved, the mean of its readings' log odds of being a plate (Reading::plate): a sign
  // may be read as the same text for hours, which makes its vote sure.
  double min_standing_odds = 0;
  double min_single = 0.05;  // of the surest single reading: what never reads well is none
  // Texts without a digit are vehicles too. Few plates are such, and many signs.
  bool words = false;
  int max_readings = 500;  // that an event lists
  VoteOptions voting;

  [[nodiscard]] OptionFields fields() {
    return {{"lost_after", lost_after, range(0.05, 60), "--lost-after",
             "s without a reading after which a vehicle is out of sight"},
            {"return_within", return_within, range(0, 3600), "--return-within",
             "s in which the same text is the same vehicle, come back"},
            {"parked_return_within", parked_return_within, range(0, 86400),
             "--parked-return-within", "s, the same of one that stood still"},
            {"min_readings", min_readings, range(1, 1000), "--min-readings",
             "frames in which a vehicle must be read"},
            {"min_confidence", min_confidence, range(0, 1)},
            {"min_standing", min_standing, range(0, 1)},
            {"min_standing_odds", min_standing_odds, range(-100, 100)},
            {"min_single", min_single, range(0, 1)},
            {"words", words, "--words",
             "texts without a digit are vehicles too (a few plates; many signs)"},
            {"max_readings", max_readings, range(10, 100'000)}};
  }
  void check() const;
};

// What is kept of one vehicle; inside the tracker's state.
struct Track;

struct TrackerState {
  TrackerState();
  ~TrackerState();
  TrackerState(TrackerState&&) noexcept;
  TrackerState& operator=(TrackerState&&) noexcept;

  std::vector<std::unique_ptr<Track>> tracks;
  std::int64_t next_id = 1;
  double time = 0;                    // of the latest frame, s
  std::vector<PlateEvent> withdrawn;  // until take_news()
};

struct TrackedFrame {
  std::int64_t index = 0;
  double time = 0;  // s since the source's first frame; a clock that steps back is taken to stand
  cv::Mat image;    // best crops are cut from it; may be empty: none are
  std::vector<Reading> readings;
  FrameMoment seen{};    // by the wall clock; where left out, events have no such times
  std::string source{};  // goes into events; all frames until a flush are of one source
};

// A vehicle that is in sight.
struct LiveTrack {
  std::int64_t id = 0;
  cv::Rect box;       // in the latest frame; where it was not read, as it is thought to move
  bool read = false;  // in the latest frame
  std::string text;   // voted so far
  double confidence = 0;
  std::string country;
  double first_time = 0;
  std::int64_t frames = 0;
  bool confirmed = false;  // read often and surely enough for an event
};

// One more frame. Readings belong to the vehicle whose predicted box (constant velocity) they meet
// and whose text they resemble, one to one by falling score; the rest begin new ones. Returns the
// events of vehicles that are gone for good. Throws std::invalid_argument for a time that is not
// finite.
[[nodiscard]] std::vector<PlateEvent> step_tracker(const TrackerOptions& options,
                                                   TrackerState& state, const TrackedFrame& frame);

// The events of all vehicles that are left, by time; no tracks are left afterwards.
[[nodiscard]] std::vector<PlateEvent> flush_tracker(const TrackerOptions& options,
                                                    TrackerState& state);

// What is new since the last call, for those who keep what is known while vehicles are in sight;
// called after step_tracker(), before its events are dealt with, and after flush_tracker().
// kOpened: read often and surely enough for an event. kUpdated: another text, out of sight, or
// after some while (half as long again as it has been there, between 2 and 60 s). kWithdrawn, last:
// what was opened and is no vehicle, or another one come back. Vehicles that are first sure of when
// they have gone are closed without being opened.
[[nodiscard]] std::vector<PlateEvent> take_news(const TrackerOptions& options, TrackerState& state);

// The wall clock was set forward by so much: vehicles that were last read while it was not
// synchronized get right times.
void shift_unsynchronized(TrackerState& state, std::chrono::milliseconds by);

// Oldest first.
[[nodiscard]] std::vector<LiveTrack> live_tracks(const TrackerOptions& options,
                                                 const TrackerState& state);

}  // namespace tarsier::plate
