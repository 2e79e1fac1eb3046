// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/stream_security.h"

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <sys/types.h>

namespace tarsier {

// Client side of TLS 1.2 and 1.3 over a connected, non-blocking socket (GnuTLS). The server's
// certificate, its dates and its name are checked during the handshake, before any byte of the
// caller is sent (RFC 6125; numeric hosts are compared with the certificate's IP entries).

// The trusted authorities; read once, shared by the connections of one source.
class TlsTrust {
 public:
  // Throws InputError if the CA file cannot be read or the system has no authorities.
  explicit TlsTrust(const StreamSecurity& security);
  ~TlsTrust();
  TlsTrust(const TlsTrust&) = delete;
  TlsTrust& operator=(const TlsTrust&) = delete;

 private:
  friend class TlsStream;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

class TlsStream {
 public:
  // The caller owns the socket, which must outlive this object. The certificate must contain the
  // name `host`.
  TlsStream(std::shared_ptr<const TlsTrust> trust, int socket, std::string host);
  ~TlsStream();
  TlsStream(const TlsStream&) = delete;
  TlsStream& operator=(const TlsStream&) = delete;

  enum class Step { kDone, kAgain, kFailed };
  // Continues as far as possible without waiting. kAgain: call again when the socket has
  // poll_events().
  [[nodiscard]] Step handshake();
  [[nodiscard]] bool is_ready() const { return ready_; }  // the handshake is done
  // The reason of kFailed, for the user, and what to do.
  [[nodiscard]] const std::string& error_message() const { return error_message_; }
  // Whether a retry cannot help: an invalid certificate, or no TLS at all.
  [[nodiscard]] bool is_permanent() const { return permanent_; }

  // As ::recv() and ::send() of a non-blocking socket: the number of bytes, 0 at the end (recv), or
  // -1 with errno EAGAIN or EPROTO. After send() failed with EAGAIN the same bytes must be passed
  // again.
  [[nodiscard]] ssize_t recv(std::span<std::uint8_t> buffer);
  [[nodiscard]] ssize_t send(std::span<const std::uint8_t> bytes);
  // Whether recv() has bytes that poll() on the socket does not show.
  [[nodiscard]] bool has_pending() const;
  // The event that an unfinished call waits for: POLLIN or POLLOUT.
  [[nodiscard]] short poll_events() const;

 private:
  struct Impl;
  std::shared_ptr<const TlsTrust> trust_;
  std::string host_;
  std::unique_ptr<Impl> impl_;
  bool ready_ = false;
  bool permanent_ = false;
  std::string error_message_;
};

}  // namespace tarsier
