// SPDX-License-Identifier: MIT
#include "tarsier/io/http_stream.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/words.h"
#include "tarsier/io/http_protocol.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/mjpeg_parser.h"
#include "tarsier/io/tcp.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <poll.h>
#include <sys/socket.h>
#include <utility>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kMaxRedirects = 3;
constexpr milliseconds kSlice{50};  // how long anything may last before the stop token is looked at

std::string base64(std::string_view text) {
  static constexpr std::string_view kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string result;
  for (std::size_t i = 0; i < text.size(); i += 3) {
    std::uint32_t bits = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t byte = i + k < text.size() ? static_cast<unsigned char>(text[i + k]) : 0U;
      bits = (bits << 8U) | byte;
    }
    for (std::size_t k = 0; k < 4; ++k) {
      const auto digit = (bits >> (18U - 6U * static_cast<unsigned>(k))) & 63U;
      result += i + k <= text.size() ? kDigits[digit] : '=';
    }
  }
  return result;
}

class HttpBackend final : public LiveBackend {
 public:
  HttpBackend(const std::string& url, const SourceOptions& options)
      : url_(parse_url(url, "http", 80)),
        given_(url_),
        snapshot_period_(std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(
            1 / std::min(options.fps > 0 ? options.fps : 10.0, 60.0)))) {}

  std::optional<LiveFailure> open(milliseconds patience, const std::stop_token& stop) override {
    patience_ = patience;
    if (!socket_.is_open()) {
      LiveFailure failure;
      socket_ = connect_tcp(url_.host, url_.port, patience, stop, failure);
      if (!socket_.is_open()) return failure;
    }
    ask();
    return std::nullopt;
  }

  // The connection is kept: a server that accepts just one client must not lose it to a probe.
  bool reachable(milliseconds patience, const std::stop_token& stop) override {
    LiveFailure failure;
    if (!socket_.is_open()) {
      socket_ = connect_tcp(url_.host, url_.port, patience, stop, failure);
    }
    return socket_.is_open();
  }

  LiveRead read(milliseconds patience, const std::stop_token& stop) override;

  [[nodiscard]] std::string detail() const override { return detail_; }
  [[nodiscard]] double fps() const override { return 0; }
  [[nodiscard]] bool may_wake_up() const override { return true; }
  [[nodiscard]] double startup_s() const override { return 0; }

 private:
  void ask();
  bool send_request();
  bool receive(bool& closed);
  std::optional<LiveFailure> judge_header(const std::stop_token& stop);

  HttpUrl url_;          // where we are, after redirects
  const HttpUrl given_;  // the only place that gets the password
  const Clock::duration snapshot_period_;
  milliseconds patience_{3000};
  TcpSocket socket_;
  std::string request_;  // what is left to send
  HttpResponseParser response_;
  bool judged_ = false;
  bool is_snapshot_ = false;
  Clock::time_point next_snapshot_;
  int redirects_ = 0;
  std::int64_t asked_frames_ = 0;  // that came since the last request
  std::vector<std::uint8_t> buffer_ = std::vector<std::uint8_t>(256U << 10U);
  std::vector<std::uint8_t> body_;
  MjpegParser parser_;
  std::string detail_ = "HTTP";
};

void HttpBackend::ask() {
  request_ = fmt::format(
      "GET {} HTTP/1.1\r\nHost: {}\r\nUser-Agent: tarsier\r\n"
      "Accept: multipart/x-mixed-replace, image/jpeg, */*\r\nConnection: close\r\n",
      url_.target, url_.host_header());
  const bool is_home = url_.host == given_.host && url_.port == given_.port;
  if (is_home && !(given_.user.empty() && given_.password.empty())) {
    request_ += "Authorization: Basic " + base64(given_.user + ":" + given_.password) + "\r\n";
  }
  request_ += "\r\n";
  response_ = {};
  judged_ = false;
  asked_frames_ = 0;
  parser_.reset();
}

// False when the connection is broken.
bool HttpBackend::send_request() {
  while (!request_.empty()) {
    const ssize_t sent = ::send(socket_.get(), request_.data(), request_.size(), MSG_NOSIGNAL);
    if (sent < 0) return errno == EAGAIN || errno == EINTR;
    request_.erase(0, static_cast<std::size_t>(sent));
  }
  return true;
}

// Takes in everything that is there, for 50 ms at most: a server that sends without pause must not
// keep us from showing anything. False when the connection is broken.
bool HttpBackend::receive(bool& closed) {
  const Clock::time_point end = Clock::now() + kSlice;
  while (Clock::now() < end) {
    const ssize_t count = ::recv(socket_.get(), buffer_.data(), buffer_.size(), 0);
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
      asked_frames_ += parser_.feed(body_);
    }
    if (response_.state() == HttpResponseParser::State::kDone) return true;
  }
  return true;
}

