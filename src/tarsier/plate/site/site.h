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
  double max_fps = 10;  // frames per second that are examined, for each camera
  MotionOptions motion;
  double hold = 2;          // s after the last motion during which frames are still read
  double idle = 1;          // s between the frames that are read while nothing moves
  double restart = 1;       // s before a failed camera is opened again; doubles each time
  double max_restart = 30;  // upper limit of this delay, s
  int threads = 1;          // threads that read plates

  [[nodiscard]] OptionFields fields() {
    return {
        {"max_fps", max_fps, above(0, 1000), "--camera-fps",
         "frames per second to process, for each camera"},
        {"hold", hold, range(0, 3600), "--motion-hold",
         "s, how long frames are read after the last motion"},
        {"idle", idle, above(0, 3600), "--idle", "s between frames that are read without motion"},
        {"restart", restart, above(0, 3600)},
        {"max_restart", max_restart, above(0, 3600)},
        {"threads", threads, range(1, 1024)}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};

struct SiteCamera {
  std::string name;  // Frame::name, and so the source of the camera's events
  std::function<std::unique_ptr<FrameSource>()> open;
  VideoReader reader;  // copies share the models
};

// The time at which a frame was taken, and the step of the wall clock since the previous frame.
struct SiteMoment {
  FrameMoment frame_moment;
  std::chrono::milliseconds step{0};
};

// The callbacks of a site. They are called one at a time, from any thread. An exception of a
// callback ends the run.
struct SiteHandlers {
  // May be empty: events then have no wall-clock times.
  std::function<SiteMoment(const Frame& frame)> moment;
  // Events of camera `camera`, in order. Ids are unique across all cameras.
  std::function<void(std::size_t camera, const std::vector<PlateEvent>& events)> events;
  // The state of a source has changed. After a failure (kLost, with the reason) the source is
  // opened again.
  std::function<void(std::size_t camera, const SourceStatus& status)> source;
};

// Statistics of one camera.
struct CameraReport {
  std::string name;
  std::int64_t received = 0;  // frames received
  std::int64_t examined = 0;
  std::int64_t moving = 0;  // of examined: during motion or within `hold` after it
  std::int64_t read = 0;
  std::int64_t read_partially = 0;  // of read: only the region around motion
  std::int64_t vehicles = 0;        // closed events
  int restarts = 0;                 // how often the source was opened again
  double cpu_s = 0;                 // processor time of reading
};

// Reads the plates of many cameras in one process, until `stop` is requested or all sources have
// ended:
//
//   const auto reader = plate::VideoReader::load(ModelStore::find());
//   std::vector<plate::SiteCamera> cameras;
//   for (const auto& [name, url] : urls)
//     cameras.push_back({name, [url] { return open_source(url); }, reader});
//   plate::SiteHandlers handlers;
//   handlers.events = [&](std::size_t camera, const std::vector<plate::PlateEvent>& events) { .. };
//   run_site(cameras, {}, handlers, stop);
//
// Each camera has a thread that waits for frames and detects motion. `threads` more threads read
// plates.
//
// For a live source only one frame waits to be read: the newest one, or the newest one with motion.
// For other sources every frame waits for its turn. When the machine is overloaded, each camera
// loses the same share (FairScheduler). Frames without motion give way to the others for at most
// ten `idle` periods.
//
// During motion, plates are searched in the region around it (motion_box()). The whole frame is
// searched once per `idle` period, but only after at least four frames that were read in part,
// because standing vehicles are known already. If nothing moves and no plate is in view, one frame
// is read every four `idle` periods.
//
// A camera whose source fails is opened again after a delay, and the vehicles in its view are
// closed; the other cameras continue. While a source that opens itself again delivers no frame, its
// vehicles are closed as if they had left. Returns one report per camera.
[[nodiscard]] std::vector<CameraReport> run_site(const std::vector<SiteCamera>& cameras,
                                                 const SiteOptions& options,
                                                 const SiteHandlers& handlers,
                                                 const std::stop_token& stop);

}  // namespace tarsier::plate
