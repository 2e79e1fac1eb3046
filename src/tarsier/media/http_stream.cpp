// SPDX-License-Identifier: MIT
#include "tarsier/media/http_stream.h"

#include "tarsier/core/base64.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/words.h"
#include "tarsier/media/child_capture.h"
#include "tarsier/media/http_protocol.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/mjpeg_parser.h"
#include "tarsier/media/tcp.h"
#include "tarsier/media/tls.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <memory>
#include <optional>
#include <poll.h>
#include <sys/socket.h>
#include <utility>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kMaxRedirects = 3;
// An http or https address.
struct Endpoint {
  HttpUrl url;
  bool tls = false;
  [[nodiscard]] bool is_same_server(const Endpoint& other) const {
    return url.host == other.url.host && url.port == other.url.port && tls == other.tls;
  }
};

Endpoint parse_endpoint(const std::string& text) {
  if (lower_case(text.substr(0, 8)) == "https://") return {parse_url(text, "https", 443), true};
  return {parse_url(text, "http", 80), false};
}

// Types that FFmpeg reads and this program does not.
bool is_playlist_type(std::string_view type) {
  static constexpr std::array<std::string_view, 5> kTypes = {
      "application/vnd.apple.mpegurl", "application/x-mpegurl", "audio/mpegurl", "audio/x-mpegurl",
      "application/dash+xml"};
  return std::any_of(kTypes.begin(), kTypes.end(),
                     [&](std::string_view known) { return type.starts_with(known); });
}
bool is_video_type(std::string_view type) {
  if (type.starts_with("video/x-motion-jpeg") || type.starts_with("video/x-jpeg")) return false;
  return type.starts_with("video/") || type.starts_with("application/mp4") ||
         type.starts_with("application/ogg");
}

class HttpBackend final : public LiveBackend {
 public:
  HttpBackend(const std::string& url, const SourceOptions& options)
      : text_(url),
        endpoint_(parse_endpoint(url)),
        original_endpoint_(endpoint_),
        security_(options.security),
        snapshot_period_(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
            1 / std::min(options.fps > 0 ? options.fps : 10.0, 60.0)))) {
    if (endpoint_.tls) trust_ = std::make_shared<const TlsTrust>(security_);
  }

  // After read() ended: whether the stream is another kind of video, and its address.
  [[nodiscard]] bool is_for_ffmpeg() const { return for_ffmpeg_; }
  [[nodiscard]] std::string address() const;

  std::optional<LiveFailure> open(milliseconds timeout, const std::stop_token& stop) override {
    timeout_ = timeout;
    if (!socket_.is_open()) {
      LiveFailure failure;
      socket_ = connect_tcp(endpoint_.url.host, endpoint_.url.port, timeout, stop, failure);
      if (!socket_.is_open()) return failure;
    }
    start_request();
    return std::nullopt;
  }

  // The connection is kept: a server that accepts only one client must not lose it to a probe.
  bool reachable(milliseconds timeout, const std::stop_token& stop) override {
    LiveFailure failure;
    if (!socket_.is_open()) {
      socket_ = connect_tcp(endpoint_.url.host, endpoint_.url.port, timeout, stop, failure);
    }
    return socket_.is_open();
  }

  LiveRead read(milliseconds timeout, const std::stop_token& stop) override;

  [[nodiscard]] std::string detail() const override { return detail_; }
  [[nodiscard]] double fps() const override { return 0; }
  [[nodiscard]] bool may_recover() const override { return true; }
  [[nodiscard]] double startup_s() const override { return 0; }

 private:
  void start_request();
  bool send_request();
  bool receive(bool& closed);
  ssize_t receive_some();
  [[nodiscard]] std::string kind() const {
    return fmt::format("{} over {}", is_snapshot_ ? "JPEG snapshots" : "MJPEG",
                       endpoint_.tls ? "HTTPS" : "HTTP");
  }
  std::optional<LiveFailure> check_header(const std::stop_token& stop);
  std::optional<LiveFailure> follow(const std::string& location, const std::stop_token& stop);

  const std::string text_;
  Endpoint endpoint_;                 // the current address, after redirects
  const Endpoint original_endpoint_;  // only this server gets the password
  const StreamSecurity security_;
  const Clock::duration snapshot_period_;
  milliseconds timeout_{3000};
  TcpSocket socket_;
  std::shared_ptr<const TlsTrust> trust_;
  std::optional<TlsStream> tls_;  // of socket_
  std::string request_;           // the unsent part
  HttpResponseParser response_;
  bool header_checked_ = false;
  bool is_snapshot_ = false;
  bool for_ffmpeg_ = false;
  Clock::time_point next_snapshot_;
  int redirects_ = 0;
  std::int64_t response_frames_ = 0;  // frames since the last request
  std::vector<std::uint8_t> buffer_ = std::vector<std::uint8_t>(256U << 10U);
  std::vector<std::uint8_t> body_;
  MjpegParser parser_;
  std::string detail_ = "HTTP";
};

