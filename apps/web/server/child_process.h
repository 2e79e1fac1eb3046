// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::web {

struct ChildOptions {
  std::vector<std::string> arguments;  // the first is the program's path; no shell is used
  // Variables that are added to ours or replace them.
  std::vector<std::pair<std::string, std::string>> environment;
  std::string folder;  // its working directory; empty: ours
  struct Pipe {
    int child_fd = 3;  // descriptor number in the child, 3..9
    int our_fd = -1;   // owned by the caller, who closes it after start()
  };
  std::vector<Pipe> pipes;
  std::uint64_t max_memory_bytes = 0;  // limit of its address space (RLIMIT_AS); 0: none
  int niceness = 0;                    // 0..19
  std::size_t max_line = 1 << 20;      // bytes; longer lines are truncated
  // Both run in the child's own thread, one call at a time, and must not destroy the ChildProcess.
  std::function<void(std::string_view line)> on_output;   // stdout, without the line end
  std::function<void(std::string_view line)> on_message;  // stderr
};

// How a child ended.
struct ChildEnd {
  int exit = 0;                            // exit status, or 128 + signal
  int signal = 0;                          // the signal that killed it, or 0
  [[nodiscard]] std::string text() const;  // "ended with status 3", "died of signal 9 (Killed)"
};

// A child process in its own process group. stdin is /dev/null, stdout and stderr are read line by
// line, and no other descriptor of ours is open in it. It gets SIGTERM when our process ends, for
// any reason.
class ChildProcess {
 public:
  // Starts the child. Throws InputError(path, ..) on failure. `on_end` is called once, in the
  // child's own thread, after the last line of both streams.
  ChildProcess(ChildOptions options, std::function<void(const ChildEnd&)> on_end);
  // Kills the child and its process group if it still runs; returns after on_end.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  // Sends SIGINT to its group, and SIGKILL if it has not ended after `kill_delay`. Returns at once.
  void interrupt(std::chrono::milliseconds kill_delay);
  void kill();  // sends SIGKILL to its group; returns at once
  // Waits until on_end has returned; nullopt if that takes longer than `timeout`.
  std::optional<ChildEnd> wait(std::chrono::milliseconds timeout);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Creates a pipe; both ends are closed on exec. Throws OutputError.
struct PipeEnds {
  int read_end = -1;
  int write_end = -1;
};
[[nodiscard]] PipeEnds make_pipe();

}  // namespace tarsier::web
