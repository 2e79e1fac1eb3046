// SPDX-License-Identifier: MIT
#include "tarsier/media/tls_tunnel.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/tcp.h"
#include "tarsier/media/tls.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <list>
#include <mutex>
#include <netinet/in.h>
#include <optional>
#include <poll.h>
#include <span>
#include <string_view>
#include <sys/socket.h>
#include <utility>
#include <vector>

namespace tarsier {
namespace {

using Buffer = std::vector<std::uint8_t>;
using std::chrono::milliseconds;

constexpr std::size_t kBuffer = 64U << 10U;
constexpr std::size_t kMaxLinks = 8;
constexpr milliseconds kConnectTimeout{8000};
constexpr int kPoll_ms = 100;  // maximum duration of a poll() before the stop token is checked

// Detects the status line of a redirect in a server's answer, in pieces of any size.
class RedirectGuard {
 public:
  [[nodiscard]] bool finds_one(std::span<const std::uint8_t> bytes) {
    std::string text = std::exchange(tail_, {});
    text.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
    static constexpr std::array<std::string_view, 3> kRedirects = {"RTSP/1.0 3", "HTTP/1.1 3",
                                                                   "HTTP/1.0 3"};
    for (const std::string_view line : kRedirects) {
      if (text.find(line) != std::string::npos) return true;
    }
    tail_ = text.substr(text.size() - std::min(text.size(), kRedirects[0].size() - 1));
    return false;
  }

 private:
  std::string tail_;
};

// One connection: plain data is forwarded over TLS, and TLS data in plain.
struct Link {
  TcpSocket plain;
  TcpSocket remote;
  std::optional<TlsStream> tls;
  Buffer up;    // to the server
  Buffer down;  // from it
  RedirectGuard guard;
  bool plain_ended = false;
  bool remote_ended = false;
  bool over = false;
};

// Advances the parts of a Link that can advance; does not wait. Returns the error if it broke.
std::string pump(Link& link) {
  if (!link.tls->is_ready()) {
    const TlsStream::Step step = link.tls->handshake();
    if (step == TlsStream::Step::kFailed) return link.tls->error_message();
    if (step == TlsStream::Step::kAgain) return {};
  }
  std::array<std::uint8_t, 16384> buffer;
  while (!link.plain_ended && link.up.size() < kBuffer) {
    const ssize_t count = ::recv(link.plain.get(), buffer.data(), buffer.size(), 0);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0 && errno == EAGAIN) break;
    if (count <= 0) {
      link.plain_ended = true;
      break;
    }
    link.up.insert(link.up.end(), buffer.begin(), buffer.begin() + count);
  }
  while (!link.up.empty()) {
    const ssize_t count = link.tls->send(link.up);
    if (count < 0 && errno == EAGAIN) break;
    if (count < 0) return "the connection broke";
    link.up.erase(link.up.begin(), link.up.begin() + count);
  }
  while (!link.remote_ended && link.down.size() < kBuffer) {
    const ssize_t count = link.tls->recv(buffer);
    if (count < 0 && errno == EAGAIN) break;
    if (count < 0) return "the connection broke";
    if (count == 0) {
      link.remote_ended = true;
      break;
    }
    const auto bytes = std::span(buffer).first(static_cast<std::size_t>(count));
    if (link.guard.finds_one(bytes)) return "it redirects elsewhere, which is not followed";
    link.down.insert(link.down.end(), bytes.begin(), bytes.end());
  }
  while (!link.down.empty()) {
    const ssize_t count =
        ::send(link.plain.get(), link.down.data(), link.down.size(), MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0 && errno == EAGAIN) break;
    if (count < 0) {
      link.over = true;  // nobody reads any more
      return {};
    }
    link.down.erase(link.down.begin(), link.down.begin() + count);
  }
  link.over = (link.plain_ended && link.up.empty()) || (link.remote_ended && link.down.empty());
  return {};
}

}  // namespace

struct TlsTunnel::Impl {
  Impl(std::string the_host, std::uint16_t the_port, const StreamSecurity& security)
      : host(std::move(the_host)),
        remote_port(the_port),
        trust(std::make_shared<const TlsTrust>(security)) {}

  void listen();
  void run(const std::stop_token& stop);
  void accept_one(std::list<Link>& links, const std::stop_token& stop);
  void note(std::string text) {
    const std::lock_guard lock(mutex);
    error_message = std::move(text);
  }

  const std::string host;
  const std::uint16_t remote_port;
  const std::shared_ptr<const TlsTrust> trust;
  TcpSocket listener;
  std::uint16_t port = 0;
  std::mutex mutex;
  std::string error_message;
};

void TlsTunnel::Impl::listen() {
  listener = TcpSocket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  if (!listener.is_open() ||
      ::bind(listener.get(), reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
      ::listen(listener.get(), 4) != 0 ||
      ::getsockname(listener.get(), reinterpret_cast<sockaddr*>(&address), &size) != 0) {
    throw OutputError("127.0.0.1", fmt::format("no port for a connection within this machine: {}",
                                               errno_text(errno)));
  }
  port = ntohs(address.sin_port);
}

void TlsTunnel::Impl::accept_one(std::list<Link>& links, const std::stop_token& stop) {
  TcpSocket plain(::accept4(listener.get(), nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC));
  if (!plain.is_open()) return;
  LiveFailure failure;
  TcpSocket remote = connect_tcp(host, remote_port, kConnectTimeout, stop, failure);
  if (!remote.is_open()) {
    note(failure.reason);
    return;
  }
  Link& link = links.emplace_back();
  link.plain = std::move(plain);
  link.remote = std::move(remote);
  link.tls.emplace(trust, link.remote.get(), host);
}

void TlsTunnel::Impl::run(const std::stop_token& stop) {
  std::list<Link> links;
  std::vector<pollfd> items;
  while (!stop.stop_requested()) {
    items.clear();
    if (links.size() < kMaxLinks) items.push_back({listener.get(), POLLIN, 0});
    bool pending = false;
    for (const Link& link : links) {
      short plain = 0;
      short remote = link.tls->poll_events();
      if (link.tls->is_ready()) {
        if (!link.plain_ended && link.up.size() < kBuffer) plain |= POLLIN;
        if (!link.down.empty()) plain |= POLLOUT;
        remote = 0;
        if (!link.remote_ended && link.down.size() < kBuffer) remote |= POLLIN;
        if (!link.up.empty()) remote |= POLLOUT;
        pending = pending || (link.tls->has_pending() && link.down.size() < kBuffer);
      }
      if (plain != 0) items.push_back({link.plain.get(), plain, 0});
      items.push_back({link.remote.get(), remote, 0});
    }
    (void)::poll(items.data(), items.size(), pending ? 0 : kPoll_ms);
    if (links.size() < kMaxLinks && items[0].revents != 0) accept_one(links, stop);
    for (auto link = links.begin(); link != links.end();) {
      const std::string reason = pump(*link);
      if (!reason.empty()) note(reason);
      link = !reason.empty() || link->over ? links.erase(link) : std::next(link);
    }
  }
}

TlsTunnel::TlsTunnel(const std::string& host, std::uint16_t port, const StreamSecurity& security)
    : impl_(std::make_unique<Impl>(host, port, security)) {
  impl_->listen();
  thread_ = std::jthread([this](const std::stop_token& stop) { impl_->run(stop); });
}

TlsTunnel::~TlsTunnel() = default;

std::uint16_t TlsTunnel::port() const { return impl_->port; }

std::string TlsTunnel::error_message() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->error_message;
}

}  // namespace tarsier