// The final address; name and password are included only for the server they were given for.
std::string HttpBackend::address() const {
  if (redirects_ == 0) return text_;
  const std::size_t begin = text_.find("://") + 3;
  const std::size_t end = std::min(text_.find_first_of("/?#", begin), text_.size());
  const std::size_t at = text_.substr(0, end).rfind('@');
  std::string credentials;
  if (endpoint_.is_same_server(original_endpoint_) && at != std::string::npos && at > begin) {
    credentials = text_.substr(begin, at + 1 - begin);
  }
  return fmt::format("{}://{}{}{}", endpoint_.tls ? "https" : "http", credentials,
                     endpoint_.url.host_header(endpoint_.tls ? 443 : 80), endpoint_.url.target);
}

// Sends the request over the new connection.
void HttpBackend::start_request() {
  tls_.reset();
  if (endpoint_.tls) tls_.emplace(trust_, socket_.get(), endpoint_.url.host);
  request_ = fmt::format(
      "GET {} HTTP/1.1\r\nHost: {}\r\nUser-Agent: tarsier\r\n"
      "Accept: multipart/x-mixed-replace, image/jpeg, */*\r\nConnection: close\r\n",
      endpoint_.url.target, endpoint_.url.host_header(endpoint_.tls ? 443 : 80));
  const HttpUrl& credentials = original_endpoint_.url;
  if (endpoint_.is_same_server(original_endpoint_) &&
      !(credentials.user.empty() && credentials.password.empty())) {
    request_ +=
        "Authorization: Basic " + to_base64(credentials.user + ":" + credentials.password) + "\r\n";
  }
  request_ += "\r\n";
  response_ = {};
  header_checked_ = false;
  response_frames_ = 0;
  parser_.reset();
}

// Returns false if the connection is broken.
bool HttpBackend::send_request() {
  while (!request_.empty()) {
    const ssize_t sent =
        tls_ ? tls_->send({reinterpret_cast<const std::uint8_t*>(request_.data()), request_.size()})
             : ::send(socket_.get(), request_.data(), request_.size(), MSG_NOSIGNAL);
    if (sent < 0) return errno == EAGAIN || errno == EINTR;
    request_.erase(0, static_cast<std::size_t>(sent));
  }
  return true;
}

ssize_t HttpBackend::receive_some() {
  return tls_ ? tls_->recv(buffer_) : ::recv(socket_.get(), buffer_.data(), buffer_.size(), 0);
}

// Reads everything that has arrived, for at most 50 ms, because a server that sends without pause
// must not block the display. Returns false if the connection is broken.
bool HttpBackend::receive(bool& closed) {
  const Clock::time_point end = Clock::now() + kStopCheckInterval;
  while (Clock::now() < end) {
    const ssize_t count = receive_some();
    if (count < 0) {
      if (errno == EINTR) continue;
      return errno == EAGAIN;
    }
    if (count == 0) {
      closed = true;
      return true;
    }
    body_.clear();
    response_.feed({buffer_.data(), static_cast<std::size_t>(count)}, body_);
    if (response_.state() == HttpResponseParser::State::kBroken) return true;
    if (response_.state() != HttpResponseParser::State::kHeader && response_.status() == 200) {
      response_frames_ += parser_.feed(body_);
    }
    if (response_.state() == HttpResponseParser::State::kDone) return true;
  }
  return true;
}

