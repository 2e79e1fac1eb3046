// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/tracker.h"

#include <opencv2/core.hpp>

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

// The inside of the tracker: one vehicle.
namespace tarsier::plate {

struct Evidence {
  TimedReading reading;
  Ballot ballot;
};

struct Track {
  std::int64_t id = 0;
  double first_time = 0;
  double last_time = 0;  // of the latest reading
  std::int64_t frames = 0;
  std::int64_t words = 0;          // of these, readings without a digit
  double plate_odds = 0;           // sum over the readings of log_odds(Reading::plate)
  std::vector<Evidence> evidence;  // in order of time
  std::vector<Candidate> voted;    // best first; may be some readings behind, see vote_if_due
  double agreement = 0;            // 0..1: how much the readings resemble the voted text

  cv::Point2d center;      // px, at last_time
  cv::Size2d size;         // px
  cv::Point2d velocity;    // px/s
  int moves = 0;           // how many times the velocity was measured
  cv::Point2d anchor;      // it has stayed near this place ..
  double anchor_time = 0;  // .. since then
  bool read_now = false;   // in the latest frame

  double surest = 0;  // confidence of the surest reading

  double best_quality = -1;
  std::int64_t best_frame = 0;
  double best_time = 0;
  cv::Rect best_box;
  cv::Mat best_crop;  // never drawn into: events share it

  std::string source;
  std::chrono::milliseconds first_uptime{0};
  FrameMoment last_seen;  // of the latest reading

  // What was said of it.
  bool announced = false;
  std::string announced_text;
  double announced_last = 0;  // its last_time then
  double next_update = 0;     // s, of the frames' time
};

// Takes a reading: motion, evidence, best crop.
void add_reading(Track& track, const Reading& reading, const TrackedFrame& frame, double time,
                 const TrackerOptions& options);

// Where the vehicle is thought to be; it is not followed further than a second.
[[nodiscard]] cv::Rect2d predicted_box(const Track& track, double time);

// Whether it has stood still for a while when it was last read.
[[nodiscard]] bool is_parked(const Track& track);

// Votes again; or only where enough was read since.
void vote_now(Track& track, const TrackerOptions& options);
void vote_if_due(Track& track, const TrackerOptions& options);

[[nodiscard]] bool is_confirmed(const Track& track, const TrackerOptions& options);

// The voted text so far, "" before any.
[[nodiscard]] const std::string& text_of(const Track& track);
[[nodiscard]] double confidence_of(const Track& track);

// Adds what is known from an earlier time of the same vehicle.
void absorb(Track& track, Track&& earlier, const TrackerOptions& options);

// As it is known now, by the latest vote.
[[nodiscard]] PlateEvent event_of(const Track& track, PlateState state);

// 0..1: 1 for the same text, with what is easily confused taken for one; 0 for nothing in common.
[[nodiscard]] double text_similarity(const std::string& a, const std::string& b);

// How well a reading fits a vehicle; negative where it cannot be the same.
[[nodiscard]] double fit(const Track& track, const Reading& reading, double time,
                         const TrackerOptions& options);

// Whether `later`, which appeared after `earlier` was last read, is the same vehicle.
[[nodiscard]] bool is_same(const Track& earlier, const Track& later, const TrackerOptions& options);

// Seconds after the last reading until the vehicle is gone for good.
[[nodiscard]] double patience_for(const Track& track, const TrackerOptions& options);

}  // namespace tarsier::plate
