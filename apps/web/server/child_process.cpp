// SPDX-License-Identifier: MIT
#include "child_process.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/file_descriptor.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <condition_variable>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <future>
#include <mutex>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

// The environment of this process (POSIX; no header declares it without extensions).
extern char** environ;  // NOLINT(readability-redundant-declaration)

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

// How long output of the child's own children is still read after they were killed.
constexpr milliseconds kFinalOutputWait{200};
constexpr int kFirstFd = 3;
constexpr int kLastFd = 9;

// Splits a stream into lines, with bounded memory.
class LineReader {
 public:
  LineReader(std::size_t max_line, std::function<void(std::string_view)> on_line)
      : max_line_(max_line), on_line_(std::move(on_line)) {}

  void feed(std::string_view bytes) {
    while (!bytes.empty()) {
      const std::size_t end = bytes.find('\n');
      const std::string_view piece = bytes.substr(0, end);
      line_.append(piece.substr(0, max_line_ - std::min(max_line_, line_.size())));
      if (end == std::string_view::npos) {
        open_ = true;
        return;
      }
      flush();
      bytes.remove_prefix(end + 1);
    }
  }
  void finish() {
    if (open_) flush();
  }

 private:
  void flush() {
    if (!line_.empty() && line_.back() == '\r') line_.pop_back();
    if (on_line_) on_line_(line_);
    line_.clear();
    open_ = false;
  }

  const std::size_t max_line_;
  const std::function<void(std::string_view)> on_line_;
  std::string line_;
  bool open_ = false;
};

// Data for the forked child, prepared before fork: nothing may be allocated between fork and exec.
struct Plan {
  std::vector<char*> arguments;
  std::vector<char*> environment;
  const char* folder = nullptr;
  std::array<int, kLastFd + 1> fds{};  // by the child's descriptor number; -1: none
  rlim_t max_memory = RLIM_INFINITY;
  int niceness = 0;
  pid_t parent = 0;
  int report = -1;  // receives errno of a failed start
};

[[noreturn]] void become(const Plan& plan) {
  const auto fail = [&] {
    const int error = errno;
    (void)!::write(plan.report, &error, sizeof error);
    ::_exit(127);
  };
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != plan.parent) ::_exit(127);  // our process ended before that
  for (const int number :
       {SIGINT, SIGTERM, SIGPIPE, SIGHUP, SIGCHLD, SIGXFSZ, SIGUSR1, SIGUSR2, SIGQUIT})
    ::signal(number, SIG_DFL);
  if (plan.folder != nullptr && ::chdir(plan.folder) != 0) fail();
  if (plan.max_memory != RLIM_INFINITY) {
    const rlimit limit{plan.max_memory, plan.max_memory};
    if (::setrlimit(RLIMIT_AS, &limit) != 0) fail();
  }
  if (plan.niceness > 0) (void)!::nice(plan.niceness);
  // All our descriptors close at exec; dup2 clears this flag for those that the child gets.
  if (::close_range(kFirstFd, ~0U, CLOSE_RANGE_CLOEXEC) != 0) {
    const long max_fd = std::min(::sysconf(_SC_OPEN_MAX), 65536L);
    for (int fd = kFirstFd; fd < max_fd; ++fd) ::fcntl(fd, F_SETFD, FD_CLOEXEC);
  }
  for (int number = 0; number <= kLastFd; ++number) {
    const int fd = plan.fds[static_cast<std::size_t>(number)];
    if (fd >= 0 && ::dup2(fd, number) < 0) fail();
  }
  sigset_t none;
  sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  ::execve(plan.arguments[0], plan.arguments.data(), plan.environment.data());
  fail();
  ::_exit(127);
}

int open_pidfd(pid_t pid) {
#ifdef SYS_pidfd_open
  const int fd = static_cast<int>(::syscall(SYS_pidfd_open, pid, 0));
  if (fd >= 0) ::fcntl(fd, F_SETFD, FD_CLOEXEC);
  return fd;
#else
  (void)pid;
  return -1;
#endif
}

// A copy of `fd` with a number that the child's descriptors cannot overwrite.
int lifted(int fd) { return ::fcntl(fd, F_DUPFD_CLOEXEC, 64); }

}  // namespace

std::string ChildEnd::text() const {
  if (signal != 0) return fmt::format("died of signal {} ({})", signal, ::strsignal(signal));
  return fmt::format("ended with status {}", exit);
}

PipeEnds make_pipe() {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0)
    throw OutputError("pipe", fmt::format("cannot be made: {}", errno_text(errno)));
  return {ends[0], ends[1]};
}

struct ChildProcess::Impl {
  ChildOptions options;
  std::function<void(const ChildEnd&)> on_end;

  mutable std::mutex mutex;  // protects the following members
  std::condition_variable changed;
  pid_t child = -1;  // until it was reaped; set by the own thread alone
  std::optional<Clock::time_point> kill_at;
  std::optional<ChildEnd> end;  // after on_end

