// SPDX-License-Identifier: MIT
#include "tarsier/media/child_capture.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/cameras.h"
#include "tarsier/media/capture_protocol.h"
#include "tarsier/media/file_descriptor.h"
#include "tarsier/media/http_protocol.h"
#include "tarsier/media/mjpeg_parser.h"
#include "tarsier/media/tcp.h"

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <fcntl.h>
#include <filesystem>
#include <mutex>
#include <poll.h>
#include <spawn.h>
#include <sys/wait.h>
#include <system_error>
#include <unistd.h>
#include <utility>

// The environment of this process (POSIX; no header declares it without extensions).
extern char** environ;  // NOLINT(readability-redundant-declaration)

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kPipeBytes = 1 << 20;
// For slow USB cameras, and RTSP streams that wait for a key frame.
constexpr double kCameraStartup_s = 10;

// Killed children that are still in an uninterruptible system call (a USB driver). They are reaped
// when that call returns.
class Unreaped {
 public:
  void add(pid_t child) {
    const std::lock_guard lock(mutex_);
    children_.push_back(child);
  }
  void collect() {
    const std::lock_guard lock(mutex_);
    std::erase_if(children_, [](pid_t child) {
      const pid_t result = ::waitpid(child, nullptr, WNOHANG);
      return result == child || (result < 0 && errno == ECHILD);
    });
  }

 private:
  std::mutex mutex_;
  std::vector<pid_t> children_;
};

Unreaped& unreaped() {
  static Unreaped instance;
  return instance;
}

class ChildBackend final : public LiveBackend {
 public:
  explicit ChildBackend(ChildCommand command)
      : command_(std::move(command)), detail_(command_.detail) {}
  ~ChildBackend() override { end_child(); }

  std::optional<LiveFailure> open(milliseconds timeout, const std::stop_token& stop) override;
  LiveRead read(milliseconds timeout, const std::stop_token& stop) override;
  bool reachable(milliseconds timeout, const std::stop_token& stop) override {
    return command_.reachable && command_.reachable(timeout, stop);
  }
  [[nodiscard]] std::string detail() const override { return detail_; }
  [[nodiscard]] double fps() const override { return records_.fps(); }
  [[nodiscard]] bool may_recover() const override { return command_.is_network; }
  [[nodiscard]] double startup_s() const override { return command_.startup_s; }

 private:
  std::optional<LiveFailure> spawn();
  bool drain_output(LiveRead& result);
  void drain_messages();
  LiveFailure exit_failure();
  int end_child();

  const ChildCommand command_;
  std::string detail_;
  pid_t child_ = -1;
  FileDescriptor output_;
  FileDescriptor messages_;
  std::string message_tail_;
  CaptureParser records_;
  MjpegParser jpegs_;
  std::vector<std::uint8_t> buffer_ = std::vector<std::uint8_t>(256U << 10U);
};

std::optional<LiveFailure> ChildBackend::open(milliseconds, const std::stop_token&) {
  unreaped().collect();
  if (command_.check) {
    if (auto failure = command_.check()) return failure;
  }
  return spawn();
}

