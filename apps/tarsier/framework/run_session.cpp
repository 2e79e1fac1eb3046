// SPDX-License-Identifier: MIT
#include "framework/run_session.h"

#include "tarsier/core/csv.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>

#include "framework/csv_table.h"
#include "framework/input_schemes.h"
#include "framework/run_pipeline.h"
#include "framework/stopwatch.h"
#include "ui/action_reader.h"
#include "ui/scripted_host.h"
#include "window.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <unistd.h>
#include <utility>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// The window's status is redrawn at this interval if there are no frames.
constexpr milliseconds kIdleInterval{200};
constexpr milliseconds kWindowTimeout{12};     // maximum delay of keys by the wait for a frame
constexpr milliseconds kHeadlessTimeout{100};  // SIGINT ends the wait earlier
// s for which a live video is extended by repeating its last image.
constexpr double kMaxRepeated_s = 10;

// --- the window, where the program has one ---

using WindowPointer = std::unique_ptr<window::Window>;
constexpr const char* kNextImage = "next-image";

// Whether a flag other than that of this output names the same file.
bool has_another_use(const std::string& output, const std::vector<std::string>& words) {
  std::error_code error;
  if (!fs::is_regular_file(output, error)) return false;
  int uses = 0;
  int own_uses = 0;  // none if a file of flags gives the output
  for (const std::string& word : words) {
    const std::size_t equals = word.starts_with("--") ? word.find('=') : std::string::npos;
    const std::string value = equals != std::string::npos ? word.substr(equals + 1)
                              : word.starts_with("-o")    ? word.substr(2)
                                                          : word;
    if (value == output) own_uses = 1;
    if (fs::equivalent(value, output, error)) ++uses;
  }
  return uses > own_uses;
}

// --- the loop ---

class Run {
 public:
  Run(Session& session, const RunFlags& flags, Context& context, const RunHooks& hooks)
      : session_(session), flags_(flags), context_(context), hooks_(hooks), lines_(context.json) {}

  ExitStatus operator()() {
    open();
    const Stopwatch watch;
    try {
      loop();
      flush_still();
      if (writer_ != nullptr && !context_.stop.stop_requested()) writer_->complete();
    } catch (const OutputError&) {
      throw;  // an unfinished output is removed, a recording stays
    } catch (...) {
      finish_quietly();
      throw;
    }
    if (context_.stop.stop_requested()) {
      finish_quietly();
      return ExitStatus::kInterrupted;
    }
    if (sink_ != nullptr) sink_->finish();
    if (shows_progress_) context_.progress->end();
    if (batch_) {
      batch_->finish();
    } else if (processed_ == 0 && !window_closed_ && !finished_) {
      throw InputError(flags_.inputs.front(), "delivered no image");
    }
    if (!flags_.output.empty() && sink_ != nullptr) {
      const std::string target = sink_kind_ == SinkKind::kNone   ? ""
                                 : sink_kind_ == SinkKind::kHttp ? " to " + masked(flags_.output)
                                                                 : " to " + flags_.output;
      log_info("{} {}{} in {:.1f} s", processed_, processed_ == 1 ? "image" : "images", target,
               watch.seconds());
    }
    return ExitStatus::kDone;
  }

 private:
  // --- opening ---

