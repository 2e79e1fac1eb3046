// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/stream_security.h"

#include <cstdint>
#include <memory>
#include <string>
#include <thread>

namespace tarsier {

// Forwards plain connections from this machine to one server over verified TLS, for programs whose
// own TLS is not reliable. FFmpeg checks no certificate of rtsps (measured with 5.1 of Debian 12:
// the option tls_verify has no effect) and follows redirects from https to http despite its list of
// protocols.
//
// A response that redirects (status 3xx of HTTP or RTSP) ends its connection, because the following
// request would bypass the tunnel. Listens on 127.0.0.1, on a port that it chooses. Another user of
// this machine may connect, too, and gets only what the server gives to anybody.
class TlsTunnel {
 public:
  // Throws InputError (a CA file that cannot be read) and OutputError (no port).
  TlsTunnel(const std::string& host, std::uint16_t port, const StreamSecurity& security);
  ~TlsTunnel();
  TlsTunnel(const TlsTunnel&) = delete;
  TlsTunnel& operator=(const TlsTunnel&) = delete;

  [[nodiscard]] std::uint16_t port() const;  // of 127.0.0.1
  // Why the last failed connection failed; empty if none failed.
  [[nodiscard]] std::string error_message() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::jthread thread_;  // last: stops before the members that it uses are destroyed
};

}  // namespace tarsier