  FileDescriptor wake;
  std::promise<std::string> started;  // the reason of a failed start, or empty
  std::thread thread;

  void signal_group(int number) {
    const std::lock_guard lock(mutex);
    if (child > 0) ::kill(-child, number);
  }

  void wake_up() const {
    const std::uint64_t one = 1;
    (void)!::write(wake.get(), &one, sizeof one);
  }

  // The thread that forks must live as long as the child, because its end sends the death signal.
  void run() {
    FileDescriptor output;
    FileDescriptor messages;
    const std::string error = start(output, messages);
    const bool is_started = error.empty();
    started.set_value(error);
    if (is_started) follow(output, messages);
  }

  std::string start(FileDescriptor& output, FileDescriptor& messages) {
    std::array<int, 2> ends{};
    FileDescriptor output_end;
    FileDescriptor messages_end;
    FileDescriptor report;
    FileDescriptor report_end;
    const auto make = [&](FileDescriptor& ours, FileDescriptor& theirs) {
      if (::pipe2(ends.data(), O_CLOEXEC) != 0) return false;
      ours.reset(ends[0]);
      theirs.reset(lifted(ends[1]));
      ::close(ends[1]);
      return theirs.get() >= 0;
    };
    if (!make(output, output_end) || !make(messages, messages_end) || !make(report, report_end))
      return fmt::format("no pipe: {}", errno_text(errno));
    FileDescriptor nothing(::open("/dev/null", O_RDONLY | O_CLOEXEC));

    std::vector<std::string> variables;
    for (char** variable = environ; *variable != nullptr; ++variable) {
      const std::string_view text = *variable;
      const std::string_view name = text.substr(0, text.find('='));
      if (std::none_of(options.environment.begin(), options.environment.end(),
                       [&](const auto& item) { return item.first == name; }))
        variables.emplace_back(text);
    }
    for (const auto& [name, value] : options.environment) variables.push_back(name + "=" + value);
    Plan plan;
    for (std::string& word : options.arguments) plan.arguments.push_back(word.data());
    for (std::string& variable : variables) plan.environment.push_back(variable.data());
    plan.arguments.push_back(nullptr);
    plan.environment.push_back(nullptr);
    if (!options.folder.empty()) plan.folder = options.folder.c_str();
    if (options.max_memory_bytes > 0) plan.max_memory = options.max_memory_bytes;
    plan.niceness = options.niceness;
    plan.parent = ::getpid();
    plan.report = report_end.get();
    plan.fds.fill(-1);
    plan.fds[0] = nothing.get();
    plan.fds[1] = output_end.get();
    plan.fds[2] = messages_end.get();
    std::vector<std::unique_ptr<FileDescriptor>> copies;
    for (const ChildOptions::Pipe& pipe : options.pipes) {
      if (pipe.child_fd < kFirstFd || pipe.child_fd > kLastFd)
        return fmt::format("descriptor {} is none of {}..{}", pipe.child_fd, kFirstFd, kLastFd);
      copies.push_back(std::make_unique<FileDescriptor>(lifted(pipe.our_fd)));
      if (copies.back()->get() < 0) return fmt::format("no descriptor: {}", errno_text(errno));
      plan.fds[static_cast<std::size_t>(pipe.child_fd)] = copies.back()->get();
    }

    // No signal may run one of our handlers in the child.
    sigset_t all;
    sigset_t before;
    sigfillset(&all);
    ::pthread_sigmask(SIG_SETMASK, &all, &before);
    const pid_t process = ::fork();
    if (process == 0) become(plan);
    const int fork_error = errno;
    ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
    if (process < 0) return fmt::format("no process: {}", errno_text(fork_error));
    ::setpgid(process, process);  // in parent and child, whichever runs first
    report_end.reset();
    output_end.reset();
    messages_end.reset();
    int error = 0;
    ssize_t count = 0;
    do {
      count = ::read(report.get(), &error, sizeof error);
    } while (count < 0 && errno == EINTR);
    if (count == sizeof error) {
      while (::waitpid(process, nullptr, 0) < 0 && errno == EINTR) {
      }
      return errno_text(error);
    }
    const std::lock_guard lock(mutex);
    child = process;
    return {};
  }

