// SPDX-License-Identifier: MIT
#include "tarsier/io/http_stream.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/mjpeg_parser.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <condition_variable>
#include <cstring>
#include <fcntl.h>
#include <mutex>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

constexpr int kMaxRedirects = 3;
constexpr milliseconds kSlice{50};  // how long a poll() may last before the stop token is looked at

std::string error_text(int number) { return std::generic_category().message(number); }

std::string lower(std::string_view text) {
  std::string result(text);
  for (char& c : result) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return result;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t' || text.back() == '\r')) {
    text.remove_suffix(1);
  }
  return text;
}

template <typename Number>
bool parse_number(std::string_view text, Number& value, int base = 10) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc() && end == text.data() + text.size();
}

std::string percent_decoded(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    if (text[i] == '%' && i + 2 < text.size() && parse_number(text.substr(i + 1, 2), value, 16)) {
      result += static_cast<char>(value);
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

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

milliseconds left_until(Clock::time_point deadline) {
  return std::max(milliseconds(0),
                  std::chrono::duration_cast<milliseconds>(deadline - Clock::now()));
}

// Waits until `descriptor` has one of `events` (or an error); false after `deadline` or when
// stopped.
bool wait_for(int descriptor, short events, Clock::time_point deadline,
              const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const milliseconds slice = std::min(kSlice, left_until(deadline));
    pollfd item{descriptor, events, 0};
    if (::poll(&item, 1, static_cast<int>(slice.count())) > 0) return true;
    if (Clock::now() >= deadline) return false;
  }
  return false;
}

struct Address {
  sockaddr_storage storage{};
  socklen_t size = 0;
  int family = 0;
};

struct Resolved {
  std::vector<Address> addresses;
  int code = EAI_AGAIN;  // of getaddrinfo
};

Resolved resolve_now(const std::string& host, std::uint16_t port, int flags) {
  Resolved result;
  addrinfo hints{};
  hints.ai_family = AF_UNSPEC;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = flags | AI_NUMERICSERV;
  addrinfo* found = nullptr;
  result.code = ::getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found);
  if (result.code != 0) return result;
  for (const addrinfo* item = found; item != nullptr; item = item->ai_next) {
    if (item->ai_addrlen > sizeof(sockaddr_storage)) continue;
    Address address;
    std::memcpy(&address.storage, item->ai_addr, item->ai_addrlen);
    address.size = item->ai_addrlen;
    address.family = item->ai_family;
    result.addresses.push_back(address);
  }
  ::freeaddrinfo(found);
  return result;
}

// getaddrinfo() can block for half a minute when the network is down and cannot be interrupted, so
// names are looked up in a thread of their own that is left behind when nobody waits any more.
Resolved resolve(const std::string& host, std::uint16_t port, Clock::time_point deadline,
                 const std::stop_token& stop) {
  Resolved numeric = resolve_now(host, port, AI_NUMERICHOST);
  if (numeric.code == 0) return numeric;

  struct Shared {
    std::mutex mutex;
    std::condition_variable_any wake;
    bool done = false;
    Resolved result;
  };
  const auto shared = std::make_shared<Shared>();
  std::thread([shared, host, port] {
    Resolved result = resolve_now(host, port, 0);
    const std::lock_guard lock(shared->mutex);
    shared->result = std::move(result);
    shared->done = true;
    shared->wake.notify_all();
  }).detach();
  std::unique_lock lock(shared->mutex);
  shared->wake.wait_until(lock, stop, deadline, [&] { return shared->done; });
  return shared->done ? std::move(shared->result) : Resolved{};
}

}  // namespace

std::string HttpUrl::host_header() const {
  std::string text = host.find(':') != std::string::npos ? "[" + host + "]" : host;
  if (port != 80) text += fmt::format(":{}", port);
  return text;
}

