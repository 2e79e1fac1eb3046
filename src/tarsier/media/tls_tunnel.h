// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/stream_security.h"

#include <cstdint>
#include <memory>
#include <string>
#include <thread>

namespace tarsier {

// Passes plain connections from this machine on to one server over verified TLS: for programs whose
// own TLS cannot be relied on. FFmpeg checks no certificate of rtsps at all (measured with 5.1 of
// Debian 12: the option tls_verify does not get there) and follows redirects from https to http
// whatever its list of protocols says.
//
// An answer that redirects (status 3xx of HTTP or RTSP) ends its connection, because what follows
// it would not come here. Listens on 127.0.0.1, on a port of its own choice; another user of this
// machine may connect as well and gets no more than the server gives to anybody.
class TlsTunnel {
 public:
  // Throws InputError (a CA file that cannot be read) and OutputError (no port).
  TlsTunnel(const std::string& host, std::uint16_t port, const StreamSecurity& security);
  ~TlsTunnel();
  TlsTunnel(const TlsTunnel&) = delete;
  TlsTunnel& operator=(const TlsTunnel&) = delete;

  [[nodiscard]] std::uint16_t port() const;  // of 127.0.0.1
  // Why the last connection that failed did; empty: none did.
  [[nodiscard]] std::string trouble() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::jthread thread_;  // last: what it uses is there before it starts and after it ends
};

}  // namespace tarsier
