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
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags of all verbs that run a session on frames: inputs, output, window, live sources.
struct RunFlags {
  std::vector<std::string> inputs;
  std::string output;  // empty: the window
  SourceOptions source;
  SinkOptions sink;
  std::string token_file;
  // Duration of the files that a video is cut into: "10m"; empty: one file.
  std::string segment;
  bool window = false;
  bool fullscreen = false;
  std::string actions;      // "-": actions by name on stdin
  std::int64_t frames = 0;  // stop after this number; 0: all
  int every = 1;            // process every n-th frame
  BatchFlags batch;
};

// `batches`: whether single images make sense, so that they can be divided among runs (batch.h).
void add_run_flags(Command& verb, RunFlags& flags, bool batches = true);

// For verbs whose output is text: without -o and without a window, no image is written.
void default_to_headless(RunFlags& flags);

// Returns --listen-all and the token of --token or --token-file. Throws InputError for the file.
[[nodiscard]] HttpAccess http_access(const RunFlags& flags);

// Whether the run shows a window: it was requested, or there is no other output.
[[nodiscard]] bool opens_window(const RunFlags& flags);

// Receives the stages of each frame. With --debug-dir it writes DIR/<frame number or image
// name>/NN-<stage>.png. In a window that can show stages (the studio's) it passes on the stages of
// the frames for which they are requested.
class DebugFolder final : public DebugSink {
 public:
  explicit DebugFolder(std::string folder)
      : folder_(std::move(folder)), may_show_(window::supports_stages()) {}
  // Null if the stages cannot be shown or written.
  [[nodiscard]] DebugSink* sink() { return folder_.empty() && !may_show_ ? nullptr : this; }
  [[nodiscard]] bool may_show() const { return may_show_; }
  void set_window(window::Window* window) { window_ = window; }  // must outlive the session's work
  void begin(const Frame& frame);  // the following stages belong to this frame
  void image(std::string_view name, const cv::Mat& image) override;  // throws OutputError
  void end();  // passes the requested stages to the window
  [[nodiscard]] bool is_watched() const override { return !folder_.empty() || is_shown(); }

 private:
  // A still is processed only once, and somebody may look at its stages later.
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

// The first cells of a --csv row, for the columns "frame,time,image": the frame's number, its time
// (s), and the name of a still image; for a frame of a video the third cell is empty.
[[nodiscard]] std::string frame_cells(const Frame& frame);

// What an area adds to the loop. Every member may be empty.
struct RunHooks {
  std::string title;                               // of the window and the progress bar: "cartoon"
  std::function<void(const Frame&)> before_frame;  // before the session gets the frame
  std::function<void(const Frame&)> after_frame;   // after the session has processed it
  DebugFolder* debug = nullptr;                    // called for each new frame
  bool quiet_frames = false;                       // no JSON line for each frame of a video
  // The area's part of a frame's JSON line.
  std::function<void(const View&, nlohmann::ordered_json& line)> describe;
  // --csv: the rows of a frame that the session has processed.
  BatchTable table;
  std::function<std::vector<std::string>(const Frame&)> rows;
};

// The loop. It passes frames from the inputs through the session to the output, the window and JSON
// lines.
// - Reading, processing and writing of files overlap, but the order is kept. From live sources only
//   the newest frame is taken.
// - With --json it prints one line per frame: {"image"} for stills, else {"frame","time"}; for live
//   sources "age_ms" (from the frame's last byte until now) and "source"; "output" if a file was
//   written; and the area's part. A state change of a live source prints {"source","detail"}, a key
//   or action {"event","state"}.
// - In a window, videos play at their own speed. A still image is shown until the user presses the
//   right arrow or Enter, and is then written.
// - After SIGINT or an error of the source the output is completed: written data stays valid.
// - With --shard or --jsonl the inputs are images and the results are written to a batch (batch.h).
// Returns kDone or kInterrupted. Throws the library's errors.
[[nodiscard]] ExitStatus run_session(Session& session, const RunFlags& flags, Context& context,
                                     const RunHooks& hooks);

}  // namespace tarsier::cli