HttpUrl parse_url(std::string_view text, std::string_view scheme, std::uint16_t default_port) {
  const auto refuse = [&](const char* reason) {
    throw InputError(masked(text),
                     fmt::format("{}; expected {}://host[:port]/path", reason, scheme));
  };
  const std::size_t start = scheme.size() + 3;
  if (text.size() < start || lower(text.substr(0, start)) != fmt::format("{}://", scheme)) {
    refuse("not such an address");
  }
  if (text.size() > 8192) refuse("too long");
  for (const char c : text) {
    if (static_cast<unsigned char>(c) <= 0x20 || c == 0x7f)
      refuse("has a space or control character");
  }
  HttpUrl url;
  std::string_view rest = text.substr(start);
  const std::size_t authority_end = std::min(rest.find_first_of("/?#"), rest.size());
  std::string_view authority = rest.substr(0, authority_end);
  std::string_view target = rest.substr(authority_end);
  target = target.substr(0, std::min(target.find('#'), target.size()));
  url.target =
      target.empty() || target.front() != '/' ? "/" + std::string(target) : std::string(target);

  if (const std::size_t at = authority.rfind('@'); at != std::string_view::npos) {
    const std::string_view who = authority.substr(0, at);
    const std::size_t colon = std::min(who.find(':'), who.size());
    url.user = percent_decoded(who.substr(0, colon));
    if (colon < who.size()) url.password = percent_decoded(who.substr(colon + 1));
    authority.remove_prefix(at + 1);
  }
  url.port = default_port;
  std::string_view port;
  bool has_port = false;
  if (!authority.empty() && authority.front() == '[') {
    const std::size_t close = authority.find(']');
    if (close == std::string_view::npos) refuse("has no ']' after its IPv6 address");
    url.host = authority.substr(1, close - 1);
    const std::string_view behind = authority.substr(close + 1);
    if (!behind.empty() && behind.front() != ':')
      refuse("has something odd after its IPv6 address");
    has_port = !behind.empty();
    if (has_port) port = behind.substr(1);
  } else {
    const std::size_t colon = authority.find(':');
    url.host = authority.substr(0, std::min(colon, authority.size()));
    has_port = colon != std::string_view::npos;
    if (has_port) port = authority.substr(colon + 1);
  }
  if (url.host.empty()) refuse("has no host name");
  if (has_port && (!parse_number(port, url.port) || url.port == 0)) refuse("has a bad port");
  return url;
}

void HttpResponseParser::break_off(std::string trouble) {
  state_ = State::kBroken;
  trouble_ = std::move(trouble);
}

void HttpResponseParser::feed(std::span<const std::uint8_t> bytes,
                              std::vector<std::uint8_t>& body) {
  if (state_ == State::kHeader) {
    const std::size_t before = header_.size();
    const std::size_t room = kHeaderLimit - before;
    const std::size_t taken = std::min(room, bytes.size());
    header_.append(reinterpret_cast<const char*>(bytes.data()), taken);
    // The status line is judged as early as possible: what is not HTTP may never send an empty
    // line.
    const std::string_view magic = "HTTP/1.";
    const std::size_t compared = std::min(magic.size(), header_.size());
    if (std::string_view(header_).substr(0, compared) != magic.substr(0, compared)) {
      break_off("does not speak HTTP");
      return;
    }
    const std::size_t search_from = before > 3 ? before - 3 : 0;
    std::size_t end = header_.find("\r\n\r\n", search_from);
    std::size_t gap = 4;
    if (const std::size_t bare = header_.find("\n\n", search_from); bare < end) {
      end = bare;  // some small cameras
      gap = 2;
    }
    if (end == std::string::npos) {
      if (header_.size() >= kHeaderLimit) break_off("sends an HTTP header without end");
      return;
    }
    bytes = bytes.subspan(end + gap - before);
    header_.resize(end);
    if (!parse_header()) return;
    header_.clear();
    if (status_ == 100) {  // an interim answer; the real one follows
      status_ = 0;
      feed(bytes, body);
      return;
    }
    state_ = has_length_ && left_ == 0 && !chunked_ ? State::kDone : State::kBody;
  }
  if (state_ == State::kBody) read_body(bytes, body);
}

bool HttpResponseParser::parse_header() {
  std::string_view rest = header_;
  bool is_first = true;
  content_type_.clear();
  location_.clear();
  chunked_ = false;
  has_length_ = false;
  left_ = 0;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view line = trimmed(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (is_first) {
      is_first = false;
      if (line.size() < 12 || line[8] != ' ' || !parse_number(line.substr(9, 3), status_) ||
          status_ < 100 || status_ > 599) {
        break_off("sends a broken HTTP status line");
        return false;
      }
      status_text_ = trimmed(line.substr(12));
      continue;
    }
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) continue;
    const std::string name = lower(trimmed(line.substr(0, colon)));
    const std::string_view value = trimmed(line.substr(colon + 1));
    if (name == "content-type") {
      content_type_ = value;
    } else if (name == "location") {
      location_ = value;
    } else if (name == "transfer-encoding") {
      chunked_ = lower(value).find("chunked") != std::string::npos;
    } else if (name == "content-length") {
      has_length_ = parse_number(value, left_);
      if (!has_length_) left_ = 0;
    }
  }
  // Some cameras state a length for their endless stream.
  if (lower(content_type_).starts_with("multipart/")) has_length_ = false;
  return true;
}