  void open() {
    const std::vector<Scheme> schemes = input_schemes();
    for (const std::string& input : flags_.inputs)
      static_cast<void>(classify_source(input, schemes));
    if (flags_.batch.is_requested()) check_batch();
    if (!flags_.output.empty()) sink_kind_ = classify_sink(flags_.output);
    refuse_to_overwrite(schemes);
    if (!flags_.segment.empty()) {
      if (sink_kind_ != SinkKind::kVideo) throw UsageError("--segment: needs -o with a video file");
      segment_s_ =
          std::chrono::duration<double>(plate::parse_duration(flags_.segment, "--segment")).count();
      if (segment_s_ <= 0) throw UsageError("--segment: expected a duration above 0");
    }
    if (opens_window(flags_)) {
      window::prepare();  // before any thread starts
      session_.draw_status(!window::shows_status());
    }

    if (flags_.batch.is_requested()) {
      open_batch(schemes);
      source_ = batch_->open();
    } else {
      source_ = open_sources(flags_.inputs, flags_.source, schemes);
    }
    if (!hooks_.table.path.empty()) CsvTable::require_writable(hooks_.table.path);
    live_ = source_->is_live();
    if (!live_) source_ = std::make_unique<ReadAhead>(std::move(source_), context_.stop);
    live_video_ = live_ && sink_kind_ == SinkKind::kVideo;
    if (!live_video_) open_output();  // a camera's rate is known after its first frame

    if (opens_window(flags_)) {
      std::string title = fmt::format("Tarsier {}", hooks_.title);
      has_next_ = !live_ && source_->count() > 1 && source_->fps() <= 0;
      if (has_next_ && !window::shows_status()) title += " - right arrow: next image";
      const bool has_stages = hooks_.debug != nullptr && hooks_.debug->may_show();
      window_ = window::open_window(
          {title, flags_.fullscreen, session_.sliders(), actions(), has_stages});
      if (has_stages) hooks_.debug->set_window(window_.get());
      if (live_) idle(source_->status());
    }
    if (!flags_.actions.empty()) {
      actions_.emplace(STDIN_FILENO, session_.actions(), session_.sliders());
    }
    if (!live_ && window_ == nullptr) {
      std::int64_t total = (source_->count() + flags_.every - 1) / flags_.every;
      if (flags_.frames > 0) total = total > 0 ? std::min(total, flags_.frames) : flags_.frames;
      context_.progress->begin(hooks_.title, total, "images");
      shows_progress_ = true;
    }
  }

  void check_batch() const {
    if (opens_window(flags_)) throw UsageError("--shard, --jsonl: need -o and no window");
    if (flags_.source.sequence || flags_.frames > 0 || flags_.every > 1 || !flags_.actions.empty())
      throw UsageError(
          "--shard, --jsonl: process each image independently: not with --sequence, --frames, "
          "--every or --actions");
  }

  void open_batch(const std::vector<Scheme>& schemes) {
    batch_ = std::make_unique<Batch>(flags_.batch, hooks_.table, flags_.inputs, schemes, context_);
    context_.is_batch = true;
    if (sink_kind_ != SinkKind::kFolder) return;
    std::map<std::string, std::string> files;  // in the output folder, which shards share
    for (const std::string& name : batch_->names()) {
      const auto [other, is_new] = files.emplace(fs::path(name).filename().string(), name);
      if (!is_new) {
        throw UsageError(
            fmt::format("-o {}: {} and {} have the same file name: process each folder of images "
                        "in a separate run",
                        flags_.output, printable(other->second), printable(name)));
      }
    }
  }

  // Whether lines and rows are written to the batch.
  [[nodiscard]] bool stores_results() const { return batch_ && batch_->stores_results(); }

  // The session's actions and the host's own.
  [[nodiscard]] std::vector<Action> actions() const {
    std::vector<Action> list = session_.actions();
    if (has_next_) list.push_back({kNextImage, "next image (right arrow)", 0});
    return list;
  }

  // Throws UsageError if an output would replace an input, a file of another flag, or another
  // output.
  void refuse_to_overwrite(const std::vector<Scheme>& schemes) {
    inputs_ = std::make_shared<const InputFiles>(flags_.inputs, schemes);
    std::vector<std::string> outputs;
    if (sink_kind_ == SinkKind::kImage || sink_kind_ == SinkKind::kVideo)
      outputs.push_back(flags_.output);
    for (const std::string& path : {flags_.batch.jsonl, hooks_.table.path})
      if (!path.empty()) outputs.push_back(path);
    for (const std::string& output : outputs) {
      inputs_->refuse_output(output);
      if (std::count(outputs.begin(), outputs.end(), output) > 1 ||
          has_another_use(output, context_.words)) {
        throw UsageError(
            fmt::format("{}: is used by two flags; an output needs a file of its own", output));
      }
    }
  }