std::optional<LiveFailure> ChildBackend::spawn() {
  int output[2];
  int messages[2];
  if (::pipe2(output, O_CLOEXEC) != 0) {
    return LiveFailure{.reason =
                           fmt::format("no pipe for the capture program: {}", errno_text(errno))};
  }
  output_.reset(output[0]);
  FileDescriptor output_end;
  output_end.reset(output[1]);
  if (::pipe2(messages, O_CLOEXEC) != 0) {
    return LiveFailure{.reason =
                           fmt::format("no pipe for the capture program: {}", errno_text(errno))};
  }
  messages_.reset(messages[0]);
  FileDescriptor messages_end;
  messages_end.reset(messages[1]);
  ::fcntl(output_.get(), F_SETPIPE_SZ, kPipeBytes);  // a smaller pipe works, too
  ::fcntl(output_.get(), F_SETFL, O_NONBLOCK);
  ::fcntl(messages_.get(), F_SETFL, O_NONBLOCK);

  std::vector<std::string> variables;
  for (char** variable = environ; *variable != nullptr; ++variable) {
    const std::string_view text = *variable;
    const std::string_view name = text.substr(0, text.find('='));
    const bool is_replaced = std::any_of(command_.environment.begin(), command_.environment.end(),
                                         [&](const auto& item) { return item.first == name; });
    if (!is_replaced) variables.emplace_back(text);
  }
  for (const auto& [name, value] : command_.environment) variables.push_back(name + "=" + value);
  std::vector<char*> environment;
  environment.reserve(variables.size());
  for (std::string& variable : variables) environment.push_back(variable.data());
  environment.push_back(nullptr);
  std::vector<std::string> words = command_.arguments;
  std::vector<char*> arguments;
  arguments.reserve(words.size());
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawnattr_init(&attributes);
  ::posix_spawn_file_actions_addopen(&actions, 0, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_adddup2(&actions, output_end.get(), 1);
  ::posix_spawn_file_actions_adddup2(&actions, messages_end.get(), 2);
  ::posix_spawn_file_actions_addclosefrom_np(&actions, 3);
  sigset_t none;
  sigset_t defaults;
  sigemptyset(&none);
  sigemptyset(&defaults);
  for (const int number : {SIGINT, SIGTERM, SIGPIPE, SIGHUP, SIGCHLD}) sigaddset(&defaults, number);
  ::posix_spawnattr_setsigmask(&attributes, &none);
  ::posix_spawnattr_setsigdefault(&attributes, &defaults);
  ::posix_spawnattr_setpgroup(&attributes, 0);
  ::posix_spawnattr_setflags(
      &attributes,
      static_cast<short>(POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP));
  pid_t child = -1;
  const int result = ::posix_spawn(&child, arguments[0], &actions, &attributes, arguments.data(),
                                   environment.data());
  ::posix_spawn_file_actions_destroy(&actions);
  ::posix_spawnattr_destroy(&attributes);
  if (result != 0) {
    return LiveFailure{
        .reason = fmt::format("cannot start {}: {}", command_.arguments[0], errno_text(result)),
        .permanent = true};
  }
  child_ = child;
  return std::nullopt;
}

// Reads for at most 50 ms. Returns false at the end of the stream.
bool ChildBackend::drain_output(LiveRead& result) {
  const Clock::time_point end = Clock::now() + milliseconds(50);
  bool is_open = true;
  while (Clock::now() < end) {
    const ssize_t count = ::read(output_.get(), buffer_.data(), buffer_.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0 && errno == EAGAIN) break;
    if (count <= 0) {
      is_open = false;
      break;
    }
    const std::span<const std::uint8_t> bytes(buffer_.data(), static_cast<std::size_t>(count));
    result.frames += command_.format == ChildCommand::Format::kRecords ? records_.feed(bytes)
                                                                       : jpegs_.feed(bytes);
    if (records_.is_broken()) return false;
  }
  const Clock::time_point now = Clock::now();
  if (jpegs_.has_frame()) {
    result.kind = LiveRead::Kind::kFrame;
    result.image.encoded = jpegs_.take();
    result.image.arrived = now;
  } else if (records_.has_frame()) {
    result.kind = LiveRead::Kind::kFrame;
    result.image.image = records_.take();
    // The child records when the driver delivered the frame; all processes share this clock.
    const Clock::time_point captured{std::chrono::nanoseconds(records_.time_ns())};
    const bool is_plausible = captured <= now && now - captured < std::chrono::seconds(60);
    result.image.arrived = is_plausible ? captured : now;
  }
  if (!records_.info().empty()) detail_ = records_.info();
  return is_open;
}

void ChildBackend::drain_messages() {
  char text[4096];
  while (true) {
    const ssize_t count = ::read(messages_.get(), text, sizeof text);
    if (count < 0 && errno == EINTR) continue;
    if (count == 0) messages_.reset();
    if (count <= 0) return;
    message_tail_.append(text, static_cast<std::size_t>(count));
    if (message_tail_.size() > sizeof text) message_tail_.erase(0, message_tail_.size() - 2048);
  }
}

LiveRead ChildBackend::read(milliseconds timeout, const std::stop_token& stop) {
  LiveRead result;
  if (stop.stop_requested()) return result;
  pollfd items[2] = {{output_.get(), POLLIN, 0}, {messages_.get(), POLLIN, 0}};
  const Clock::time_point deadline = Clock::now() + timeout;
  while (true) {
    const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now());
    const auto slice = std::clamp(left, milliseconds(0), milliseconds(50));
    const int ready = ::poll(items, 2, static_cast<int>(slice.count()));
    if (ready > 0 && items[1].revents != 0) {
      drain_messages();
      items[1].fd = messages_.get();  // -1 once it is closed; poll() ignores it
    }
    if (ready > 0 && items[0].revents != 0) {
      const bool is_open = drain_output(result);
      if (result.kind == LiveRead::Kind::kFrame) return result;
      if (!is_open) {
        result.kind = LiveRead::Kind::kEnded;
        result.failure = exit_failure();
        return result;
      }
    }
    if (stop.stop_requested() || Clock::now() >= deadline) return result;
  }
}

