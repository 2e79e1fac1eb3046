// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/frame_sink.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/http_service.h"

#include "framework/batch.h"
#include "framework/cli.h"
#include "ui/session.h"
#include "window.h"
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags of every verb that takes frames through a session: inputs, output, window, live
// sources.
struct RunFlags {
  std::vector<std::string> inputs;
  std::string output;  // empty: the window
  SourceOptions source;
  SinkOptions sink;
  std::string token_file;
  std::string segment;  // duration of the files that a video is cut into: "10m"; empty: one file
  bool window = false;
  bool fullscreen = false;
  std::string actions;      // "-": actions by name on stdin
  std::int64_t frames = 0;  // stop after so many; 0: all
  int every = 1;            // take every n-th frame
  BatchFlags batch;
};

// `batches`: whether images by themselves make sense, and so can be shared among runs (batch.h).
void add_run_flags(Command& verb, RunFlags& flags, bool batches = true);

// For verbs whose readings are their output: without -o and a window, no image is written.
void default_to_headless(RunFlags& flags);

// --listen-all and the token of --token or --token-file. Throws InputError for the file.
[[nodiscard]] HttpAccess http_access(const RunFlags& flags);

// Whether the run shows a window: asked for, or nowhere else to go.
[[nodiscard]] bool opens_window(const RunFlags& flags);

// The stages of each frame. --debug-dir: DIR/<frame number or image name>/NN-<stage>.png; and
// in a window that has a place for them (the studio's), of frames of which they are wanted.
class DebugFolder final : public DebugSink {
 public:
  explicit DebugFolder(std::string folder)
      : folder_(std::move(folder)), may_show_(window::takes_stages()) {}
  // Null where nobody can look at them.
  [[nodiscard]] DebugSink* sink() { return folder_.empty() && !may_show_ ? nullptr : this; }
  [[nodiscard]] bool may_show() const { return may_show_; }
  void show_in(window::Window* window) { window_ = window; }  // must outlive the session's work
  void begin(const Frame& frame);                             // what follows belongs to this frame
  void image(std::string_view name, const cv::Mat& image) override;  // throws OutputError
  void end();  // gives the window what it wants
  [[nodiscard]] bool is_watched() const override { return !folder_.empty() || is_shown(); }

 private:
  // A still is worked on once: somebody may look later.
  [[nodiscard]] bool is_shown() const {
    return window_ != nullptr && (is_still_ || window_->wants_stages());
  }

  std::string folder_;
  std::string frame_folder_;
  int number_ = 0;
  bool may_show_;
  bool is_still_ = false;
  window::Window* window_ = nullptr;
  std::vector<window::Stage> stages_;
};

// The first cells of a row of --csv, of the columns "frame,time,image": the frame's number, its time
// (s), and the name of an image by itself; of frames of a video that cell is empty.
[[nodiscard]] std::string frame_cells(const Frame& frame);

// What an area adds to the loop. All may be empty.
struct RunHooks {
  std::string title;                               // of the window and the progress bar: "cartoon"
  std::function<void(const Frame&)> before_frame;  // just before the session gets it
  std::function<void(const Frame&)> after_frame;   // when the session has dealt with it
  DebugFolder* debug = nullptr;                    // is called for each frame that begins
  bool quiet_frames = false;                       // no JSON line for each frame of a video
  // The area's part of a frame's JSON line.
  std::function<void(const View&, nlohmann::ordered_json& line)> describe;
  // --csv: the rows of a frame that the session has dealt with.
  BatchTable table;
  std::function<std::vector<std::string>(const Frame&)> rows;
};

// The loop: frames from the inputs through the session into the output, the window and JSON lines.
// - Reading, processing and writing of files overlap; order is kept. Of live sources only the
//   newest frame is taken.
// - With --json, one line per frame: {"image"} for stills, else {"frame","time"}; for live sources
//   "age_ms" (from the frame's last byte until now) and "source"; "output" where a file was
//   written; and the area's part. A change of a live source gives {"source","detail"}, a key or
//   action {"event","state"}.
// - In a window, videos play at their own speed; a still image waits for the right arrow or Enter,
//   and is written when the user goes on.
// - SIGINT and errors of the source finish the output: what was written stays and is valid.
// - With --shard or --jsonl the inputs are images, and what is found goes to a batch (batch.h).
// Returns kDone or kInterrupted; throws the library's errors.
[[nodiscard]] ExitStatus run_session(Session& session, const RunFlags& flags, Context& context,
                                     const RunHooks& hooks);

}  // namespace tarsier::cli