std::optional<LiveFailure> HttpBackend::check_header(const std::stop_token& stop) {
  header_checked_ = true;
  const int status = response_.status();
  if (status >= 300 && status < 400 && !response_.location().empty()) {
    return follow(response_.location(), stop);
  }
  if (status != 200) {
    LiveFailure failure;
    failure.reason = fmt::format("the server answers {} {}", status, response_.status_text());
    failure.permanent = status >= 400 && status < 500 && status != 408 && status != 429;
    failure.denied = status == 401 || status == 403;
    if (status == 401) {
      failure.reason += original_endpoint_.url.user.empty()
                            ? "; give a name and password: name:password@ before the host"
                            : "; name or password are wrong";
    }
    return failure;
  }
  const std::string type = lower_case(response_.content_type());
  if (type.starts_with("text/") || type.starts_with("application/json")) {
    return LiveFailure{
        .reason = fmt::format("the server sends {}, not images; is this the address of the "
                              "stream itself?",
                              response_.content_type()),
        .permanent = true};
  }
  if (endpoint_.tls && is_playlist_type(type) && !security_.insecure) {
    return LiveFailure{
        .reason =
            "the server sends a playlist (HLS or DASH), and certificates of what it points "
            "to cannot be checked: do without (option 'insecure'), or use the camera's rtsps or "
            "MJPEG",
        .permanent = true};
  }
  if (endpoint_.tls && (is_playlist_type(type) || is_video_type(type))) {
    for_ffmpeg_ = true;
    return LiveFailure{.reason = "is another kind of video"};
  }
  is_snapshot_ = type.starts_with("image/");
  detail_ = kind();
  return std::nullopt;
}

// Follows one redirect, from https only to https.
std::optional<LiveFailure> HttpBackend::follow(const std::string& location,
                                               const std::stop_token& stop) {
  if (++redirects_ > kMaxRedirects) {
    return LiveFailure{.reason = "redirects too often", .permanent = true};
  }
  Endpoint next = endpoint_;
  bool allowed = true;
  try {
    if (location.starts_with("/") && !location.starts_with("//")) {
      next.url.target = parse_url("http://host" + location, "http", 80).target;
    } else {
      next = parse_endpoint(location);
    }
    allowed = next.tls || !endpoint_.tls;
  } catch (const InputError&) {
    allowed = false;
  }
  if (!allowed) {
    return LiveFailure{.reason = fmt::format("redirects to '{}'; only {} is followed",
                                             masked(location), endpoint_.tls ? "https" : "http(s)"),
                       .permanent = true};
  }
  endpoint_ = std::move(next);
  if (endpoint_.tls && trust_ == nullptr) {
    try {
      trust_ = std::make_shared<const TlsTrust>(security_);
    } catch (const InputError& error) {
      return LiveFailure{.reason = error.what(), .permanent = true};
    }
  }
  LiveFailure failure;
  tls_.reset();
  socket_ = connect_tcp(endpoint_.url.host, endpoint_.url.port, timeout_, stop, failure);
  if (!socket_.is_open()) return failure;
  start_request();
  return std::nullopt;
}