  void open_output() {
    SinkOptions options = flags_.sink;
    options.segment_s = segment_s_;
    options.recording = live_video_;
    options.inputs = inputs_;
    std::error_code ignored;
    replaces_video_ = !live_video_ && segment_s_ == 0 && sink_kind_ == SinkKind::kVideo &&
                      fs::exists(flags_.output, ignored);
    options.token = http_access(flags_).token;
    fps_ = source_->fps() > 0 ? source_->fps() : options.fps;
    if (!live_) fps_ /= flags_.every;
    options.fps = std::clamp(fps_, 0.1, 1000.0);
    options.many = source_->count() != 1 && flags_.frames != 1;
    if (batch_) options.many = batch_->names().size() != 1;
    sink_ = open_sink(flags_.output.empty() ? "none" : flags_.output, options);
    // A live image must be written immediately; files may be queued.
    writer_ = std::make_unique<Writer>(*sink_, lines_, batch_.get(), !live_);
  }

  // --- running ---

  void loop() {
    const std::stop_token& stop = context_.stop;
    Clock::time_point last_shown = Clock::now();
    while (!stop.stop_requested() && !finished_) {
      handle_events(milliseconds(0));
      if (finished_) break;
      if (waits_for_user()) {
        if (!wait_for_user()) break;
        continue;
      }
      const milliseconds timeout = window_ != nullptr ? kWindowTimeout : kHeadlessTimeout;
      std::optional<Frame> frame;
      try {
        frame = source_->next(timeout, stop);
      } catch (const SourceLostError&) {
        report_state();  // the last output
        throw;
      }
      if (live_) report_state();
      if (frame) {
        if (received_++ % flags_.every != 0) continue;
        process_frame(*frame);
        last_shown = Clock::now();
        if (flags_.frames > 0 && processed_ >= flags_.frames) break;
      } else if (source_->ended()) {
        break;
      } else if (live_ && Clock::now() - last_shown > kIdleInterval) {
        idle(source_->status());
        last_shown = Clock::now();
      }
    }
  }

  // Whether a paused video, or a still in the window, waits for the user.
  [[nodiscard]] bool waits_for_user() const {
    return !live_ && ((paused_ && processed_ > 0) || (window_ != nullptr && still_.has_value()));
  }

  // Returns false if nobody can ever continue.
  bool wait_for_user() {
    if (window_ == nullptr && (!actions_ || actions_->ended())) {
      log_warning("paused, and the actions have ended: stopping");
      return false;
    }
    playback_start_.reset();
    if (window_ != nullptr) {
      handle_events(milliseconds(50));
    } else {
      sleep_unless_stopped(milliseconds(20), context_.stop);
    }
    return true;
  }

  void process_frame(Frame& frame) {
    if (live_video_ && sink_ == nullptr) open_output();
    if (hooks_.before_frame) hooks_.before_frame(frame);
    if (hooks_.debug != nullptr) hooks_.debug->begin(frame);
    const SourceStatus status = source_->status();
    update_source_info(status);
    info_.index = frame.index;
    info_.time = frame.time;
    info_.name = frame.name;
    if (live_) info_.captured = frame.captured;
    View view;
    try {
      view = session_.on_frame(frame, status);
    } catch (const InputError& error) {  // an image that was read, but cannot be used
      if (!frame.still || (source_->count() == 1 && !batch_)) throw;
      log_warning("{}", error.what());
      if (batch_) batch_->skip(frame.index, error.what());
      return;
    }
    ++processed_;
    if (!hooks_.table.path.empty() && !stores_results() && !table_)
      table_.emplace(hooks_.table.path, hooks_.table.columns);
    if (hooks_.after_frame) hooks_.after_frame(frame);
    std::vector<std::string> rows;
    if (hooks_.rows && (table_ || stores_results())) rows = hooks_.rows(frame);
    if (table_)
      for (const std::string& row : rows) table_->add(row);
    if (shows_progress_) context_.progress->advance();
    paused_ = view.state.value("paused", false);
    if (!view.output.empty()) {
      WriteJob job = job_of(frame, view, status);
      if (stores_results()) job.rows = std::move(rows);
      if (window_ != nullptr && frame.still) {
        still_ = std::move(job);  // until the user continues
      } else {
        writer_->write(std::move(job));
      }
    }
    if (window_ != nullptr && !live_ && !frame.still) pace(frame.time);
    show(view);
    if (hooks_.debug != nullptr) hooks_.debug->end();
  }

