// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"
#include "tarsier/plate/tracking/time_text.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <chrono>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// The reading of one vehicle in one frame.
struct TimedReading {
  std::int64_t frame = 0;
  double time = 0;  // s since the source's first frame
  std::string text;
  double confidence = 0;
  cv::Rect box;  // px of the frame
};

// The time at which a frame was taken, by the clocks of source_clock.h.
struct FrameMoment {
  Moment wall{};                        // wall clock
  std::chrono::milliseconds uptime{0};  // monotonic clock, for durations
  bool synchronized = true;             // the wall clock is known to be right
};

// States of an event: kOpened: a vehicle is confirmed. kUpdated: more is known about it. kClosed:
// it has gone. kWithdrawn: it is not a vehicle after all (a sign), or it is the same as another
// one.
enum class PlateState { kOpened, kUpdated, kClosed, kWithdrawn };
[[nodiscard]] std::string_view name_of(PlateState state);  // "opened", "updated" ..

// One vehicle, from the first to the last reading of its plate.
struct PlateEvent {
  std::int64_t id = 0;  // counts up from 1 in each tracker
  PlateState state = PlateState::kClosed;
  // kWithdrawn: id of the vehicle it was merged into; 0 if it was not a vehicle.
  std::int64_t merged_into = 0;
  std::string source;  // name of the source
  Moment first_seen;   // wall clock; 1970 if not known
  Moment last_seen;
  bool synchronized = true;  // see FrameMoment
  std::string text;          // voted over all readings
  double confidence = 0;
  std::string country;                // of the text's layout; empty if none fits
  std::vector<Candidate> candidates;  // best first; the first is the text
  double first_time = 0;              // s since the source's first frame
  double last_time = 0;
  std::int64_t frames = 0;             // in which it was read
  std::vector<TimedReading> readings;  // in order; for long stays the weakest readings are dropped
  std::int64_t best_frame = 0;         // frame of the best reading
  double best_time = 0;
  cv::Rect best_box;
  cv::Mat best_crop;  // type of the frames; the box with a margin, at most 640 px wide
};

// Direction of a vehicle in the image. Approaching or receding: its plate becomes 15 % larger or
// smaller. Left, right, up, down: the plate moves by half its width.
enum class Direction { kApproaching, kReceding, kLeft, kRight, kUp, kDown };
inline constexpr std::array kDirections{Direction::kApproaching, Direction::kReceding,
                                        Direction::kLeft,        Direction::kRight,
                                        Direction::kUp,          Direction::kDown};
[[nodiscard]] std::string_view name_of(Direction direction);  // "approaching", "left" ..
// Compares the first and the last quarter of the readings. Empty for a standing vehicle.
[[nodiscard]] std::vector<Direction> directions_of(const PlateEvent& event);

// Makes an event of a single image's reading, at time 0, for logs.
[[nodiscard]] PlateEvent event_of(const Reading& reading, const cv::Mat& image);

// The box with a margin, cut from the image, at most 640 px wide. Empty if the box lies outside the
// image.
[[nodiscard]] cv::Mat plate_crop(const cv::Mat& image, const cv::Rect& box);

// {"event":"plate","state","id","source","first_seen","last_seen","text","confidence","country",
// "candidates":[{"text","confidence"}],"first_time","last_time","frames","best":{"frame","time",
// "box":[x,y,w,h]},"readings":[{"frame","time","text","confidence","box"}],
// "direction":["approaching" ..]}. Times are in seconds, rounded to milliseconds. "first_seen" and
// "last_seen" are ISO 8601, null if not known. "merged_into" (id or null) exists if the state is
// "withdrawn".
[[nodiscard]] nlohmann::ordered_json event_json(const PlateEvent& event);

// The parts of an event that a log stores as text.
[[nodiscard]] nlohmann::ordered_json candidates_json(const std::vector<Candidate>& candidates);
[[nodiscard]] nlohmann::ordered_json readings_json(const std::vector<TimedReading>& readings);

}  // namespace tarsier::plate
