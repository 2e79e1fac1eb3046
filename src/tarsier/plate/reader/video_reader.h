// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"
#include "tarsier/plate/reader/reader.h"
#include "tarsier/plate/tracking/event.h"
#include "tarsier/plate/tracking/tracker.h"

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::plate {

struct VideoReaderOptions {
  ReaderOptions reader;
  TrackerOptions tracker;
  void check() const;  // throws std::invalid_argument that names the value
};

// What is known from earlier frames of a video.
struct VideoReaderState {
  TrackerState tracker;
  std::string source;      // that the frames are from
  bool has_video = false;  // a frame of a video was the last one
};

// What is read in one frame.
struct VideoReaderResult {
  std::vector<Reading> plates;     // within the region, surest first
  std::vector<LiveTrack> tracks;   // vehicles in sight, oldest first; of a still none
  std::vector<PlateEvent> events;  // what this frame added about vehicles, in order
  double ms = 0;                   // spent finding and reading plates, milliseconds
};

// {"plates", "ms"} as of ReaderResult, and where vehicles are in sight "tracks": [{"id", "text",
// "confidence", "box": [x, y, w, h], "confirmed"}]. Events have event_json().
[[nodiscard]] nlohmann::ordered_json to_json(const VideoReaderResult& result);

// Reads number plates in videos and from cameras: plates are tracked, the readings of each vehicle
// vote, and each vehicle gives one closed event:
//
//   const auto reader = plate::VideoReader::load(ModelStore::find());
//   plate::VideoReaderState state;
//   const auto source = open_source("street.mp4");
//   const auto report = [](const std::vector<plate::PlateEvent>& events) {
//     for (const plate::PlateEvent& event : events)
//       if (event.state == plate::PlateState::kClosed) fmt::print("{}\n", event.text);
//   };
//   while (const auto frame = source->next(1s, {})) report(reader.process(*frame, state).events);
//   report(reader.finish(state));
//
// Const: copies share the models, and any number of threads may use it, each with a state of its
// own. Stills are read like Reader does, and are no vehicles.
class VideoReader {
 public:
  using Read = std::function<ReaderResult(const Frame& frame, DebugSink* debug)>;
  // The same of a part of the frame, px; empty: all of it.
  using ReadPart =
      std::function<ReaderResult(const Frame& frame, const cv::Rect& where, DebugSink* debug)>;

  // Throws as Reader::load().
  [[nodiscard]] static VideoReader load(const ModelStore& models,
                                        const VideoReaderOptions& options = {});
  // Plates as `read` finds them. Throws std::invalid_argument for a null function or bad options.
  VideoReader(ReadPart read, const TrackerOptions& options);
  VideoReader(Read read, const TrackerOptions& options);  // always of all of it

  [[nodiscard]] const TrackerOptions& options() const { return options_; }

  // The next frame. Where it is a still or of another source than the frames before it, their
  // vehicles have gone: their events come first. `seen`: when the frame was taken, by the wall
  // clock; where left out, events have no such times. Throws std::invalid_argument for an image
  // that is not CV_8UC3 or CV_8UC1 and a time that is not finite. `where`: the part in which plates are
  // looked for, px; vehicles whose plates are elsewhere are as if not seen in this frame.
  [[nodiscard]] VideoReaderResult process(const Frame& frame, VideoReaderState& state,
                                          const FrameMoment& seen = {}, DebugSink* debug = nullptr,
                                          const cv::Rect& where = {}) const;
  // Whether the frame goes on with what `state` follows: else process() begins with finish().
  [[nodiscard]] static bool continues(const Frame& frame, const VideoReaderState& state);
  // No more frames: the events of vehicles that are still in sight. The state may be used again.
  [[nodiscard]] std::vector<PlateEvent> finish(VideoReaderState& state) const;

 private:
  ReadPart read_;
  TrackerOptions options_;
};

}  // namespace tarsier::plate
