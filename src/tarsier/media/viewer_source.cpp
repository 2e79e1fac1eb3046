// SPDX-License-Identifier: MIT
#include "tarsier/media/viewer_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_probe.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <fcntl.h>
#include <optional>
#include <poll.h>
#include <string_view>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr const char* kVariable = "TARSIER_VIEWER";
constexpr std::size_t kLongestName = 64;
constexpr double kPermissionTime_s = 10;  // a person must allow it

class ViewerBackend final : public LiveBackend {
 public:
  ViewerBackend(int fd, std::string label) : fd_(fd), label_(std::move(label)) {
    ::fcntl(fd_, F_SETFD, FD_CLOEXEC);
    ::fcntl(fd_, F_SETFL, O_NONBLOCK);
  }
  ~ViewerBackend() override { ::close(fd_); }
  ViewerBackend(const ViewerBackend&) = delete;
  ViewerBackend& operator=(const ViewerBackend&) = delete;

  std::optional<LiveFailure> open(milliseconds, const std::stop_token&) override { return {}; }
  LiveRead read(milliseconds timeout, const std::stop_token& stop) override;
  bool reachable(milliseconds, const std::stop_token&) override { return false; }
  [[nodiscard]] std::string detail() const override { return "a viewer's camera"; }
  [[nodiscard]] double fps() const override { return 0; }
  [[nodiscard]] bool may_recover() const override { return true; }
  [[nodiscard]] double startup_s() const override { return kPermissionTime_s; }
  [[nodiscard]] bool opens_once() const override { return true; }

 private:
  bool drain(LiveRead& result);
  void warn(const std::string& error);

  const int fd_;
  const std::string label_;
  ViewerParser records_;
  std::vector<std::uint8_t> buffer_ = std::vector<std::uint8_t>(64U << 10U);
  std::optional<Clock::time_point> warned_;
  std::int64_t not_warned_of_ = 0;
};

// Reads for at most 50 ms. Returns false at the end of the records.
bool ViewerBackend::drain(LiveRead& result) {
  const Clock::time_point end = Clock::now() + milliseconds(50);
  while (Clock::now() < end && !records_.is_broken()) {
    const ssize_t count = ::read(fd_, buffer_.data(), buffer_.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return true;
    if (count <= 0) return false;
    result.frames += records_.feed({buffer_.data(), static_cast<std::size_t>(count)});
  }
  return !records_.is_broken();
}

void ViewerBackend::warn(const std::string& error) {
  const Clock::time_point now = Clock::now();
  if (warned_ && now - *warned_ < kWarningInterval) {
    ++not_warned_of_;
    return;
  }
  log_warning("{}: an image is skipped: {}{}", label_, error,
              not_warned_of_ > 0 ? fmt::format(" ({} more before)", not_warned_of_) : "");
  warned_ = now;
  not_warned_of_ = 0;
}

LiveRead ViewerBackend::read(milliseconds timeout, const std::stop_token& stop) {
  LiveRead result;
  const Clock::time_point deadline = Clock::now() + timeout;
  while (!stop.stop_requested()) {
    const auto left = std::chrono::ceil<milliseconds>(deadline - Clock::now());
    const auto slice = std::clamp(left, milliseconds(0), milliseconds(50));
    pollfd item{fd_, POLLIN, 0};
    if (records_.is_broken() || ::poll(&item, 1, static_cast<int>(slice.count())) > 0) {
      const bool is_open = drain(result);
      if (records_.has_image()) {
        const std::vector<std::uint8_t> bytes = records_.take();
        const std::string error = viewer_image_error(bytes);
        if (error.empty()) {
          result.kind = LiveRead::Kind::kFrame;
          result.image.encoded = bytes;
          result.image.arrived = Clock::now();
          return result;
        }
        warn(error);
        result.frames = 0;
      }
      if (!is_open) {
        result.kind = LiveRead::Kind::kEnded;
        result.failure = {.reason = records_.is_broken()
                                        ? "a record's length is 0 or beyond 16 MB: the rest of "
                                          "what comes cannot be read"
                                        : "the viewer's camera has ended",
                          .permanent = true};
        return result;
      }
    }
    if (Clock::now() >= deadline) break;
  }
  return result;
}

void check_name(const std::string& input, std::string_view name) {
  const bool is_plain = std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' ||
           c == '-';
  });
  if (name.empty() || name.size() > kLongestName || !is_plain)
    throw InputError(input, "expected viewer:NAME, of letters, digits, '_' and '-'");
}