LiveFailure ChildBackend::exit_failure() {
  LiveFailure failure;
  if (messages_.get() >= 0) drain_messages();
  const bool is_broken = records_.is_broken();
  const int status = end_child();
  if (!records_.error().empty()) {
    failure.reason = records_.error();
    failure.permanent = true;
  } else if (is_broken) {
    failure.reason = fmt::format("{} sends something that is not an image", command_.arguments[0]);
    failure.permanent = true;
  } else {
    std::string_view tail = message_tail_;
    while (!tail.empty() && (tail.back() == '\n' || tail.back() == '\r')) tail.remove_suffix(1);
    const std::size_t line = tail.find_last_of("\r\n");
    if (line != std::string_view::npos) tail.remove_prefix(line + 1);
    const std::string program = std::filesystem::path(command_.arguments[0]).filename().string();
    failure.reason = WIFSIGNALED(status)
                         ? fmt::format("{} died of signal {}", program, WTERMSIG(status))
                         : fmt::format("{} ended with status {}", program, WEXITSTATUS(status));
    if (!tail.empty()) failure.reason += fmt::format(": {}", tail.substr(0, 300));
    failure.permanent = WIFEXITED(status) && WEXITSTATUS(status) != 0;
  }
  // If the device does not exist at all, waiting means probing for it.
  failure.unreachable = command_.reachable && !command_.reachable(milliseconds(100), {});
  return failure;
}

// Kills the child and its process group; returns the wait status, 0 if unknown.
int ChildBackend::end_child() {
  output_.reset();
  messages_.reset();
  if (child_ < 0) return 0;
  const pid_t child = std::exchange(child_, -1);
  int status = 0;
  // A child that ended by itself keeps its own status.
  if (::waitpid(child, &status, WNOHANG) == child) {
    ::kill(-child, SIGKILL);
    return status;
  }
  ::kill(-child, SIGKILL);
  const Clock::time_point deadline = Clock::now() + milliseconds(150);
  while (Clock::now() < deadline) {
    const pid_t result = ::waitpid(child, &status, WNOHANG);
    if (result == child) return status;
    if (result < 0 && errno != EINTR) return 0;
    ::poll(nullptr, 0, 2);
  }
  unreaped().add(child);
  return 0;
}

bool can_open(const std::string& path) {
  const int descriptor = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  if (descriptor < 0) return false;
  ::close(descriptor);
  return true;
}

bool can_run(const std::string& path) { return ::access(path.c_str(), X_OK) == 0; }

std::string number(double value) { return fmt::format("{}", value); }

}  // namespace

std::unique_ptr<LiveBackend> make_child_backend(ChildCommand command) {
  return std::make_unique<ChildBackend>(std::move(command));
}