LiveRead HttpBackend::read(milliseconds timeout, const std::stop_token& stop) {
  using State = HttpResponseParser::State;
  LiveRead result;
  const auto end_with = [&result](LiveFailure failure) {
    result.kind = LiveRead::Kind::kEnded;
    result.failure = std::move(failure);
    return result;
  };
  const Clock::time_point deadline = Clock::now() + timeout;
  do {
    if (!socket_.is_open()) {  // between two snapshots
      const Clock::time_point now = Clock::now();
      if (now < next_snapshot_) {
        const auto pause =
            std::min<Clock::duration>({kStopCheckInterval, next_snapshot_ - now,
                                       std::max(Clock::duration(0), deadline - now)});
        sleep_unless_stopped(std::chrono::ceil<milliseconds>(pause), stop);
        continue;
      }
      next_snapshot_ = now + snapshot_period_;
      LiveFailure failure;
      socket_ = connect_tcp(endpoint_.url.host, endpoint_.url.port, timeout_, stop, failure);
      if (!socket_.is_open()) return end_with(std::move(failure));
      start_request();
    }
    if (tls_ && !tls_->is_ready()) {
      const TlsStream::Step step = tls_->handshake();
      if (step == TlsStream::Step::kFailed) {
        return end_with({.reason = tls_->error_message(), .permanent = tls_->is_permanent()});
      }
      if (step == TlsStream::Step::kAgain) {
        if (!wait_for(socket_.get(), tls_->poll_events(), deadline, stop)) break;
        continue;
      }
    }
    if (response_.state() == State::kDone)
      return end_with({.reason = "the server ended the stream"});
    if (!request_.empty() && !send_request()) {
      return end_with({.reason = "the connection broke"});
    }
    const auto events = static_cast<short>(request_.empty() ? POLLIN : POLLIN | POLLOUT);
    const bool has_pending = tls_ && tls_->has_pending();
    if (!has_pending && !wait_for(socket_.get(), events, deadline, stop)) break;

    const std::int64_t before = response_frames_;
    bool closed = false;
    if (!receive(closed)) return end_with({.reason = "the connection broke"});
    if (response_.state() == State::kBroken) {
      return end_with(
          {.reason = fmt::format("the server {}", response_.error_message()), .permanent = true});
    }
    if (response_.state() != State::kHeader && !header_checked_) {
      if (auto failure = check_header(stop)) return end_with(std::move(*failure));
      if (!header_checked_) continue;  // redirected
    }
    const bool over = closed || response_.state() == State::kDone;
    if (response_frames_ > before) {
      result.kind = LiveRead::Kind::kFrame;
      result.frames = response_frames_ - before;
      result.image.encoded = parser_.take();
      result.image.arrived = Clock::now();
      if (const auto header = probe_image(result.image.encoded)) {
        detail_ = fmt::format("{}x{} {}", header->width, header->height, kind());
      }
    }
    if (over) {
      if (is_snapshot_ && response_frames_ == 1) {
        tls_.reset();
        socket_.close();
        if (next_snapshot_ == Clock::time_point{}) next_snapshot_ = Clock::now() + snapshot_period_;
      } else if (result.kind != LiveRead::Kind::kFrame) {
        return end_with({.reason = header_checked_
                                       ? "the server ended the stream"
                                       : "the server closed the connection without an answer"});
      }
      // Otherwise return the frame first; the next read() sees the end again.
    }
  } while (result.kind == LiveRead::Kind::kNothing && !stop.stop_requested() &&
           Clock::now() < deadline);
  return result;
}

// An https address: uses this program's reader, or FFmpeg if that turns out to be needed.
class HttpsBackend final : public LiveBackend {
 public:
  HttpsBackend(const std::string& url, const SourceOptions& options)
      : options_(options), http_(std::make_unique<HttpBackend>(url, options)) {}

  std::optional<LiveFailure> open(milliseconds timeout, const std::stop_token& stop) override {
    return current().open(timeout, stop);
  }
  bool reachable(milliseconds timeout, const std::stop_token& stop) override {
    return current().reachable(timeout, stop);
  }
  LiveRead read(milliseconds timeout, const std::stop_token& stop) override {
    LiveRead read = current().read(timeout, stop);
    if (child_ || read.kind != LiveRead::Kind::kEnded || !http_->is_for_ffmpeg()) return read;
    try {
      child_ = make_child_backend(ffmpeg_command(http_->address(), options_));
    } catch (const Error& error) {
      read.failure = {.reason = error.what(), .permanent = true};
      return read;
    }
    http_.reset();  // close the connection first: a small camera may accept only one
    if (auto failure = child_->open(timeout, stop)) {
      read.failure = std::move(*failure);
      return read;
    }
    return {};
  }
  [[nodiscard]] std::string detail() const override { return current().detail(); }
  [[nodiscard]] double fps() const override { return current().fps(); }
  [[nodiscard]] bool may_recover() const override { return current().may_recover(); }
  [[nodiscard]] double startup_s() const override { return current().startup_s(); }

 private:
  [[nodiscard]] LiveBackend& current() const {
    return child_ ? *child_ : static_cast<LiveBackend&>(*http_);
  }

  const SourceOptions options_;
  std::unique_ptr<HttpBackend> http_;
  std::unique_ptr<LiveBackend> child_;
};

}  // namespace

std::unique_ptr<LiveBackend> make_http_backend(const std::string& url,
                                               const SourceOptions& options) {
  if (parse_endpoint(url).tls) return std::make_unique<HttpsBackend>(url, options);
  return std::make_unique<HttpBackend>(url, options);
}

}  // namespace tarsier
