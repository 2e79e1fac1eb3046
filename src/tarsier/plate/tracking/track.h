// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/tracker.h"

#include <opencv2/core.hpp>

#include <chrono>
#include <cstdint>
#include <string>
#include <vector>

// Internals of the tracker: one vehicle.
namespace tarsier::plate {

struct TrackReading {
  TimedReading reading;
  Ballot ballot;
};

struct Track {
  std::int64_t id = 0;
  double first_time = 0;
  double last_time = 0;  // of the latest reading
  std::int64_t frames = 0;
  std::int64_t readings_without_digit = 0;
  double plate_odds = 0;               // sum over the readings of log_odds(Reading::plate)
  std::vector<TrackReading> readings;  // in order of time
  std::vector<Candidate> voted;        // best first; may be a few readings behind, see vote_if_due
  double agreement = 0;                // 0..1: mean similarity of the readings to the voted text

  cv::Point2d center;      // px, at last_time
  cv::Size2d size;         // px
  cv::Point2d velocity;    // px/s
  int velocity_count = 0;  // measurements
  // The vehicle has stayed near `anchor` since `anchor_time`.
  cv::Point2d anchor;
  double anchor_time = 0;
  bool is_in_latest_frame = false;  // it was read there

  double max_confidence = 0;  // of a single reading

  double best_quality = -1;
  std::int64_t best_frame = 0;
  double best_time = 0;
  cv::Rect best_box;
  cv::Mat best_crop;  // never modified: events share it

  std::string source;
  std::chrono::milliseconds first_uptime{0};
  FrameMoment last_seen;  // of the latest reading

  // What was reported about it.
  bool reported = false;
  std::string reported_text;
  double reported_last_time = 0;  // last_time at that moment
  double next_update = 0;         // s, time of the frames
};

// Adds a reading: updates the motion, the list of readings and the best crop.
void add_reading(Track& track, const Reading& reading, const TrackedFrame& frame, double time,
                 const TrackerOptions& options);

// Predicted box. The prediction stops one second after the last reading.
[[nodiscard]] cv::Rect2d predicted_box(const Track& track, double time);

// Whether the vehicle had stood still for a while at its last reading.
[[nodiscard]] bool is_parked(const Track& track);

// Votes again. vote_if_due() does so only after enough new readings.
void vote_now(Track& track, const TrackerOptions& options);
void vote_if_due(Track& track, const TrackerOptions& options);

[[nodiscard]] bool is_confirmed(const Track& track, const TrackerOptions& options);

// The text voted so far; "" if there is none.
[[nodiscard]] const std::string& text_of(const Track& track);
[[nodiscard]] double confidence_of(const Track& track);

// Merges an earlier track of the same vehicle into `track`.
void merge_earlier(Track& track, Track&& earlier, const TrackerOptions& options);

// Makes an event from the latest vote.
[[nodiscard]] PlateEvent event_of(const Track& track, PlateState state);

// 0..1: 1 for the same text up to easily confused characters; 0 for nothing in common.
[[nodiscard]] double text_similarity(const std::string& a, const std::string& b);

// Score of a reading for a vehicle; negative if it cannot be the same vehicle.
[[nodiscard]] double match_score(const Track& track, const Reading& reading, double time,
                                 const TrackerOptions& options);

// Whether `later`, which appeared after the last reading of `earlier`, is the same vehicle.
[[nodiscard]] bool is_same_vehicle(const Track& earlier, const Track& later,
                                   const TrackerOptions& options);

// Seconds after the last reading until the vehicle is closed.
[[nodiscard]] double close_timeout(const Track& track, const TrackerOptions& options);

}  // namespace tarsier::plate