std::string find_capture_program(const SourceOptions& options) {
  if (!options.capture_program.empty()) {
    if (can_run(options.capture_program)) return options.capture_program;
    throw InputError(options.capture_program, "no such program (it captures from cameras)");
  }
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  const auto folder = self.parent_path();
  std::string candidate = (folder / "tarsier-capture").string();
  if (can_run(candidate)) return candidate;
  std::string installed = (folder.parent_path() / "libexec/tarsier/tarsier-capture").string();
  if (can_run(installed)) return installed;
  throw InputError(candidate,
                   "no such program; it captures from cameras and belongs beside tarsier (or in "
                   "../libexec/tarsier)");
}

ChildCommand camera_command(const std::string& path, const std::string& label,
                            const SourceOptions& options) {
  ChildCommand command;
  command.arguments = {find_capture_program(options),
                       "v4l2",
                       path,
                       fmt::format("{}", options.width),
                       fmt::format("{}", options.height),
                       number(options.fps)};
  command.detail = label;
  command.startup_s = kCameraStartup_s;
  command.check = [path]() -> std::optional<LiveFailure> {
    std::string error = camera_error(path);
    if (error.empty()) return std::nullopt;
    return LiveFailure{.reason = std::move(error), .permanent = true, .unreachable = true};
  };
  command.reachable = [path](milliseconds, const std::stop_token&) { return can_open(path); };
  return command;
}

ChildCommand ffmpeg_command(const std::string& url, const SourceOptions& options) {
  const std::size_t colon = std::min(url.find(':'), url.size());
  std::string scheme = url.substr(0, colon);
  for (char& c : scheme) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c + ('a' - 'A') : c);
  const auto port = static_cast<std::uint16_t>(scheme == "rtsp"    ? 554
                                               : scheme == "rtsps" ? 322
                                               : scheme == "https" ? 443
                                                                   : 80);
  if (scheme != "rtsp" && scheme != "rtsps" && scheme != "https" && scheme != "http") {
    throw InputError(masked(url), "not an rtsp://, rtsps:// or https:// address");
  }
  const HttpUrl parts = parse_url(url, scheme, port);
  ChildCommand command;
  // Separate arguments, not a line for a shell. Not in the environment, where an older value could
  // replace a missing one.
  command.arguments = {find_capture_program(options), "ffmpeg",
                       options.security.insecure ? "insecure" : "verify", options.security.ca_file};
  // In the environment, which other users cannot read: the address may contain a password.
  command.environment = {{"TARSIER_CAPTURE_URL", url}};
  command.detail = scheme + " stream";
  command.is_network = true;
  command.startup_s = kCameraStartup_s;
  command.reachable = [parts](milliseconds timeout, const std::stop_token& stop) {
    LiveFailure failure;
    return connect_tcp(parts.host, parts.port, timeout, stop, failure).is_open();
  };
  return command;
}

ChildCommand pi_camera_command(int index, const SourceOptions& options) {
  std::string program = find_program_on_path("rpicam-vid");
  if (program.empty()) program = find_program_on_path("libcamera-vid");
  if (program.empty()) {
    throw InputError("picam:",
                     "neither rpicam-vid nor libcamera-vid is installed; use Raspberry Pi OS and "
                     "`sudo apt install rpicam-apps`");
  }
  const int width = options.width > 0 ? options.width : 1280;
  const int height = options.height > 0 ? options.height : 720;
  const double fps = options.fps > 0 ? options.fps : 30;
  ChildCommand command;
  command.arguments = {find_capture_program(options),
                       "exec",
                       program,
                       "--timeout",
                       "0",
                       "--nopreview",
                       "--verbose",
                       "0",
                       "--codec",
                       "mjpeg",
                       "--quality",
                       "90",
                       "--camera",
                       fmt::format("{}", index),
                       "--width",
                       fmt::format("{}", width),
                       "--height",
                       fmt::format("{}", height),
                       "--framerate",
                       number(fps),
                       "--flush",
                       "--output",
                       "-"};
  command.format = ChildCommand::Format::kMjpeg;
  command.detail = fmt::format("{}x{} MJPEG, {} fps asked for, from {}", width, height, fps,
                               std::filesystem::path(program).filename().string());
  command.startup_s = kCameraStartup_s;
  return command;
}

}  // namespace tarsier
