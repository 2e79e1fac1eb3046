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

// State carried from frame to frame of a video.
struct VideoReaderState {
  TrackerState tracker;
  std::string source;  // source of the frames
  // Of its first frame (see Frame): events count from there.
  std::int64_t start_index = 0;
  double start_time = 0;
  bool has_video = false;  // true if the last frame belonged to a video
};

// The plates and vehicles of one frame.
struct VideoReaderResult {
  std::vector<Reading> plates;     // inside the region, highest confidence first
  std::vector<LiveTrack> tracks;   // vehicles in view, oldest first; empty for a still
  std::vector<PlateEvent> events;  // events that this frame causes, in order
  double ms = 0;                   // time spent finding and reading plates, milliseconds
};

// {"plates", "ms"} as for ReaderResult. If vehicles are in view, also "tracks": [{"id", "text",
// "confidence", "box": [x, y, w, h], "confirmed"}]. event_json() converts events.
[[nodiscard]] nlohmann::ordered_json to_json(const VideoReaderResult& result);

// Reads number plates in videos and from cameras. Plates are tracked, the readings of each vehicle
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
// The object is const, and copies share the models. Any number of threads may use it, each with its
// own state. Stills are read as by Reader and are not tracked.
class VideoReader {
 public:
  using Read = std::function<ReaderResult(const Frame& frame, DebugSink* debug)>;
  // Reads one region of the frame, px. An empty rectangle means the whole frame.
  using ReadPart =
      std::function<ReaderResult(const Frame& frame, const cv::Rect& region, DebugSink* debug)>;

  // Throws the same exceptions as Reader::load().
  [[nodiscard]] static VideoReader load(const ModelStore& models,
                                        const VideoReaderOptions& options = {});
  // Uses `read` to find plates. Throws std::invalid_argument for a null function or bad options.
  VideoReader(ReadPart read, TrackerOptions options);
  VideoReader(const Read& read, const TrackerOptions& options);  // always reads the whole frame

  [[nodiscard]] const TrackerOptions& options() const { return options_; }

  // Processes the next frame. If the frame is a still, or comes from another source than the frames
  // before it, all tracked vehicles are closed first and their events are returned first. `moment`
  // is the wall-clock time at which the frame was taken; without it, events have no wall-clock
  // times. `region` is the part that is searched, px; a vehicle whose plate is outside this region
  // counts as not seen in this frame. Throws std::invalid_argument for an image that is not CV_8UC3
  // or CV_8UC1 and for a time that is not finite.
  [[nodiscard]] VideoReaderResult process(const Frame& frame, VideoReaderState& state,
                                          const FrameMoment& moment = {},
                                          DebugSink* debug = nullptr,
                                          const cv::Rect& region = {}) const;
  // Returns whether the frame continues the sequence of `state`. If not, process() first calls
  // finish().
  [[nodiscard]] static bool continues(const Frame& frame, const VideoReaderState& state);
  // No frame has come until `time` (that of Frame): returns the tracks that are
  // still in view, and the events of the vehicles that have gone since the last frame.
  [[nodiscard]] VideoReaderResult process_silence(double time, VideoReaderState& state) const;
  // Ends the sequence and returns the events of the vehicles still in view. The state may be
  // reused.
  [[nodiscard]] std::vector<PlateEvent> finish(VideoReaderState& state) const;

 private:
  void track(const TrackedFrame& frame, VideoReaderState& state, VideoReaderResult& result) const;

  ReadPart read_;
  TrackerOptions options_;
};

}  // namespace tarsier::plate