void HttpResponseParser::read_body(std::span<const std::uint8_t> bytes,
                                   std::vector<std::uint8_t>& body) {
  if (chunked_) {
    read_chunks(bytes, body);
    return;
  }
  if (has_length_) {
    bytes = bytes.first(static_cast<std::size_t>(std::min<std::uint64_t>(left_, bytes.size())));
    left_ -= bytes.size();
    if (left_ == 0) state_ = State::kDone;
  }
  body.insert(body.end(), bytes.begin(), bytes.end());
}

void HttpResponseParser::read_chunks(std::span<const std::uint8_t> bytes,
                                     std::vector<std::uint8_t>& body) {
  while (!bytes.empty() && state_ == State::kBody) {
    if (chunk_ == Chunk::kData) {
      const auto part =
          bytes.first(static_cast<std::size_t>(std::min<std::uint64_t>(left_, bytes.size())));
      body.insert(body.end(), part.begin(), part.end());
      bytes = bytes.subspan(part.size());
      left_ -= part.size();
      if (left_ == 0) chunk_ = Chunk::kDataEnd;
      continue;
    }
    const char c = static_cast<char>(bytes.front());
    bytes = bytes.subspan(1);
    if (c != '\n') {
      line_ += c;
      if (line_.size() > 4096) break_off("sends a broken chunked stream");
      continue;
    }
    const std::string line = std::exchange(line_, {});
    const std::string_view text = trimmed(line);
    if (chunk_ == Chunk::kDataEnd) {
      if (!text.empty()) break_off("sends a broken chunked stream");
      chunk_ = Chunk::kSize;
    } else if (chunk_ == Chunk::kTrailer) {
      if (text.empty()) state_ = State::kDone;
    } else {
      const std::string_view size = trimmed(text.substr(0, std::min(text.find(';'), text.size())));
      if (!parse_number(size, left_, 16)) {
        break_off("sends a broken chunked stream");
      } else {
        chunk_ = left_ == 0 ? Chunk::kTrailer : Chunk::kData;
      }
    }
  }
}

TcpSocket::TcpSocket(TcpSocket&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

TcpSocket& TcpSocket::operator=(TcpSocket&& other) noexcept {
  if (this != &other) {
    close();
    descriptor_ = std::exchange(other.descriptor_, -1);
  }
  return *this;
}

void TcpSocket::close() {
  if (descriptor_ >= 0) ::close(std::exchange(descriptor_, -1));
}

TcpSocket connect_tcp(const std::string& host, std::uint16_t port, milliseconds patience,
                      const std::stop_token& stop, LiveFailure& failure) {
  const Clock::time_point deadline = Clock::now() + patience;
  failure = {};
  const Resolved resolved = resolve(host, port, deadline, stop);
  if (resolved.addresses.empty()) {
    failure.unreachable = true;
    // Only a clear "no such name" is definite: a name server that cannot be asked may come back.
    failure.definite = resolved.code == EAI_NONAME;
    failure.reason = failure.definite ? fmt::format("unknown host '{}'", host)
                                      : fmt::format("the name '{}' could not be looked up", host);
    return {};
  }
  int number = ETIMEDOUT;
  for (std::size_t i = 0; i < resolved.addresses.size() && !stop.stop_requested(); ++i) {
    const Address& address = resolved.addresses[i];
    TcpSocket socket(
        ::socket(address.family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, IPPROTO_TCP));
    if (!socket.is_open()) {
      number = errno;
      continue;
    }
    const int on = 1;
    // A camera that loses power never says goodbye; keep-alive notices it in the end.
    ::setsockopt(socket.get(), SOL_SOCKET, SO_KEEPALIVE, &on, sizeof on);
    ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address.storage),
                  address.size) == 0) {
      return socket;
    }
    if (errno != EINPROGRESS) {
      number = errno;
      continue;
    }
    // The time that is left is shared between the addresses that are left.
    const auto share = left_until(deadline) / static_cast<int>(resolved.addresses.size() - i);
    if (!wait_for(socket.get(), POLLOUT, Clock::now() + share, stop)) {
      number = ETIMEDOUT;
      continue;
    }
    int result = 0;
    socklen_t size = sizeof result;
    if (::getsockopt(socket.get(), SOL_SOCKET, SO_ERROR, &result, &size) == 0 && result == 0) {
      return socket;
    }
    number = result;
  }
  failure.unreachable = true;
  failure.definite = number == ECONNREFUSED;
  failure.reason =
      number == ECONNREFUSED
          ? fmt::format("nothing listens on port {} of {} (connection refused)", port, host)
      : number == ETIMEDOUT ? fmt::format("{} does not answer on port {}", host, port)
                            : fmt::format("cannot connect: {}", error_text(number));
  return {};
}

namespace {

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
  const std::string type = lower(response_.content_type());
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
