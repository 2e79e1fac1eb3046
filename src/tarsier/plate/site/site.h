// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/plate/reader/video_reader.h"
#include "tarsier/plate/site/motion.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::plate {

struct SiteOptions {
  double max_fps = 10;  // frames a second that are looked at, of each camera
  MotionOptions motion;
  double hold = 2;          // s after the last motion in which frames are read
  double idle = 1;          // s between frames that are read while nothing moves
  double restart = 1;       // s before a camera that failed is opened again; doubles ..
  double max_restart = 30;  // .. up to this
  int threads = 1;          // that read plates

  [[nodiscard]] OptionFields fields() {
    return {{"max_fps", max_fps, above(0, 1000), "--camera-fps",
             "frames a second that are looked at, of each camera"},
            {"hold", hold, range(0, 3600), "--motion-hold",
             "s after the last motion in which frames are read"},
            {"idle", idle, above(0, 3600), "--idle",
             "s between frames that are read where nothing moves"},
            {"restart", restart, above(0, 3600)},
            {"max_restart", max_restart, above(0, 3600)},
            {"threads", threads, range(1, 1024)}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};

struct SiteCamera {
  std::string name;  // Frame::name, and so the source of its events
  std::function<std::unique_ptr<FrameSource>()> open;
  VideoReader reader;  // copies share the models
};

// When a frame was taken; and by how much the wall clock was set since the last one.
struct SiteMoment {
  FrameMoment seen;
  std::chrono::milliseconds step{0};
};

// What a site says. One call at a time, from any thread; what they throw ends the run.
struct SiteHandlers {
  std::function<SiteMoment(const Frame& frame)> moment;  // may be empty: events have no such times
  // Of camera `camera`, in order. Ids count through all cameras.
  std::function<void(std::size_t camera, const std::vector<PlateEvent>& events)> events;
  // A source has another state, or failed (kLost, with the reason) and will be opened again.
  std::function<void(std::size_t camera, const SourceStatus& status)> source;
};

// How it went with one camera.
struct CameraReport {
  std::string name;
  std::int64_t received = 0;  // frames that came
  std::int64_t looked_at = 0;
  std::int64_t moving = 0;  // of these, while something moved or shortly after
  std::int64_t read = 0;
  std::int64_t in_part = 0;   // of these, only around what moved
  std::int64_t vehicles = 0;  // closed events
  int restarts = 0;
  double cpu_s = 0;  // of reading
};

// Reads the plates of many cameras in one process until `stop`, or until all sources have ended:
//
//   const auto reader = plate::VideoReader::load(ModelStore::find());
//   std::vector<plate::SiteCamera> cameras;
//   for (const auto& [name, url] : urls)
//     cameras.push_back({name, [url] { return open_source(url); }, reader});
//   plate::SiteHandlers handlers;
//   handlers.events = [&](std::size_t camera, const std::vector<plate::PlateEvent>& events) { .. };
//   run_site(cameras, {}, handlers, stop);
//
// Each camera has a thread that waits for frames and looks whether something moves; `threads` more
// read plates. Of live sources only one frame waits to be read: the newest, or the newest in which
// something moved. Where there is more than can be done, each camera loses the same share
// (FairScheduler), and frames in which nothing moves wait for the others, ten `idle` at most. While
// something moves, plates are looked for around it (moved_part()); once each `idle`, and not before four
// such frames, in the whole frame: what stands is known. Where nothing moves and no plate is in sight, a
// frame is read each four `idle`. Of
// other sources every frame waits for its turn. A camera whose
// source fails is opened again, after a while; the others go on. Returns a report a camera.
[[nodiscard]] std::vector<CameraReport> run_site(const std::vector<SiteCamera>& cameras,
                                                 const SiteOptions& options,
                                                 const SiteHandlers& handlers,
                                                 const std::stop_token& stop);

}  // namespace tarsier::plate
