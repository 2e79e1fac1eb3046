// SPDX-License-Identifier: MIT
#pragma once

#include "child_process.h"
#include "live_protocol.h"
#include "viewer_pace.h"
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

// Wakes one viewer, whatever happened to any of the sessions it watches.
class Waker {
 public:
  void wake();
  // Waits until wake() was called since the last time, or `patience` is over.
  void wait(std::chrono::milliseconds patience);

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_due_ = false;
};

// A verb with a window, run as a child process whose window is a pair of pipes (TARSIER_WINDOW).
// Keeps the newest image and state; whatever a viewer missed in between is gone. Thread-safe.
class LiveSession {
 public:
  using Clock = std::chrono::steady_clock;

  struct Options {
    std::string id;
    std::string verb;                                          // "cartoon run"
    std::string name;                                          // for people
    std::vector<std::string> inputs;                           // as they were asked for
    nlohmann::json flags = nlohmann::json::object();           // the same
    std::string shown;                                         // the command, for people
    std::vector<std::string> arguments;                        // the program's path first
    std::vector<std::pair<std::string, std::string>> secrets;  // replaced in all that it shows
    // Added to that of the server.
    std::vector<std::pair<std::string, std::string>> environment;
    bool has_camera = false;       // a viewer's camera is its input: frames by offer_frame()
    std::function<void()> on_end;  // in a thread of the session
  };

  // An image as the child sent it. `number` counts those of this session.
  struct Image {
    std::uint64_t number = 0;
    std::uint32_t frame = 0;
    std::uint32_t age_ms = 0;  // when it was received
    Clock::time_point received;
    std::shared_ptr<const std::string> jpeg;

    [[nodiscard]] std::uint32_t age_now() const;
  };

  // What a viewer has not seen: everything whose number is greater than what it saw.
  struct News {
    std::uint64_t number = 0;
    std::shared_ptr<const std::string> json;
  };

  // Throws InputError where the program cannot be started.
  explicit LiveSession(Options options);
  ~LiveSession();  // ends the child: SIGINT, 0.3 s later SIGKILL
  LiveSession(const LiveSession&) = delete;
  LiveSession& operator=(const LiveSession&) = delete;

  [[nodiscard]] const std::string& id() const { return options_.id; }
  [[nodiscard]] const std::vector<std::string>& inputs() const { return options_.inputs; }
  [[nodiscard]] bool is_running() const;
  // Tells the child that its window was closed and asks it to end; returns at once.
  void close();
  [[nodiscard]] nlohmann::json describe() const;

  // The lines of events, to the child. The number of all events so far, for wait_until_handled();
  // nothing where it does not take them.
  std::optional<std::int64_t> send(std::string_view lines);
  // Until the session has handled so many events: what it keeps of them is on the disk then. False
  // where it did not within `patience`, or ended by an error before.
  bool wait_until_handled(std::int64_t events, std::chrono::milliseconds patience);

  [[nodiscard]] Image image() const;  // the newest; number 0: none yet
  // Asks the child for an image that is newer than the newest one here.
  void want_image();

  // The images of the stages of a frame: record D of pipe_window.h.
  struct Stages {
    std::uint64_t number = 0;  // 0: none yet
    std::shared_ptr<const std::string> record;
  };
  [[nodiscard]] Stages stages() const;
  // Asks the child for those of its next frame. False where it gives none.
  bool want_stages();
  [[nodiscard]] News hello() const;
  [[nodiscard]] News state() const;
  [[nodiscard]] News ended() const;  // json null while it runs

  // `max_width`: as wide as the viewer shows images, px; 0: as they are; kNoImages. The child
  // sends them as the viewer wants them that wants most.
  static constexpr int kNoImages = -1;
  void add_viewer(const std::shared_ptr<Waker>& viewer, int max_width = 0);
  void remove_viewer(const std::shared_ptr<Waker>& viewer);
  // The JPEG quality that the viewer's line carries (ViewerPace); the child sends images as the
  // viewer wants them that can take most. One that was added has ViewerPace::kBest at first.
  void set_quality(const std::shared_ptr<Waker>& viewer, int quality);
  // What the child was asked for.
  [[nodiscard]] int quality() const;
  // The number of the first image that surely has the size and the quality that viewers want now.
  [[nodiscard]] std::uint64_t fitting() const;

  // The newest frame of the viewer's camera; replaces one that has not been written yet.
  void offer_frame(std::shared_ptr<const std::string> jpeg);
  void end_camera();  // the source ends

  [[nodiscard]] ChildProcess::Use use() const;

 private:
  void work();
  void take_record(char kind, std::string payload);
  void note_line(std::deque<std::string>& lines, std::string_view line);
  void note_end(const ChildEnd& end);
  void wake_viewers();  // with the mutex held
  void fit_viewers();   // likewise
  [[nodiscard]] std::string without_secrets(std::string text) const;
  void nudge() const;
  void write_events();
  void write_camera();

  const Options options_;
  const Clock::time_point started_ = Clock::now();

  mutable std::mutex mutex_;  // of what follows
  News hello_;
  News state_;
  News ended_;
  nlohmann::json hello_json_ = nlohmann::json::object();
  nlohmann::json state_json_ = nlohmann::json::object();
  Image image_;
  bool is_wanted_ = false;  // an image was asked for and has not come
  bool is_closing_ = false;
  bool is_over_ = false;
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
    int quality = ViewerPace::kBest;
  };
  std::vector<Viewer> viewers_;
  int max_width_ = 0;  // what the child was asked for
  int quality_ = ViewerPace::kBest;
  std::uint64_t fitting_ = 1;  // see fitting()
  Stages stages_;
  bool are_stages_wanted_ = false;
  std::string outbox_;  // for the child's window, not written yet
  std::int64_t events_sent_ = 0;
  std::int64_t events_handled_ = 0;
  std::condition_variable handled_;
  std::shared_ptr<const std::string> camera_next_;
  bool is_camera_over_ = false;

  // Of work() alone.
  int records_fd_ = -1;
  int events_fd_ = -1;
  int camera_fd_ = -1;
  std::string camera_now_;
  std::size_t camera_written_ = 0;
  int wake_fd_ = -1;

  std::unique_ptr<ChildProcess> child_;
  std::thread thread_;
};

}  // namespace tarsier::web
