// SPDX-License-Identifier: MIT
#include "tarsier/plate/reader/video_reader.h"

#include "tarsier/core/require.h"
#include "tarsier/media/still_source.h"
#include "tarsier/plate/networks/reading_json.h"

#include <cmath>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::plate {
namespace {

void append(std::vector<PlateEvent>& events, std::vector<PlateEvent>&& more) {
  events.insert(events.end(), std::make_move_iterator(more.begin()),
                std::make_move_iterator(more.end()));
}

}  // namespace

void VideoReaderOptions::check() const {
  reader.check();
  tracker.check();
}

nlohmann::ordered_json to_json(const VideoReaderResult& result) {
  nlohmann::ordered_json object = to_json(ReaderResult{result.plates, result.ms});
  if (result.tracks.empty()) return object;
  nlohmann::ordered_json tracks = nlohmann::ordered_json::array();
  for (const LiveTrack& track : result.tracks) {
    tracks.push_back({{"id", track.id},
                      {"text", track.text},
                      {"confidence", std::round(track.confidence * 1e4) / 1e4},
                      {"box", {track.box.x, track.box.y, track.box.width, track.box.height}},
                      {"confirmed", track.confirmed}});
  }
  object["tracks"] = std::move(tracks);
  return object;
}

VideoReader::VideoReader(const Read& read, const TrackerOptions& options)
    : VideoReader(read == nullptr
                      ? ReadPart()
                      : ReadPart([read](const Frame& frame, const cv::Rect&, DebugSink* debug) {
                          return read(frame, debug);
                        }),
                  options) {}

VideoReader::VideoReader(ReadPart read, TrackerOptions options)
    : read_(std::move(read)), options_(std::move(options)) {
  TARSIER_REQUIRE(read_ != nullptr, "a reader is needed");
  options_.check();
}

VideoReader VideoReader::load(const ModelStore& models, const VideoReaderOptions& options) {
  options.check();
  return {[reader = Reader::load(models, options.reader)](
              const Frame& frame, const cv::Rect& region, DebugSink* debug) {
            return reader.process(frame, debug, nullptr, region);
          },
          options.tracker};
}

bool VideoReader::continues(const Frame& frame, const VideoReaderState& state) {
  if (frame.still) return !state.has_video;
  return state.has_video && source_of(frame) == state.source;
}

VideoReaderResult VideoReader::process(const Frame& frame, VideoReaderState& state,
                                       const FrameMoment& moment, DebugSink* debug,
                                       const cv::Rect& region) const {
  VideoReaderResult result;
  if (!continues(frame, state)) {
    result.events = finish(state);
    state.start_index = frame.start_index;
    state.start_time = frame.start_time;
  }
  state.source = source_of(frame);
  state.has_video = !frame.still;
  ReaderResult read = read_(frame, region, debug);
  result.plates = std::move(read.plates);
  result.ms = read.ms;
  std::erase_if(result.plates, [&](const Reading& plate) {
    return !options_.region.contains_center(plate.box, frame.image.size());
  });
  if (frame.still) return result;
  track({frame.index - state.start_index, frame.time - state.start_time, frame.image, result.plates,
         moment, state.source},
        state, result);
  return result;
}

VideoReaderResult VideoReader::process_silence(double time, VideoReaderState& state) const {
  VideoReaderResult result;
  TrackedFrame nothing;
  nothing.time = time - state.start_time;
  track(nothing, state, result);
  return result;
}

void VideoReader::track(const TrackedFrame& frame, VideoReaderState& state,
                        VideoReaderResult& result) const {
  std::vector<PlateEvent> closed = step_tracker(options_, state.tracker, frame);
  append(result.events, take_updates(options_, state.tracker));
  append(result.events, std::move(closed));
  result.tracks = live_tracks(options_, state.tracker);
}

std::vector<PlateEvent> VideoReader::finish(VideoReaderState& state) const {
  std::vector<PlateEvent> events = flush_tracker(options_, state.tracker);
  append(events, take_updates(options_, state.tracker));
  return events;
}

}  // namespace tarsier::plate
