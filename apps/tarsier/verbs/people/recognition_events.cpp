// SPDX-License-Identifier: MIT
#include "verbs/people/recognition_events.h"

#include "tarsier/core/csv.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include "framework/run_session.h"
#include "verbs/people/sightings.h"
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::cli {
namespace {

// The face with a margin, cropped from the image.
cv::Mat crop_of(const cv::Mat& image, const cv::Rect2d& box) {
  const cv::Rect2d around(box.x - 0.2 * box.width, box.y - 0.2 * box.height, 1.4 * box.width,
                          1.4 * box.height);
  return image(cv::Rect(around) & cv::Rect({}, image.size())).clone();
}

}  // namespace

std::vector<std::string> face_rows(const Frame& frame,
                                   const std::vector<face::IdentifiedFace>& faces) {
  std::vector<std::string> rows;
  for (const face::IdentifiedFace& face : faces) {
    const cv::Rect2d& box = face.face.box;
    rows.push_back(fmt::format("{},{},{},{:.4f},{:d},{},{},{},{}", frame_cells(frame), face.face.id,
                               csv_field(face.identity.label), face.identity.confidence,
                               face.identity.known, std::lround(box.x), std::lround(box.y),
                               std::lround(box.width), std::lround(box.height)));
  }
  return rows;
}

void RecognitionEvents::frame(const Frame& frame, const std::vector<face::IdentifiedFace>& faces) {
  const std::string source = source_of(frame);
  if (frame.still || source != source_) reported_.clear();
  source_ = source;
  for (const face::IdentifiedFace& face : faces) {
    if (face.identity.label.empty()) continue;
    const bool video = !frame.still && face.face.id > 0;
    const std::string label = (face.identity.known ? "+" : "-") + face.identity.label;
    if (video) {
      Reported& reported = reported_[face.face.id];
      reported.time = frame.time;
      if (std::exchange(reported.label, label) == label) continue;
    }
    if (!face.identity.known || !on_event_) continue;
    nlohmann::ordered_json line{{"event", "person"}};
    line.update(to_json(face));
    if (frame.still) {
      line["image"] = frame.name;
    } else {
      line["frame"] = frame.index;
      line["time"] = frame.time;
      line["source"] = masked(frame.name);
    }
    on_event_.post(line, crop_of(frame.image, face.face.box));
  }
  std::erase_if(reported_,
                [&](const auto& entry) { return frame.time - entry.second.time > kMaxLostTime_s; });
}

}  // namespace tarsier::cli
