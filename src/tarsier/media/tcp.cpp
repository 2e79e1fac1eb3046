// SPDX-License-Identifier: MIT
#include "tarsier/media/tcp.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <memory>
#include <mutex>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

milliseconds left_until(Clock::time_point deadline) {
  return std::max(milliseconds(0),
                  std::chrono::duration_cast<milliseconds>(deadline - Clock::now()));
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

// getaddrinfo() can block for half a minute if the network is down, and it cannot be interrupted.
// So names are resolved in a separate thread, which is abandoned if nobody waits any more.
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

bool wait_for(int descriptor, short events, Clock::time_point deadline,
              const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    const milliseconds slice = std::min(kStopCheckInterval, left_until(deadline));
    pollfd item{descriptor, events, 0};
    if (::poll(&item, 1, static_cast<int>(slice.count())) > 0) return true;
    if (Clock::now() >= deadline) return false;
  }
  return false;
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

TcpSocket connect_tcp(const std::string& host, std::uint16_t port, milliseconds timeout,
                      const std::stop_token& stop, LiveFailure& failure) {
  const Clock::time_point deadline = Clock::now() + timeout;
  failure = {};
  const Resolved resolved = resolve(host, port, deadline, stop);
  if (resolved.addresses.empty()) {
    failure.unreachable = true;
    // Only a clear "no such name" is permanent: a name server that does not answer may recover.
    failure.permanent = resolved.code == EAI_NONAME;
    failure.reason = failure.permanent ? fmt::format("unknown host '{}'", host)
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
    // A camera that loses power does not close the connection; keep-alive detects this eventually.
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
    // The remaining time is divided among the remaining addresses.
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
  failure.permanent = number == ECONNREFUSED;
  failure.reason =
      number == ECONNREFUSED
          ? fmt::format("nothing listens on port {} of {} (connection refused)", port, host)
      : number == ETIMEDOUT ? fmt::format("{} does not answer on port {}", host, port)
                            : fmt::format("cannot connect: {}", errno_text(number));
  return {};
}

}  // namespace tarsier
