// SPDX-License-Identifier: MIT
#include "tarsier/media/tls.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <gnutls/gnutls.h>
#include <gnutls/x509.h>
#include <new>
#include <poll.h>
#include <utility>

namespace tarsier {

struct TlsTrust::Impl {
  gnutls_certificate_credentials_t credentials = nullptr;
  bool insecure = false;
};

TlsTrust::TlsTrust(const StreamSecurity& security) : impl_(std::make_unique<Impl>()) {
  impl_->insecure = security.insecure;
  if (gnutls_certificate_allocate_credentials(&impl_->credentials) < 0) throw std::bad_alloc();
  if (security.insecure) return;
  const int count = security.ca_file.empty()
                        ? gnutls_certificate_set_x509_system_trust(impl_->credentials)
                        : gnutls_certificate_set_x509_trust_file(
                              impl_->credentials, security.ca_file.c_str(), GNUTLS_X509_FMT_PEM);
  if (count > 0) return;
  gnutls_certificate_free_credentials(std::exchange(impl_->credentials, nullptr));
  if (security.ca_file.empty()) {
    throw InputError("/etc/ssl/certs",
                     "no certificates of authorities: sudo apt install ca-certificates, or name a "
                     "file (option 'ca_file')");
  }
  throw InputError(security.ca_file,
                   count < 0 ? fmt::format("no certificates (PEM) can be read from it: {}",
                                           gnutls_strerror(count))
                             : std::string("has no certificates (PEM)"));
}

TlsTrust::~TlsTrust() { gnutls_certificate_free_credentials(impl_->credentials); }

struct TlsStream::Impl {
  gnutls_session_t session = nullptr;
};

namespace {

bool is_number(const std::string& host) {
  std::array<unsigned char, sizeof(in6_addr)> bytes{};
  return inet_pton(AF_INET, host.c_str(), bytes.data()) == 1 ||
         inet_pton(AF_INET6, host.c_str(), bytes.data()) == 1;
}

// What is wrong with a certificate, and what to do about it.
std::string distrust(unsigned status, const std::string& host) {
  if ((status & GNUTLS_CERT_REVOKED) != 0) return "its certificate was revoked";
  if ((status & GNUTLS_CERT_SIGNER_NOT_FOUND) == 0) {
    if ((status & GNUTLS_CERT_UNEXPECTED_OWNER) != 0) {
      return fmt::format(
          "its certificate is not for '{}': use the name in the certificate, or skip the check "
          "(option 'insecure')",
          host);
    }
    if ((status & (GNUTLS_CERT_EXPIRED | GNUTLS_CERT_NOT_ACTIVATED)) != 0) {
      return fmt::format(
          "its certificate {}: check this machine's clock, or skip the check (option 'insecure')",
          (status & GNUTLS_CERT_EXPIRED) != 0 ? "has expired" : "is not valid yet");
    }
  }
  return fmt::format(
      "its certificate is not trusted ({}): name the file of the authority's certificate (option "
      "'ca_file'), or skip the check (option 'insecure')",
      (status & GNUTLS_CERT_SIGNER_NOT_FOUND) != 0 ? "signed by an unknown authority"
                                                   : "bad signature");
}

}  // namespace

TlsStream::TlsStream(std::shared_ptr<const TlsTrust> trust, int socket, std::string host)
    : trust_(std::move(trust)), host_(std::move(host)), impl_(std::make_unique<Impl>()) {
  if (gnutls_init(&impl_->session, GNUTLS_CLIENT | GNUTLS_NONBLOCK | GNUTLS_NO_SIGNAL) < 0) {
    throw std::bad_alloc();
  }
  gnutls_session_t session = impl_->session;
  gnutls_set_default_priority(session);
  gnutls_credentials_set(session, GNUTLS_CRD_CERTIFICATE, trust_->impl_->credentials);
  if (!is_number(host_)) {  // RFC 6066: no IP addresses here
    gnutls_server_name_set(session, GNUTLS_NAME_DNS, host_.data(), host_.size());
  }
  if (!trust_->impl_->insecure) gnutls_session_set_verify_cert(session, host_.c_str(), 0);
  gnutls_transport_set_int(session, socket);
}

TlsStream::~TlsStream() { gnutls_deinit(impl_->session); }

TlsStream::Step TlsStream::handshake() {
  while (true) {
    const int result = gnutls_handshake(impl_->session);
    if (result == GNUTLS_E_SUCCESS) {
      ready_ = true;
      return Step::kDone;
    }
    if (result == GNUTLS_E_AGAIN) return Step::kAgain;
    if (gnutls_error_is_fatal(result) == 0) continue;
    if (result == GNUTLS_E_CERTIFICATE_VERIFICATION_ERROR) {
      permanent_ = true;
      error_message_ = distrust(gnutls_session_get_verify_cert_status(impl_->session), host_);
    } else if (result == GNUTLS_E_PREMATURE_TERMINATION || result == GNUTLS_E_PULL_ERROR) {
      error_message_ = "it closed the connection during the TLS handshake";
    } else {
      permanent_ = true;
      error_message_ = fmt::format("TLS failed: {}", gnutls_strerror(result));
    }
    return Step::kFailed;
  }
}

ssize_t TlsStream::recv(std::span<std::uint8_t> buffer) {
  while (true) {
    const ssize_t count = gnutls_record_recv(impl_->session, buffer.data(), buffer.size());
    if (count >= 0) return count;
    if (count == GNUTLS_E_AGAIN) {
      errno = EAGAIN;
      return -1;
    }
    // Cameras seldom close TLS properly. Frames have their own ends, so a truncated stream is
    // detected.
    if (count == GNUTLS_E_PREMATURE_TERMINATION) return 0;
    // We start no new handshake; other warnings are ignored.
    if (count == GNUTLS_E_REHANDSHAKE || gnutls_error_is_fatal(static_cast<int>(count)) == 0)
      continue;
    errno = EPROTO;
    return -1;
  }
}

ssize_t TlsStream::send(std::span<const std::uint8_t> bytes) {
  while (true) {
    const ssize_t count = gnutls_record_send(impl_->session, bytes.data(), bytes.size());
    if (count >= 0) return count;
    if (count == GNUTLS_E_INTERRUPTED) continue;
    errno = count == GNUTLS_E_AGAIN ? EAGAIN : EPROTO;
    return -1;
  }
}

bool TlsStream::has_pending() const { return gnutls_record_check_pending(impl_->session) > 0; }

short TlsStream::poll_events() const {
  return gnutls_record_get_direction(impl_->session) == 0 ? POLLIN : POLLOUT;
}

}  // namespace tarsier
