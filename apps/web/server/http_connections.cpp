// SPDX-License-Identifier: MIT
#include "http_connections.h"

#include <arpa/inet.h>
#include <array>
#include <memory>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

namespace tarsier::web {
namespace {

std::string address_text(const sockaddr* address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address == nullptr) return "?";
  if (address->sa_family == AF_INET) {
    const auto* four = reinterpret_cast<const sockaddr_in*>(address);
    ::inet_ntop(AF_INET, &four->sin_addr, text.data(), text.size());
  } else if (address->sa_family == AF_INET6) {
    const auto* six = reinterpret_cast<const sockaddr_in6*>(address);
    if (IN6_IS_ADDR_V4MAPPED(&six->sin6_addr)) {
      ::inet_ntop(AF_INET, six->sin6_addr.s6_addr + 12, text.data(), text.size());
    } else {
      ::inet_ntop(AF_INET6, &six->sin6_addr, text.data(), text.size());
    }
  }
  return text.data();
}

std::chrono::steady_clock::duration seconds(double value) {
  return std::chrono::duration_cast<std::chrono::steady_clock::duration>(
      std::chrono::duration<double>(value));
}

}  // namespace

void HttpConnections::start() {
  watchdog_ = std::thread([this] { run_watchdog(); });
}

void HttpConnections::enter(Connection* connection, Phase phase, double timeout_s) {
  if (connection == nullptr) return;
  const std::lock_guard lock(mutex_);
  connection->phase = phase;
  connection->since = Clock::now();
  connection->deadline =
      timeout_s > 0 ? connection->since + seconds(timeout_s) : Clock::time_point::max();
}

void HttpConnections::begin_head(Connection* connection) {
  if (connection == nullptr) return;
  const std::lock_guard lock(mutex_);
  // The first request keeps the deadline of the connection.
  if (connection->phase == Phase::kIdle)
    connection->deadline = Clock::now() + seconds(options_.head_s);
  connection->phase = Phase::kHead;
}

void HttpConnections::set_signed_in(Connection& connection, bool signed_in) {
  const std::lock_guard lock(mutex_);
  connection.signed_in = signed_in;
}

void HttpConnections::end(Connection& connection) {
  if (connection.is_ended) return;
  connection.is_ended = true;
  ++counters_.evicted;
  (void)::shutdown(connection.socket, SHUT_RDWR);
}

// The oldest connection that may be closed, of `address` (nullptr: any). Call it with the mutex
// held.
Connection* HttpConnections::to_evict(const std::string* address, const Connection* except) {
  Connection* found = nullptr;
  for (Connection* connection : connections_) {
    if (connection == except || connection->is_ended) continue;
    if (address != nullptr && connection->address != *address) continue;
    const bool waits = connection->phase == Phase::kFirstHead ||
                       connection->phase == Phase::kIdle || connection->phase == Phase::kHead;
    if (!waits && (connection->signed_in || connection->phase == Phase::kHandler)) continue;
    if (found == nullptr || connection->since < found->since) found = connection;
  }
  return found;
}

void HttpConnections::make_room(Connection& added) {
  unsigned all = 0;
  unsigned same = 0;
  for (const Connection* connection : connections_) {
    if (connection->is_ended) continue;
    ++all;
    if (connection->address == added.address) ++same;
  }
  const auto evict = [&](const std::string* address) {
    Connection* oldest = to_evict(address, &added);
    end(oldest != nullptr ? *oldest : added);
  };
  if (same > options_.max_per_address) {
    evict(&added.address);
  } else if (all > options_.max_connections) {
    evict(nullptr);
  }
}

Connection* HttpConnections::add(int socket, const sockaddr* from) {
  auto connection = std::make_unique<Connection>();
  connection->socket = socket;
  connection->address = address_text(from);
  connection->since = Clock::now();
  connection->deadline = connection->since + seconds(options_.head_s);
  const int one = 1;
  (void)::setsockopt(socket, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
  const std::lock_guard lock(mutex_);
  connections_.insert(connection.get());
  if (closing_) {
    end(*connection);
  } else {
    make_room(*connection);
  }
  counters_.open = connections_.size();
  return connection.release();
}

void HttpConnections::remove(Connection* connection) {
  if (connection == nullptr) return;
  {
    const std::lock_guard lock(mutex_);
    connections_.erase(connection);
    counters_.open = connections_.size();
  }
  delete connection;
  changed_.notify_all();
}

// Closes connections whose time limit has passed.
void HttpConnections::run_watchdog() {
  std::unique_lock lock(mutex_);
  while (!closing_) {
    changed_.wait_for(lock, std::chrono::milliseconds(500), [&] { return closing_; });
    const Clock::time_point now = Clock::now();
    for (Connection* connection : connections_) {
      if (now >= connection->deadline) end(*connection);
    }
  }
}

void HttpConnections::close() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  changed_.notify_all();
  if (watchdog_.joinable()) watchdog_.join();
}

bool HttpConnections::is_closing() const {
  const std::lock_guard lock(mutex_);
  return closing_;
}

void HttpConnections::end_all(std::chrono::milliseconds timeout) {
  std::unique_lock lock(mutex_);
  for (const Connection* connection : connections_) (void)::shutdown(connection->socket, SHUT_RDWR);
  (void)changed_.wait_for(lock, timeout, [&] { return connections_.empty(); });
}

}  // namespace tarsier::web