std::optional<LiveFailure> HttpBackend::judge_header(const std::stop_token& stop) {
  judged_ = true;
  const int status = response_.status();
  if (status >= 300 && status < 400 && !response_.location().empty()) {
    if (++redirects_ > kMaxRedirects) {
      return LiveFailure{.reason = "redirects too often", .definite = true};
    }
    const std::string location = response_.location();
    try {
      if (location.starts_with("/") && !location.starts_with("//")) {
        HttpUrl next = parse_url("http://host" + location, "http", 80);
        url_.target = next.target;
      } else {
        url_ = parse_url(location, "http", 80);
      }
    } catch (const InputError&) {
      return LiveFailure{
          .reason = fmt::format("redirects to '{}'; only http is followed", masked(location)),
          .definite = true};
    }
    LiveFailure failure;
    socket_ = connect_tcp(url_.host, url_.port, patience_, stop, failure);
    if (!socket_.is_open()) return failure;
    ask();
    return std::nullopt;
  }
  if (status != 200) {
    LiveFailure failure;
    failure.reason = fmt::format("the server answers {} {}", status, response_.status_text());
    failure.definite = status >= 400 && status < 500 && status != 408 && status != 429;
    failure.denied = status == 401 || status == 403;
    if (status == 401) {
      failure.reason += given_.user.empty()
                            ? "; give a name and password: http://name:password@host/"
                            : "; name or password are wrong";
    }
    return failure;
  }
  const std::string type = lower_case(response_.content_type());
  if (type.starts_with("text/") || type.starts_with("application/json")) {
    return LiveFailure{
        .reason = fmt::format("the server sends {}, not pictures; is this the address of the "
                              "stream itself?",
                              response_.content_type()),
        .definite = true};
  }
  is_snapshot_ = type.starts_with("image/");
  detail_ = is_snapshot_ ? "JPEG snapshots over HTTP" : "MJPEG over HTTP";
  return std::nullopt;
}

LiveRead HttpBackend::read(milliseconds patience, const std::stop_token& stop) {
  using State = HttpResponseParser::State;
  LiveRead result;
  const auto end_with = [&result](LiveFailure failure) {
    result.kind = LiveRead::Kind::kEnded;
    result.failure = std::move(failure);
    return result;
  };
  const Clock::time_point deadline = Clock::now() + patience;
  do {
    if (!socket_.is_open()) {  // between two snapshots
      const Clock::time_point now = Clock::now();
      if (now < next_snapshot_) {
        const auto pause = std::min<Clock::duration>(
            {kSlice, next_snapshot_ - now, std::max(Clock::duration(0), deadline - now)});
        sleep_unless_stopped(std::chrono::ceil<milliseconds>(pause), stop);
        continue;
      }
      next_snapshot_ = now + snapshot_period_;
      LiveFailure failure;
      socket_ = connect_tcp(url_.host, url_.port, patience_, stop, failure);
      if (!socket_.is_open()) return end_with(std::move(failure));
      ask();
    }
    if (response_.state() == State::kDone)
      return end_with({.reason = "the server ended the stream"});
    if (!request_.empty() && !send_request()) {
      return end_with({.reason = "the connection broke"});
    }
    const short events = static_cast<short>(request_.empty() ? POLLIN : POLLIN | POLLOUT);
    if (!wait_for(socket_.get(), events, deadline, stop)) break;

    const std::int64_t before = asked_frames_;
    bool closed = false;
    if (!receive(closed)) return end_with({.reason = "the connection broke"});
    if (response_.state() == State::kBroken) {
      return end_with(
          {.reason = fmt::format("the server {}", response_.trouble()), .definite = true});
    }
    if (response_.state() != State::kHeader && !judged_) {
      if (auto failure = judge_header(stop)) return end_with(std::move(*failure));
      if (!judged_) continue;  // redirected
    }
    const bool over = closed || response_.state() == State::kDone;
    if (asked_frames_ > before) {
      result.kind = LiveRead::Kind::kFrame;
      result.frames = asked_frames_ - before;
      result.picture.encoded = parser_.take();
      result.picture.arrived = Clock::now();
      if (const auto header = probe_image(result.picture.encoded)) {
        detail_ = fmt::format("{}x{} {}", header->width, header->height,
                              is_snapshot_ ? "JPEG snapshots over HTTP" : "MJPEG over HTTP");
      }
    }
    if (over) {
      if (is_snapshot_ && asked_frames_ == 1) {
        socket_.close();
        if (next_snapshot_ == Clock::time_point{}) next_snapshot_ = Clock::now() + snapshot_period_;
      } else if (result.kind != LiveRead::Kind::kFrame) {
        return end_with({.reason = judged_ ? "the server ended the stream"
                                           : "the server hung up without an answer"});
      }
      // Otherwise the frame first; the next read() meets the end again.
    }
  } while (result.kind == LiveRead::Kind::kNothing && !stop.stop_requested() &&
           Clock::now() < deadline);
  return result;
}

}  // namespace

std::unique_ptr<LiveBackend> make_http_backend(const std::string& url,
                                               const SourceOptions& options) {
  return std::make_unique<HttpBackend>(url, options);
}

}  // namespace tarsier
