// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"
#include "tarsier/plate/tracking/time_text.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <chrono>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// What was read of one vehicle in one frame.
struct TimedReading {
  std::int64_t frame = 0;
  double time = 0;  // s since the source's first frame
  std::string text;
  double confidence = 0;
  cv::Rect box;  // px of the frame
};

// When a frame was taken, by the clocks of source_clock.h.
struct FrameMoment {
  Moment wall{};                        // as a calendar says it
  std::chrono::milliseconds uptime{0};  // of a clock that nobody sets: durations are of this one
  bool synchronized = true;             // the calendar's clock is known to be right
};

// What is said of a vehicle: that it is one, what was learnt of it since, that it has gone, or that
// it is none after all (a sign) or the same as another one.
enum class PlateState { kOpened, kUpdated, kClosed, kWithdrawn };
[[nodiscard]] std::string_view name_of(PlateState state);  // "opened", "updated" ..

// One vehicle, from when its plate was first read until it was last.
struct PlateEvent {
  std::int64_t id = 0;  // counts up from 1 within one tracker
  PlateState state = PlateState::kClosed;
  std::int64_t merged_into = 0;  // kWithdrawn: the id of the vehicle that it was; 0: it was none
  std::string source;            // where it was seen
  Moment first_seen;             // wall clock; 1970 where it is not known
  Moment last_seen;
  bool synchronized = true;  // see FrameMoment
  std::string text;          // voted over all readings
  double confidence = 0;
  std::string country;                // of the text's layout, empty where none fits
  std::vector<Candidate> candidates;  // best first; the first is the text
  double first_time = 0;              // s since the source's first frame
  double last_time = 0;
  std::int64_t frames = 0;             // in which it was read
  std::vector<TimedReading> readings;  // in order; of long stays the weakest are left out
  std::int64_t best_frame = 0;         // where it was read best
  double best_time = 0;
  cv::Rect best_box;
  cv::Mat best_crop;  // CV_8UC3 or as the frames were; the box with a margin, 640 px wide at most
};

// How a vehicle moves, as the camera sees it: its plate becomes 15 % larger (it comes nearer) or
// smaller, or goes by half its width to a side, up or down in the image.
enum class Direction { kApproaching, kReceding, kLeft, kRight, kUp, kDown };
inline constexpr std::array kDirections{Direction::kApproaching, Direction::kReceding,
                                        Direction::kLeft,        Direction::kRight,
                                        Direction::kUp,          Direction::kDown};
[[nodiscard]] std::string_view name_of(Direction direction);  // "approaching", "left" ..
// By the first and the last quarter of its readings; none of a vehicle that stands.
[[nodiscard]] std::vector<Direction> directions_of(const PlateEvent& event);

// An image's reading as an event of its own, at time 0, for logs.
[[nodiscard]] PlateEvent event_of(const Reading& reading, const cv::Mat& image);

// The box with a margin, cut from the image, 640 px wide at most; empty where they do not meet.
[[nodiscard]] cv::Mat plate_crop(const cv::Mat& image, const cv::Rect& box);

// {"event":"plate","state","id","source","first_seen","last_seen","text","confidence","country","candidates":[{"text","confidence"}],
// "first_time","last_time","frames","best":{"frame","time","box":[x,y,w,h]},"readings":[{"frame",
// "time","text","confidence","box"}],"direction":["approaching" ..]}; times in seconds, to the millisecond; "first_seen" and
// "last_seen" as ISO 8601, null where not known; "merged_into" where state is "withdrawn", id or
// null.
[[nodiscard]] nlohmann::ordered_json event_json(const PlateEvent& event);

// The parts of it that a log keeps as text.
[[nodiscard]] nlohmann::ordered_json candidates_json(const std::vector<Candidate>& candidates);
[[nodiscard]] nlohmann::ordered_json readings_json(const std::vector<TimedReading>& readings);

}  // namespace tarsier::plate
