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

// The client's side of TLS 1.2 and 1.3 over a connected, non-blocking socket (GnuTLS). The server's
// certificate, its dates and its name are checked during the handshake, before a byte of the
// caller's is sent (RFC 6125; numbers of hosts are compared with the certificate's IP entries).

// Who is trusted; read once, shared by the connections of one source.
class TlsTrust {
 public:
  // Throws InputError when the CA file cannot be read, or when the system has no authorities.
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
  // The socket is the caller's and outlives this; `host` is the name that the certificate must
  // hold.
  TlsStream(std::shared_ptr<const TlsTrust> trust, int socket, const std::string& host);
  ~TlsStream();
  TlsStream(const TlsStream&) = delete;
  TlsStream& operator=(const TlsStream&) = delete;

  enum class Step { kDone, kAgain, kFailed };
  // Goes on as far as it can without waiting; kAgain: call again once the socket has poll_events().
  [[nodiscard]] Step handshake();
  [[nodiscard]] bool is_ready() const { return ready_; }  // the handshake is done
  // kFailed: why, for the user, with what to do.
  [[nodiscard]] const std::string& trouble() const { return trouble_; }
  // Whether trying again would not help: the certificate, or no TLS at all.
  [[nodiscard]] bool is_definite() const { return definite_; }

  // As ::recv() and ::send() of a non-blocking socket: bytes, 0 at the end (recv), or -1 with errno
  // EAGAIN or EPROTO. After send() failed with EAGAIN the same bytes must be given again.
  [[nodiscard]] ssize_t recv(std::span<std::uint8_t> buffer);
  [[nodiscard]] ssize_t send(std::span<const std::uint8_t> bytes);
  // Whether recv() has bytes that the socket does not show any more.
  [[nodiscard]] bool has_pending() const;
  // What an unfinished call waits for: POLLIN or POLLOUT.
  [[nodiscard]] short poll_events() const;

 private:
  struct Impl;
  std::shared_ptr<const TlsTrust> trust_;
  std::string host_;
  std::unique_ptr<Impl> impl_;
  bool ready_ = false;
  bool definite_ = false;
  std::string trouble_;
};

}  // namespace tarsier