// The descriptor that the environment names; each process has one.
int inherited_descriptor(const std::string& input) {
  const char* text = std::getenv(kVariable);
  if (text == nullptr || *text == '\0') {
    throw InputError(input, fmt::format("{} is not set: `tarsier serve` does so for the camera of "
                                        "someone who looks at its page",
                                        kVariable));
  }
  const auto fd = to_integer(text, 3, 65535);
  if (!fd || ::fcntl(static_cast<int>(*fd), F_GETFD) < 0)
    throw InputError(input, fmt::format("{}={}: no open file descriptor", kVariable, text));
  static std::atomic<bool> is_taken{false};
  if (is_taken.exchange(true))
    throw InputError(input, fmt::format("is open already; {} is one camera", kVariable));
  return static_cast<int>(*fd);
}

}  // namespace

std::int64_t ViewerParser::feed(std::span<const std::uint8_t> bytes) {
  std::int64_t completed = 0;
  while (!bytes.empty() && !broken_) {
    if (length_size_ < length_bytes_.size()) {
      length_bytes_[length_size_++] = bytes.front();
      bytes = bytes.subspan(1);
      if (length_size_ < length_bytes_.size()) continue;
      length_ = 0;
      for (const std::uint8_t byte : length_bytes_) length_ = length_ << 8U | byte;
      broken_ = length_ == 0 || length_ > kMaxBytes;
      continue;
    }
    const std::size_t part = std::min(bytes.size(), length_ - partial_.size());
    partial_.insert(partial_.end(), bytes.begin(),
                    bytes.begin() + static_cast<std::ptrdiff_t>(part));
    bytes = bytes.subspan(part);
    if (partial_.size() < length_) continue;
    newest_ = std::move(partial_);
    partial_ = {};
    length_size_ = 0;
    ++completed;
  }
  if (broken_) partial_ = {};
  return completed;
}

std::vector<std::uint8_t> ViewerParser::take() { return std::exchange(newest_, {}); }

std::string viewer_image_error(std::span<const std::uint8_t> bytes) {
  const std::optional<ImageFormat> format = image_format_of(bytes);
  if (!format) return describe_not_an_image(bytes);
  if (*format != ImageFormat::kJpeg) return fmt::format("is {}, not JPEG", name_of(*format));
  const std::optional<ImageHeader> header = probe_image(bytes);
  if (!header) return "broken JPEG: no size in it";
  const ImageLimits limits;
  if (std::int64_t{header->width} * header->height > limits.max_pixels)
    return fmt::format("{}x{} pixels are too many", header->width, header->height);
  std::vector<std::uint8_t> needed_chunks;
  return find_image_damage(bytes, *header, needed_chunks);
}

std::unique_ptr<LiveBackend> make_viewer_backend(int fd, const std::string& label) {
  return std::make_unique<ViewerBackend>(fd, label);
}

Scheme viewer_scheme() {
  return {"viewer", [](std::string_view name, const SourceOptions& options) {
            const std::string input = "viewer:" + std::string(name);
            check_name(input, name);
            options.check();
            const int fd = inherited_descriptor(input);
            return make_live_source(
                input, input, [fd, input] { return make_viewer_backend(fd, input); }, options);
          }};
}

}  // namespace tarsier
