// SPDX-License-Identifier: MIT
#include "run_command.h"

#include "tarsier/core/log.h"

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

extern char** environ;

namespace tarsier::cli {
namespace {

constexpr std::chrono::seconds kPatience{10};

pid_t start(const std::string& command, int input) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
  // Our own threads block the signals that end programs; the command must not. A group of its own
  // can be ended with all that it started.
  sigset_t none;
  sigemptyset(&none);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETPGROUP);
  std::string shell = "/bin/sh";
  std::string flag = "-c";
  std::string text = command;
  char* arguments[] = {shell.data(), flag.data(), text.data(), nullptr};
  pid_t child = -1;
  const int error = ::posix_spawn(&child, shell.c_str(), &actions, &attributes, arguments, environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  return error == 0 ? child : -1;
}

}  // namespace

void run_command(const std::string& command, std::string_view input) {
  // A file that has no name: the command may read as slowly as it likes, or not at all.
  char name[] = "/tmp/tarsier-event-XXXXXX";
  const int file = ::mkostemp(name, O_CLOEXEC);
  if (file < 0) {
    log_warning("--on-event: no temporary file");
    return;
  }
  ::unlink(name);
  const std::string line = std::string(input) + "\n";
  const bool written =
      ::write(file, line.data(), line.size()) == static_cast<ssize_t>(line.size()) &&
      ::lseek(file, 0, SEEK_SET) == 0;
  const pid_t child = written ? start(command, file) : -1;
  ::close(file);
  if (child < 0) {
    log_warning("--on-event: '{}' could not be started", command);
    return;
  }
  const auto end = std::chrono::steady_clock::now() + kPatience;
  int status = 0;
  while (::waitpid(child, &status, WNOHANG) == 0) {
    if (std::chrono::steady_clock::now() > end) {
      log_warning("--on-event: '{}' took longer than 10 s and was ended", command);
      ::kill(-child, SIGKILL);
      ::waitpid(child, &status, 0);
      return;
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  if (!WIFEXITED(status) || WEXITSTATUS(status) != 0)
    log_warning("--on-event: '{}' failed", command);
}

}  // namespace tarsier::cli
