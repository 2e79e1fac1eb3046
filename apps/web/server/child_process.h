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
  std::vector<std::string> arguments;  // the first is the program's path; no shell is involved
  std::vector<std::pair<std::string, std::string>> environment;  // added to ours, or replaced
  std::string folder;  // where it starts; empty: where we are
  struct Pipe {
    int child_fd = 3;  // its number there, 3..9
    int our_fd = -1;   // stays the caller's, who closes it after start()
  };
  std::vector<Pipe> pipes;
  std::uint64_t max_memory_bytes = 0;  // of its address space (RLIMIT_AS); 0: none
  int niceness = 0;                    // 0..19
  std::size_t max_line = 1 << 20;  // bytes; what is longer is cut, the rest of that line dropped
  // Both run in the child's own thread, one call at a time, and must not destroy the ChildProcess.
  std::function<void(std::string_view line)> on_output;   // stdout, without the line end
  std::function<void(std::string_view line)> on_message;  // stderr
};

// How a child ended.
struct ChildEnd {
  int exit = 0;                            // its exit status, or 128 + signal
  int signal = 0;                          // that killed it, or 0
  [[nodiscard]] std::string text() const;  // "ended with status 3", "died of signal 9 (Killed)"
};

// A program that runs beside us, in a process group of its own: stdin is /dev/null, stdout and
// stderr are read line by line, no other descriptor of ours is open in it. It is asked to end
// (SIGTERM) when our process dies, however that happens.
class ChildProcess {
 public:
  // Starts it. Throws InputError(path, ..) where that fails. `on_end` is called once, in the
  // child's own thread, after the last line of both streams.
  ChildProcess(ChildOptions options, std::function<void(const ChildEnd&)> on_end);
  // Kills it and all of its group where it still runs; returns after on_end.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  [[nodiscard]] int pid() const;  // for the log; it may be over
  // SIGINT to its group now, SIGKILL after `patience` if it has not ended by then. Returns at once.
  void interrupt(std::chrono::milliseconds patience);
  void kill();  // SIGKILL to its group; returns at once
  [[nodiscard]] bool is_running() const;
  // Waits until on_end has returned; nothing if that is later than `patience`.
  std::optional<ChildEnd> wait(std::chrono::milliseconds patience);
  // Of the process itself since its start: seconds of CPU, bytes of resident memory (0 once over).
  struct Use {
    double cpu_seconds = 0;
    std::uint64_t resident_bytes = 0;
  };
  [[nodiscard]] Use use() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// A pipe whose both ends are closed on exec. Throws OutputError.
struct PipeEnds {
  int read_end = -1;
  int write_end = -1;
};
[[nodiscard]] PipeEnds make_pipe();

}  // namespace tarsier::web
