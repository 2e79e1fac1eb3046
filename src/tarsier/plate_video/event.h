// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate_text/reading.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
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

// One vehicle, from when its plate was first read until it was last.
struct PlateEvent {
  std::int64_t id = 0;  // counts up from 1 within one tracker
  std::string text;     // voted over all readings
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

// A picture's reading as an event of its own, at time 0, for logs.
[[nodiscard]] PlateEvent event_of(const Reading& reading, const cv::Mat& image);

// The box with a margin, cut from the image, 640 px wide at most; empty where they do not meet.
[[nodiscard]] cv::Mat plate_crop(const cv::Mat& image, const cv::Rect& box);

// {"event":"plate","id","text","confidence","country","candidates":[{"text","confidence"}],
// "first_time","last_time","frames","best":{"frame","time","box":[x,y,w,h]},"readings":[{"frame",
// "time","text","confidence","box"}]}; times in seconds, to the millisecond.
[[nodiscard]] nlohmann::ordered_json event_json(const PlateEvent& event);

// The parts of it that a log keeps as text.
[[nodiscard]] nlohmann::ordered_json candidates_json(const std::vector<Candidate>& candidates);
[[nodiscard]] nlohmann::ordered_json readings_json(const std::vector<TimedReading>& readings);

}  // namespace tarsier::plate