  WriteJob job_of(const Frame& frame, const View& view, const SourceStatus& status) {
    WriteJob job;
    job.image = live_ && !live_video_ ? view.output : view.output.clone();
    job.frame = frame;
    job.frame.image.release();
    job.live = live_;
    if (live_video_) {
      const auto due = static_cast<std::int64_t>(std::floor(frame.time * fps_)) + 1;
      job.repeats = static_cast<int>(std::clamp<std::int64_t>(
          due - video_frames_, 0, static_cast<std::int64_t>(fps_ * kMaxRepeated_s)));
      video_frames_ = std::max(due, video_frames_);
    }
    job.silent = !lines_.enabled() || (hooks_.quiet_frames && !frame.still);
    if (job.silent && !stores_results()) return job;
    describe(frame, view, job.line);
    if (live_) job.line["source"] = name_of(status.state);
    return job;
  }

  void describe(const Frame& frame, const View& view, nlohmann::ordered_json& line) const {
    line = nlohmann::ordered_json::object();
    if (frame.still) {
      line["image"] = frame.name;
    } else {
      line["frame"] = frame.index;
      line["time"] = rounded(frame.time, 6);
    }
    if (hooks_.describe) hooks_.describe(view, line);
  }

  // Videos play at their own speed.
  void pace(double time) {
    const auto at = [&](double seconds) {
      return *playback_start_ +
             std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
    };
    const Clock::time_point now = Clock::now();
    const bool late =
        // this machine is too slow for the video
        playback_start_ && now - at(time) > milliseconds(500);
    const bool early =
        playback_start_ && at(time) - now > std::chrono::seconds(5);  // another video
    if (!playback_start_ || late || early) {
      playback_start_ =
          now - std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(time));
    }
    const Clock::time_point due = at(time);
    while (!context_.stop.stop_requested() && !finished_) {
      const auto left = std::chrono::duration_cast<milliseconds>(due - Clock::now());
      if (left <= milliseconds(1)) break;
      handle_events(std::min(left, milliseconds(50)));
    }
  }

  void report_state() {
    const SourceStatus status = source_->status();
    if (status.state == last_state_) return;
    last_state_ = status.state;
    lines_.print({{"source", name_of(status.state)}, {"detail", status.detail}});
    if (status.state != SourceState::kLive) idle(status);
  }

  // The state of the source is shown with the view.
  void update_source_info(const SourceStatus& status) {
    info_.source = live_ ? name_of(status.state) : "file";
    info_.detail = live_ ? status.detail : "";
  }

  void idle(const SourceStatus& status) {
    update_source_info(status);
    show(session_.on_idle(status));
  }

  // --- the user ---

  void handle_events(milliseconds timeout) {
    std::vector<Event> events;
    if (window_ != nullptr) {
      events = window_->poll(timeout);
      if (window_->closed()) {
        finished_ = window_closed_ = true;
        return;
      }
    }
    if (actions_) {
      std::vector<Event> more = actions_->read();
      std::move(more.begin(), more.end(), std::back_inserter(events));
    }
    std::optional<View> last;
    for (const Event& event : events) {
      const bool is_next = event.kind == Event::Kind::kAction
                               ? has_next_ && event.name == kNextImage
                               : event.kind == Event::Kind::kKey &&
                                     (event.key == key::kRight || event.key == key::kEnter);
      if (is_next && (still_ || event.kind == Event::Kind::kAction)) {
        next_image();
        last.reset();
        continue;
      }
      last.reset();  // a view is valid until the next call
      last = session_.on_event(event);
      after_event(event, *last);
    }
    if (last) {
      show(*last);
      if (hooks_.debug != nullptr) hooks_.debug->end();
    }
  }

  void next_image() {
    if (!still_ || source_->ended()) return;
    flush_still();
    paused_ = false;
  }

  void after_event(const Event& event, const View& view) {
    paused_ = view.state.value("paused", false);
    finished_ = finished_ || view.finished;
    if (still_ && !view.output.empty()) {
      still_->image = view.output.clone();
      if (lines_.enabled() && hooks_.describe) hooks_.describe(view, still_->line);
    }
    if (event.kind == Event::Kind::kKey || event.kind == Event::Kind::kAction) {
      lines_.print({{"event", tarsier::describe(event)}, {"state", view.state}});
    }
    if (window_ == nullptr) return;
    if (view.toggle_fullscreen) window_->set_fullscreen(!window_->fullscreen());
    if (event.kind != Event::Kind::kMouse) window_->set_controls(actions(), session_.sliders());
  }

  void show(const View& view) {
    finished_ = finished_ || view.finished;
    if (window_ != nullptr) window_->show(view, &info_);
  }

  // --- the end ---

  void flush_still() {
    if (!still_) return;
    WriteJob job = std::move(*still_);
    still_.reset();
    writer_->write(std::move(job));
  }

  // Completes the written data, whatever else failed.
  void finish_quietly() {
    try {
      if (writer_ == nullptr) return;
      writer_->cancel();
      if (writer_->written() == 0) return;
      if (replaces_video_) {
        log_warning("{}: is unchanged, because the new video is incomplete", flags_.output);
      } else {
        sink_->finish();
      }
    } catch (const Error& error) {
      log_warning("{}", error.what());
    }
  }

  Session& session_;
  const RunFlags& flags_;
  Context& context_;
  const RunHooks& hooks_;
  LinePrinter lines_;
  std::unique_ptr<Batch> batch_;  // null: not a batch
  std::optional<CsvTable> table_;
  std::shared_ptr<const InputFiles> inputs_;
  std::unique_ptr<FrameSource> source_;
  std::unique_ptr<FrameSink> sink_;
  std::unique_ptr<Writer> writer_;
  WindowPointer window_;
  std::optional<ActionReader> actions_;
  SinkKind sink_kind_ = SinkKind::kNone;
  bool live_ = false;
  bool live_video_ = false;      // a live source written to a video file
  bool replaces_video_ = false;  // an older file, by a video made from files
  double segment_s_ = 0;         // of a video's files
  bool shows_progress_ = false;
  bool paused_ = false;
  bool finished_ = false;
  bool window_closed_ = false;
  bool has_next_ = false;  // the user steps through several stills
  window::FrameInfo info_;
  double fps_ = 25;
  std::int64_t received_ = 0;
  std::int64_t processed_ = 0;
  std::int64_t video_frames_ = 0;
  std::optional<WriteJob> still_;                    // shown in the window, not yet written
  std::optional<Clock::time_point> playback_start_;  // the time at which the video's time was 0
  std::optional<SourceState> last_state_;
};

}  // namespace

std::string frame_cells(const Frame& frame) {
  return fmt::format("{},{:.3f},{}", frame.index, frame.time,
                     csv_field(frame.still ? frame.name : ""));
}

ExitStatus run_session(Session& session, const RunFlags& flags, Context& context,
                       const RunHooks& hooks) {
  return Run(session, flags, context, hooks)();
}

}  // namespace tarsier::cli
