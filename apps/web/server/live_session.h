// SPDX-License-Identifier: MIT
#pragma once

#include "child_process.h"
#include "jpeg_quality_control.h"
#include "live_protocol.h"
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

namespace tarsier::web {

// Wakes one viewer after a change in any of its sessions.
class Waker {
 public:
  void wake();
  // Waits until wake() was called since the last wait, or until `timeout` has passed.
  void wait(std::chrono::milliseconds timeout);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_due_ = false;
};

// A verb with a window, run as a child process whose window is a pair of pipes (TARSIER_WINDOW).
// Keeps only the newest image and state; viewers skip intermediate ones. Thread-safe.
class LiveSession {
 public:
  using Clock = std::chrono::steady_clock;

  struct Options {
    std::string id;
    std::string verb;                                          // "cartoon run"
    std::string name;                                          // for people
    std::vector<std::string> inputs;                           // as requested
    nlohmann::json flags = nlohmann::json::object();           // as requested
    std::string shell_text;                                    // the command, for people
    std::vector<std::string> arguments;                        // the program's path first
    std::vector<std::pair<std::string, std::string>> secrets;  // replaced in all shown text
    // Added to the server's environment.
    std::vector<std::pair<std::string, std::string>> environment;
    // Its working directory, made at its start and removed after its end; empty: ours.
    std::string folder;
    bool has_camera = false;       // the input is a viewer's camera: frames by offer_frame()
    std::function<void()> on_end;  // called in a thread of the session
    // Called in a thread of the session with the name of a person whom it deleted.
    std::function<void(const std::string& name)> on_forgotten;
  };

  // An image as sent by the child. `number` counts the images of this session.
  struct Image {
    std::uint64_t number = 0;
    std::uint32_t frame = 0;
    std::uint32_t age_ms = 0;  // at the time of reception
    Clock::time_point received;
    std::shared_ptr<const std::string> jpeg;

    [[nodiscard]] std::uint32_t age_now() const;
  };

  // A versioned message: a viewer gets it if its number is greater than the last one that the
  // viewer saw.
  struct VersionedJson {
    std::uint64_t number = 0;
    std::shared_ptr<const std::string> json;
  };

  // Throws InputError if the program cannot be started.
  explicit LiveSession(Options options);
  ~LiveSession();  // ends the child: SIGINT, after 0.3 s SIGKILL
  LiveSession(const LiveSession&) = delete;
  LiveSession& operator=(const LiveSession&) = delete;

  [[nodiscard]] const std::string& id() const { return options_.id; }
  [[nodiscard]] const std::vector<std::string>& inputs() const { return options_.inputs; }
  [[nodiscard]] bool is_running() const;
  // Tells the child that its window was closed and asks it to end; returns at once.
  void close();
  [[nodiscard]] nlohmann::json describe() const;

  // Sends lines of events to the child. Returns the number of all events so far, for
  // wait_until_handled(); nullopt if the child does not accept them.
  std::optional<std::int64_t> send(std::string_view lines);
  // Waits until the session has handled `events` events; their stored data is then on the disk.
  // Returns false if that took longer than `timeout`, or the session ended with an error.
  bool wait_until_handled(std::int64_t events, std::chrono::milliseconds timeout);

  [[nodiscard]] Image image() const;  // the newest; number 0: none yet
  // Requests from the child an image that is newer than the newest one here.
  void request_image();

  // The stage images of a frame: record D of pipe_window.h.
  struct Stages {
    std::uint64_t number = 0;  // 0: none yet
    std::shared_ptr<const std::string> record;
  };
  [[nodiscard]] Stages stages() const;
  // Requests the stages of the child's next frame. Returns false if it has none.
  bool request_stages();
  [[nodiscard]] VersionedJson hello() const;
  [[nodiscard]] VersionedJson state() const;
  [[nodiscard]] VersionedJson ended() const;  // json is null while the session runs

  // `max_width` is the width at which the viewer shows images, px; 0: full size; or kNoImages. The
  // child sends images in the largest requested size.
  static constexpr int kNoImages = -1;
  void add_viewer(const std::shared_ptr<Waker>& viewer, int max_width = 0);
  void remove_viewer(const std::shared_ptr<Waker>& viewer);
  // Sets the JPEG quality of the viewer (JpegQualityControl). The child sends images in the highest
  // requested quality. A new viewer starts with JpegQualityControl::kMaxQuality.
  void set_quality(const std::shared_ptr<Waker>& viewer, int quality);
  // The quality that was requested from the child.
  [[nodiscard]] int quality() const;
  // The number of the first image that certainly has the size and quality that viewers now request.
  [[nodiscard]] std::uint64_t first_fitting_image() const;

  // The newest frame of the viewer's camera; replaces a frame that has not been written yet.
  void offer_frame(std::shared_ptr<const std::string> jpeg);
  void end_camera();  // ends the source

 private:
  void work();
  void take_record(char kind, std::string payload);
  void take_forgotten(nlohmann::json& value);
  void append_line(std::deque<std::string>& lines, std::string_view line);
  void handle_end(const ChildEnd& end);
  void wake_viewers();           // call it with the mutex held
  void apply_viewer_settings();  // call it with the mutex held
  void wake_worker() const;
  void remove_folder() const;
  void write_events();
  void write_camera();

  const Options options_;
  const Clock::time_point started_ = Clock::now();

  mutable std::mutex mutex_;  // protects the following members
  VersionedJson hello_;
  VersionedJson state_;
  VersionedJson ended_;
  nlohmann::json hello_json_ = nlohmann::json::object();
  nlohmann::json state_json_ = nlohmann::json::object();
  Image image_;
  bool is_image_requested_ = false;  // an image was requested and has not arrived
  bool is_closing_ = false;
  bool is_destroyed_ = false;
  std::optional<ChildEnd> end_;
  std::string error_;
  std::int64_t frames_ = 0;
  std::int64_t last_index_ = -1;
  std::deque<Clock::time_point> frame_times_;  // of the last two seconds
  std::deque<std::string> log_;
  std::deque<std::string> output_;
  struct Viewer {
    std::shared_ptr<Waker> waker;
    int max_width = 0;
    int quality = JpegQualityControl::kMaxQuality;
  };
  std::vector<Viewer> viewers_;
  int max_width_ = 0;  // requested from the child
  int quality_ = JpegQualityControl::kMaxQuality;
  std::uint64_t first_fitting_image_ = 1;  // see first_fitting_image()
  Stages stages_;
  bool are_stages_requested_ = false;
  std::string outbox_;  // lines for the child's window that are not written yet
  std::int64_t events_sent_ = 0;
  std::int64_t events_handled_ = 0;
  std::condition_variable handled_;
  std::shared_ptr<const std::string> camera_next_;
  bool has_camera_ended_ = false;

  // Used only by work().
  int records_fd_ = -1;
  int events_fd_ = -1;
  int camera_fd_ = -1;
  std::string camera_now_;
  std::size_t camera_written_ = 0;
  std::size_t forgotten_count_ = 0;  // names that on_forgotten got
  int wake_fd_ = -1;

  std::unique_ptr<ChildProcess> child_;
  std::thread thread_;
};

}  // namespace tarsier::web
