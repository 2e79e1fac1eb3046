// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/event.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/rounding.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

constexpr NameTable<Direction, 6> kDirectionNames{"direction",
                                                  {{{Direction::kApproaching, "approaching"},
                                                    {Direction::kReceding, "receding"},
                                                    {Direction::kLeft, "left"},
                                                    {Direction::kRight, "right"},
                                                    {Direction::kUp, "up"},
                                                    {Direction::kDown, "down"}}}};

constexpr NameTable<PlateState, 4> kPlateStates{"state",
                                                {{{PlateState::kOpened, "opened"},
                                                  {PlateState::kUpdated, "updated"},
                                                  {PlateState::kClosed, "closed"},
                                                  {PlateState::kWithdrawn, "withdrawn"}}}};

using nlohmann::ordered_json;

// Rounds to the meaningful digits.
double rounded_time(double seconds) { return rounded_to_steps(seconds, 1e3); }
double rounded_fraction(double share) { return rounded_to_steps(share, 1e4); }

ordered_json box_json(const cv::Rect& box) {
  return ordered_json::array({box.x, box.y, box.width, box.height});
}

constexpr int kCropWidth = 640;  // px

}  // namespace

std::string_view name_of(PlateState state) { return kPlateStates.name(state); }

std::string_view name_of(Direction direction) { return kDirectionNames.name(direction); }

std::vector<Direction> directions_of(const PlateEvent& event) {
  constexpr double kMinSizeRatio = 1.15;
  constexpr double kMinDisplacement = 0.5;  // relative to the plate's width
  std::vector<Direction> directions;
  const std::size_t count = event.readings.size();
  if (count < 2) return directions;
  const std::size_t quarter = std::max<std::size_t>(1, count / 4);
  cv::Point2d centers[2];
  double widths[2] = {0, 0};
  for (int end = 0; end < 2; ++end) {
    const std::size_t from = end == 0 ? 0 : count - quarter;
    for (std::size_t k = from; k < from + quarter; ++k) {
      const cv::Rect& box = event.readings[k].box;
      centers[end] += cv::Point2d(box.x + 0.5 * box.width, box.y + 0.5 * box.height) /
                      static_cast<double>(quarter);
      widths[end] += box.width / static_cast<double>(quarter);
    }
  }
  if (widths[0] < 1 || widths[1] < 1) return directions;
  if (widths[1] >= kMinSizeRatio * widths[0]) directions.push_back(Direction::kApproaching);
  if (widths[0] >= kMinSizeRatio * widths[1]) directions.push_back(Direction::kReceding);
  const cv::Point2d displacement = (centers[1] - centers[0]) / (0.5 * (widths[0] + widths[1]));
  if (displacement.x <= -kMinDisplacement) directions.push_back(Direction::kLeft);
  if (displacement.x >= kMinDisplacement) directions.push_back(Direction::kRight);
  if (displacement.y <= -kMinDisplacement) directions.push_back(Direction::kUp);
  if (displacement.y >= kMinDisplacement) directions.push_back(Direction::kDown);
  return directions;
}

cv::Mat plate_crop(const cv::Mat& image, const cv::Rect& box) {
  if (image.empty()) return {};
  const cv::Point margin{box.width / 6, box.height / 4};
  const cv::Rect around =
      cv::Rect(box.tl() - margin, box.br() + margin) & cv::Rect(0, 0, image.cols, image.rows);
  if (around.empty()) return {};
  cv::Mat crop = image(around).clone();
  if (crop.cols > kCropWidth) {
    const double scale = static_cast<double>(kCropWidth) / crop.cols;
    cv::resize(crop, crop, {kCropWidth, std::max(1, cvRound(crop.rows * scale))}, 0, 0,
               cv::INTER_AREA);
  }
  return crop;
}

PlateEvent event_of(const Reading& reading, const cv::Mat& image) {
  PlateEvent event;
  event.id = 1;
  event.text = reading.text;
  event.confidence = reading.confidence;
  event.country = reading.country;
  event.candidates = reading.candidates;
  event.frames = 1;
  event.readings = {{0, 0, reading.text, reading.confidence, reading.box}};
  event.best_box = reading.box;
  event.best_crop = plate_crop(image, reading.box);
  return event;
}

ordered_json candidates_json(const std::vector<Candidate>& candidates) {
  ordered_json list = ordered_json::array();
  for (const Candidate& candidate : candidates) {
    list.push_back(
        {{"text", candidate.text}, {"confidence", rounded_fraction(candidate.confidence)}});
    if (!candidate.country.empty()) list.back()["country"] = candidate.country;
  }
  return list;
}

ordered_json readings_json(const std::vector<TimedReading>& readings) {
  ordered_json list = ordered_json::array();
  for (const TimedReading& reading : readings) {
    list.push_back({{"frame", reading.frame},
                    {"time", rounded_time(reading.time)},
                    {"text", reading.text},
                    {"confidence", rounded_fraction(reading.confidence)},
                    {"box", box_json(reading.box)}});
  }
  return list;
}

ordered_json event_json(const PlateEvent& event) {
  const auto time_json = [](Moment moment) {
    return moment == Moment() ? ordered_json() : ordered_json(moment_text(moment));
  };
  ordered_json object{{"event", "plate"},
                      {"state", name_of(event.state)},
                      {"id", event.id},
                      {"source", event.source},
                      {"first_seen", time_json(event.first_seen)},
                      {"last_seen", time_json(event.last_seen)}};
  if (event.state == PlateState::kWithdrawn) {
    object["merged_into"] =
        event.merged_into > 0 ? ordered_json(event.merged_into) : ordered_json();
  }
  object.update({{"text", event.text},
                 {"confidence", rounded_fraction(event.confidence)},
                 {"country", event.country.empty() ? ordered_json() : ordered_json(event.country)},
                 {"candidates", candidates_json(event.candidates)},
                 {"first_time", rounded_time(event.first_time)},
                 {"last_time", rounded_time(event.last_time)},
                 {"frames", event.frames},
                 {"best",
                  {{"frame", event.best_frame},
                   {"time", rounded_time(event.best_time)},
                   {"box", box_json(event.best_box)}}},
                 {"readings", readings_json(event.readings)},
                 {"direction", ordered_json::array()}});
  for (const Direction direction : directions_of(event))
    object["direction"].push_back(name_of(direction));
  return object;
}

}  // namespace tarsier::plate
