// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/live_source.h"

#include <chrono>
#include <cstdint>
#include <stop_token>
#include <string>

namespace tarsier {

// A non-blocking TCP connection that is being established or open. Closed on destruction.
class TcpSocket {
 public:
  TcpSocket() = default;
  explicit TcpSocket(int descriptor) : descriptor_(descriptor) {}
  ~TcpSocket() { close(); }
  TcpSocket(TcpSocket&& other) noexcept;
  TcpSocket& operator=(TcpSocket&& other) noexcept;
  [[nodiscard]] int get() const { return descriptor_; }
  [[nodiscard]] bool is_open() const { return descriptor_ >= 0; }
  void close();

 private:
  int descriptor_ = -1;
};

// Resolves the host and connects, trying each address. On failure the socket is closed and
// `failure` has the reason.
[[nodiscard]] TcpSocket connect_tcp(const std::string& host, std::uint16_t port,
                                    std::chrono::milliseconds timeout, const std::stop_token& stop,
                                    LiveFailure& failure);

// Waits until `descriptor` has one of `events` (of poll()) or an error. Returns false after
// `deadline` or when stopped.
[[nodiscard]] bool wait_for(int descriptor, short events,
                            std::chrono::steady_clock::time_point deadline,
                            const std::stop_token& stop);

}  // namespace tarsier
