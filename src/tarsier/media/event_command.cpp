// SPDX-License-Identifier: MIT
#include "tarsier/media/event_command.h"

#include "tarsier/core/log.h"
#include "tarsier/core/require.h"

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <deque>
#include <fcntl.h>
#include <functional>
#include <mutex>
#include <new>
#include <optional>
#include <poll.h>
#include <pthread.h>
#include <spawn.h>
#include <string_view>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>

// The environment of this process (POSIX; no header declares it without extensions).
extern char** environ;  // NOLINT(readability-redundant-declaration)

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// Interval of checks of a running command; each event is delayed by at most this time.
constexpr milliseconds kGlance{10};
// Wait after SIGKILL; a process that stays in the kernel for longer is left to it.
constexpr milliseconds kDying{500};

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

struct Child {
  pid_t process = -1;
  int input = -1;  // its stdin, not blocking; -1: closed
};

void close_input(Child& child) {
  if (child.input >= 0) ::close(std::exchange(child.input, -1));
}

std::optional<Child> start(const std::string& command) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return std::nullopt;
  ::fcntl(ends[1], F_SETFL, O_NONBLOCK);
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_adddup2(&actions, ends[0], STDIN_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
  // Libraries also open files without close-on-exec.
  ::posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
  // Our threads block the signals that end programs, and SIGPIPE; the command must not.
  sigset_t none;
  sigemptyset(&none);
  sigset_t defaults;
  sigemptyset(&defaults);
  sigaddset(&defaults, SIGPIPE);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(
      &attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  std::string shell = "/bin/sh";
  std::string flag = "-c";
  std::string text = command;
  char* arguments[] = {shell.data(), flag.data(), text.data(), nullptr};
  Child child;
  const int error =
      ::posix_spawn(&child.process, shell.c_str(), &actions, &attributes, arguments, environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  ::close(ends[0]);
  child.input = ends[1];
  if (error == 0) return child;
  close_input(child);
  return std::nullopt;
}

// Writes as much as possible; closes when all is written or nobody reads.
void feed(Child& child, std::string_view& rest) {
  while (child.input >= 0 && !rest.empty()) {
    const ssize_t written = ::write(child.input, rest.data(), rest.size());
    if (written > 0) {
      rest.remove_prefix(static_cast<std::size_t>(written));
    } else if (errno == EAGAIN || errno == EWOULDBLOCK) {
      return;
    } else if (errno != EINTR) {
      break;  // EPIPE: the command does not read it
    }
  }
  close_input(child);
}

}  // namespace

class EventCommand::Runner {
 public:
  Runner(std::string command, const EventCommandOptions& options, std::stop_token stop)
      : command_(std::move(command)),
        options_((options.check(), options)),
        stop_(std::move(stop)),
        on_stop_(stop_, [this] { interrupt(); }) {
    TARSIER_REQUIRE(!command_.empty(), "an empty command");
    thread_ = std::jthread([this] { work(); });
  }
  ~Runner() { finish(); }

  void post(std::string event) {
    const std::lock_guard lock(mutex_);
    if (is_finishing_) {
      drop();
      return;
    }
    while (waiting_.size() >= options_.max_waiting) {
      waiting_.pop_front();
      drop();
    }
    waiting_.push_back(std::move(event));
    changed_.notify_all();
  }

  void finish() {
    if (!thread_.joinable()) return;
    {
      const std::lock_guard lock(mutex_);
      is_finishing_ = true;
      const Clock::time_point end = Clock::now() + seconds(options_.finish_s);
      end_ = end_ ? std::min(*end_, end) : end;
      changed_.notify_all();
    }
    thread_.join();
    if (counts_.dropped > 0) {
      log_warning("{}: {} {} dropped in all", options_.name, counts_.dropped,
                  counts_.dropped == 1 ? "event was" : "events were");
    }
  }

  [[nodiscard]] Counts counts() const {
    const std::lock_guard lock(mutex_);
    return counts_;
  }

 private:
  void interrupt() {
    const std::lock_guard lock(mutex_);
    const Clock::time_point end = Clock::now() + seconds(options_.interrupted_s);
    end_ = end_ ? std::min(*end_, end) : end;
    changed_.notify_all();
  }

  // Warns at the first event and whenever the count has doubled, to avoid a flood of warnings.
  void drop() {
    ++counts_.dropped;
    if ((counts_.dropped & (counts_.dropped - 1)) != 0) return;
    log_warning("{}: '{}' is slower than events come: {} dropped so far, the oldest", options_.name,
                command_, counts_.dropped);
  }

  [[nodiscard]] bool is_over() const { return end_ && Clock::now() >= *end_; }

  void work() {
    // A command that does not read its stdin must not end this program: write() reports EPIPE.
    sigset_t pipe;
    sigemptyset(&pipe);
    sigaddset(&pipe, SIGPIPE);
    ::pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
    while (true) {
      std::string event;
      {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return is_finishing_ || !waiting_.empty(); });
        if (waiting_.empty()) return;
        // After an interruption the last events may still arrive until finish().
        if (is_over()) {
          counts_.dropped += static_cast<std::int64_t>(waiting_.size());
          waiting_.clear();
          if (is_finishing_) return;
          continue;
        }
        event = std::move(waiting_.front());
        waiting_.pop_front();
      }
      try {
        run(event + '\n');
      } catch (const std::bad_alloc&) {
        count(&Counts::failed);
      }
    }
  }

  void run(const std::string& line) {
    std::optional<Child> child = start(command_);
    if (!child) {
      count(&Counts::failed);
      log_warning("{}: '{}' could not be started", options_.name, command_);
      return;
    }
    const Clock::time_point began = Clock::now();
    const Clock::time_point timeout = began + seconds(options_.timeout_s);
    std::string_view rest = line;
    int status = 0;
    bool in_time = true;
    while (true) {
      feed(*child, rest);
      const pid_t ended = ::waitpid(child->process, &status, WNOHANG);
      if (ended != 0) break;
      in_time = Clock::now() < timeout;
      if (!in_time || must_end()) {
        kill(*child, in_time);
        return;
      }
      wait(*child, Clock::now() - began);
    }
    close_input(*child);
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) {
      count(&Counts::ended);
    } else {
      count(&Counts::failed);
      log_warning("{}: '{}' failed", options_.name, command_);
    }
  }

  [[nodiscard]] bool must_end() const {
    const std::lock_guard lock(mutex_);
    return is_over();
  }

  // Waits until the input accepts more, or for the next check. Checks early, because most commands
  // are short.
  static void wait(const Child& child, Clock::duration running) {
    if (child.input >= 0) {
      pollfd input{child.input, POLLOUT, 0};
      ::poll(&input, 1, static_cast<int>(kGlance.count()));
      return;
    }
    std::this_thread::sleep_for(std::min<Clock::duration>(kGlance, milliseconds(1) + running / 8));
  }

  void kill(Child& child, bool in_time) {
    close_input(child);
    ::kill(-child.process, SIGKILL);
    const Clock::time_point end = Clock::now() + kDying;
    while (::waitpid(child.process, nullptr, WNOHANG) == 0 && Clock::now() < end)
      std::this_thread::sleep_for(milliseconds(1));
    count(&Counts::killed);
    if (in_time) {
      log_warning("{}: '{}' was ended with the program", options_.name, command_);
    } else {
      log_warning("{}: '{}' took longer than {:g} s and was ended", options_.name, command_,
                  options_.timeout_s);
    }
  }

  void count(std::int64_t Counts::*what) {
    const std::lock_guard lock(mutex_);
    ++(counts_.*what);
  }

  const std::string command_;
  const EventCommandOptions options_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::string> waiting_;
  Counts counts_;
  bool is_finishing_ = false;
  // when a command is killed, independent of its own timeout
  std::optional<Clock::time_point> end_;
  std::stop_token stop_;
  std::stop_callback<std::function<void()>> on_stop_;
  std::jthread thread_;  // last: ends before the other members
};

EventCommand::EventCommand(std::string command, const EventCommandOptions& options,
                           std::stop_token stop)
    : runner_(std::make_unique<Runner>(std::move(command), options, std::move(stop))) {}

EventCommand::~EventCommand() = default;

void EventCommand::post(std::string event) { runner_->post(std::move(event)); }

void EventCommand::finish() { runner_->finish(); }

EventCommand::Counts EventCommand::counts() const { return runner_->counts(); }

}  // namespace tarsier