  // Reads both streams until the process has ended and both are at their ends.
  void follow(FileDescriptor& output, FileDescriptor& messages) {
    const FileDescriptor ended(open_pidfd(child));
    LineReader lines(options.max_line, options.on_output);
    LineReader notes(options.max_line, options.on_message);
    ::fcntl(output.get(), F_SETFL, O_NONBLOCK);
    ::fcntl(messages.get(), F_SETFL, O_NONBLOCK);
    std::optional<ChildEnd> how;
    std::optional<Clock::time_point> read_until;
    while (true) {
      std::array<pollfd, 4> items{
          pollfd{output.get(), POLLIN, 0}, pollfd{messages.get(), POLLIN, 0},
          pollfd{how ? -1 : ended.get(), POLLIN, 0}, pollfd{wake.get(), POLLIN, 0}};
      ::poll(items.data(), items.size(), poll_timeout_ms(ended.get() >= 0 || how, read_until));
      if (items[0].revents != 0) drain(output, lines);
      if (items[1].revents != 0) drain(messages, notes);
      if (items[3].revents != 0) {
        std::uint64_t count = 0;
        (void)!::read(wake.get(), &count, sizeof count);
      }
      if (!how) {
        kill_when_due();
        how = collect();
        if (how) read_until = Clock::now() + kFinalOutputWait;
      }
      const bool is_silent = output.get() < 0 && messages.get() < 0;
      if (how && (is_silent || Clock::now() >= *read_until)) break;
    }
    lines.finish();
    notes.finish();
    if (on_end) on_end(*how);
    {
      const std::lock_guard lock(mutex);
      end = how;
    }
    changed.notify_all();
  }

  [[nodiscard]] int poll_timeout_ms(bool is_notified,
                                    std::optional<Clock::time_point> read_until) const {
    std::optional<Clock::time_point> until = read_until;
    {
      const std::lock_guard lock(mutex);
      if (!until) until = kill_at;
    }
    auto left = is_notified ? milliseconds(60'000) : milliseconds(20);
    if (until)
      left = std::min(
          left, std::max(milliseconds(0), std::chrono::ceil<milliseconds>(*until - Clock::now())));
    return static_cast<int>(left.count());
  }

  void kill_when_due() {
    const std::lock_guard lock(mutex);
    if (!kill_at || Clock::now() < *kill_at || child <= 0) return;
    ::kill(-child, SIGKILL);
    kill_at.reset();
  }

  // How the process ended, if it has. Its remaining process group is killed.
  std::optional<ChildEnd> collect() {
    const std::lock_guard lock(mutex);
    siginfo_t info{};
    // It stays a zombie until its group was killed, so that its process id is not reused meanwhile.
    if (::waitid(P_PID, static_cast<id_t>(child), &info, WEXITED | WNOHANG | WNOWAIT) != 0 ||
        info.si_pid == 0)
      return std::nullopt;
    ::kill(-child, SIGKILL);
    int status = 0;
    while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
    }
    child = -1;
    kill_at.reset();
    ChildEnd result;
    if (WIFSIGNALED(status)) {
      result.signal = WTERMSIG(status);
      result.exit = 128 + result.signal;
    } else {
      result.exit = WEXITSTATUS(status);
    }
    return result;
  }

  static void drain(FileDescriptor& fd, LineReader& lines) {
    std::array<char, 16384> buffer;
    // A limited amount per turn, so that a flood on one stream does not block the other.
    for (int i = 0; i < 16 && fd.get() >= 0; ++i) {
      const ssize_t count = ::read(fd.get(), buffer.data(), buffer.size());
      if (count < 0 && errno == EINTR) continue;
      if (count < 0 && errno == EAGAIN) return;
      if (count <= 0) {
        fd.reset();
        return;
      }
      lines.feed({buffer.data(), static_cast<std::size_t>(count)});
    }
  }
};

ChildProcess::ChildProcess(ChildOptions options, std::function<void(const ChildEnd&)> on_end)
    : impl_(std::make_unique<Impl>()) {
  if (options.arguments.empty()) throw InputError("", "no program to start");
  impl_->options = std::move(options);
  impl_->on_end = std::move(on_end);
  impl_->wake.reset(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
  auto started = impl_->started.get_future();
  impl_->thread = std::thread([impl = impl_.get()] { impl->run(); });
  const std::string error = started.get();
  if (error.empty()) return;
  impl_->thread.join();
  throw InputError(impl_->options.arguments[0], "cannot be started: " + error);
}

ChildProcess::~ChildProcess() {
  kill();
  if (impl_->thread.joinable()) impl_->thread.join();
}

void ChildProcess::interrupt(std::chrono::milliseconds kill_delay) {
  {
    const std::lock_guard lock(impl_->mutex);
    if (impl_->child <= 0) return;
    ::kill(-impl_->child, SIGINT);
    const Clock::time_point at = Clock::now() + kill_delay;
    impl_->kill_at = impl_->kill_at ? std::min(*impl_->kill_at, at) : at;
  }
  impl_->wake_up();
}

void ChildProcess::kill() { impl_->signal_group(SIGKILL); }

std::optional<ChildEnd> ChildProcess::wait(std::chrono::milliseconds timeout) {
  std::unique_lock lock(impl_->mutex);
  impl_->changed.wait_for(lock, timeout, [&] { return impl_->end.has_value(); });
  return impl_->end;
}

}  // namespace tarsier::web
