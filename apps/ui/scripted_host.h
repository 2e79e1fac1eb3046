// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_sink.h"
#include "tarsier/media/frame_source.h"

#include <opencv2/core/mat.hpp>

#include "ui/session.h"
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier {

// What a session showed after one frame or event.
struct ScriptStep {
  std::int64_t frame = -1;  // number of the last processed frame, from 0; -1: none yet
  // "frame", "idle", or the event: "key s", "action sketch", "slider threshold 60".
  std::string cause;
  std::string status;
  nlohmann::json state;
  bool finished = false;
  bool toggle_fullscreen = false;
  std::string written;  // what the sink returned
  cv::Mat image;        // only for kept frames; a copy
  cv::Mat output;
};

// A host without window and clock. It passes the frames of a source, and events before given
// frames, to a session. The same frames and events give the same steps.
class ScriptedHost {
 public:
  // Both must outlive the host.
  ScriptedHost(Session& session, FrameSource& source) : session_(session), source_(source) {}

  // Sends `event` before frame number `frame` (>= 0, in order of processing), after earlier events
  // for the same frame. Events beyond the last frame are sent after it.
  void schedule(std::int64_t frame, Event event);
  // Keeps copies of the images of all steps with this frame number.
  void keep_images(std::int64_t frame);
  // New output images are written to `sink`; null: they are not written. The caller calls finish().
  void write_to(FrameSink* sink) { sink_ = sink; }

  // Processes at most `max_frames` (0: all) until the source ends, the session has finished, or
  // `stop` is triggered. A live source that is silent for half a second gives an idle step. Throws
  // what source, session and sink throw. Steps are appended to those of earlier runs.
  const std::vector<ScriptStep>& run(std::int64_t max_frames = 0, const std::stop_token& stop = {});
  [[nodiscard]] const std::vector<ScriptStep>& steps() const { return steps_; }

  // The steps as JSON lines, for comparison and for people: frame, cause, status, state.
  [[nodiscard]] std::string transcript() const;

 private:
  // Returns true when the session has finished.
  bool record(View view, std::string cause, const Frame* frame);
  bool send_events(std::int64_t before);

  Session& session_;
  FrameSource& source_;
  FrameSink* sink_ = nullptr;
  std::map<std::int64_t, std::vector<Event>> events_;
  std::set<std::int64_t> kept_frames_;
  std::vector<ScriptStep> steps_;
  Frame last_;                    // the frame that an image of an event belongs to
  std::int64_t frame_count_ = 0;  // frames
};

// "key s", "action sketch", "slider threshold 60", "mouse left-down 10 20": for transcripts.
[[nodiscard]] std::string describe(const Event& event);

}  // namespace tarsier
