// SPDX-License-Identifier: MIT
#pragma once

// Certificates and a TLS server for tests, on 127.0.0.1. All keys are generated when a test runs.

#include <arpa/inet.h>
#include <array>
#include <atomic>
#include <cstdint>
#include <ctime>
#include <functional>
#include <gnutls/gnutls.h>
#include <gnutls/x509.h>
#include <mutex>
#include <netinet/in.h>
#include <poll.h>
#include <stdexcept>
#include <string>
#include <sys/socket.h>
#include <sys/time.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::test_support {

inline void must(int code, const char* what) {
  if (code < 0) throw std::runtime_error(std::string(what) + ": " + gnutls_strerror(code));
}

class Certificate {
 public:
  // If `signer` is null the certificate is that of an authority (self-signed). `name` is a DNS
  // name, or 127.0.0.1.
  explicit Certificate(const std::string& name, const Certificate* signer = nullptr,
                       std::time_t expires = std::time(nullptr) + 86400) {
    static std::atomic<unsigned char> serial{1};
    must(gnutls_x509_privkey_init(&key_), "key");
    must(gnutls_x509_privkey_generate(key_, GNUTLS_PK_ECDSA,
                                      GNUTLS_CURVE_TO_BITS(GNUTLS_ECC_CURVE_SECP256R1), 0),
         "key");
    must(gnutls_x509_crt_init(&certificate_), "certificate");
    gnutls_x509_crt_set_version(certificate_, 3);
    const unsigned char number = serial++;
    gnutls_x509_crt_set_serial(certificate_, &number, 1);
    gnutls_x509_crt_set_activation_time(certificate_, expires - 2 * 86400);
    gnutls_x509_crt_set_expiration_time(certificate_, expires);
    gnutls_x509_crt_set_dn_by_oid(certificate_, GNUTLS_OID_X520_COMMON_NAME, 0, name.data(),
                                  static_cast<unsigned>(name.size()));
    gnutls_x509_crt_set_basic_constraints(certificate_, signer == nullptr ? 1 : 0, -1);
    if (signer == nullptr) {
      gnutls_x509_crt_set_key_usage(certificate_,
                                    GNUTLS_KEY_KEY_CERT_SIGN | GNUTLS_KEY_DIGITAL_SIGNATURE);
    } else if (in_addr number_of_host{}; inet_pton(AF_INET, name.c_str(), &number_of_host) == 1) {
      gnutls_x509_crt_set_subject_alt_name(certificate_, GNUTLS_SAN_IPADDRESS, &number_of_host,
                                           sizeof number_of_host, GNUTLS_FSAN_SET);
    } else {
      gnutls_x509_crt_set_subject_alt_name(certificate_, GNUTLS_SAN_DNSNAME, name.data(),
                                           static_cast<unsigned>(name.size()), GNUTLS_FSAN_SET);
    }
    must(gnutls_x509_crt_set_key(certificate_, key_), "certificate");
    must(
        gnutls_x509_crt_sign2(certificate_, signer == nullptr ? certificate_ : signer->certificate_,
                              signer == nullptr ? key_ : signer->key_, GNUTLS_DIG_SHA256, 0),
        "signature");
  }
  ~Certificate() {
    gnutls_x509_crt_deinit(certificate_);
    gnutls_x509_privkey_deinit(key_);
  }
  Certificate(const Certificate&) = delete;
  Certificate& operator=(const Certificate&) = delete;

  [[nodiscard]] std::string pem() const {
    gnutls_datum_t data{};
    must(gnutls_x509_crt_export2(certificate_, GNUTLS_X509_FMT_PEM, &data), "PEM");
    std::string text(reinterpret_cast<const char*>(data.data), data.size);
    gnutls_free(data.data);
    return text;
  }
  void use_in(gnutls_certificate_credentials_t credentials) const {
    gnutls_x509_crt_t list[] = {certificate_};
    must(gnutls_certificate_set_x509_key(credentials, list, 1, key_), "credentials");
  }

 private:
  gnutls_x509_privkey_t key_ = nullptr;
  gnutls_x509_crt_t certificate_ = nullptr;
};

// Answers one request on each connection, then hangs up.
class TlsServer {
 public:
  using Handler = std::function<std::string(const std::string& request)>;

  TlsServer(const Certificate& certificate, Handler handler) : handler_(std::move(handler)) {
    must(gnutls_certificate_allocate_credentials(&credentials_), "credentials");
    certificate.use_in(credentials_);
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
        ::listen(listener_, 8) != 0 ||
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
      throw std::runtime_error("test server: no port");
    }
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }
  ~TlsServer() {
    thread_ = {};
    ::close(listener_);
    gnutls_certificate_free_credentials(credentials_);
  }
  TlsServer(const TlsServer&) = delete;
  TlsServer& operator=(const TlsServer&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string url(const std::string& path = "/cam", const std::string& who = "",
                                const std::string& scheme = "https") const {
    return scheme + "://" + who + "127.0.0.1:" + std::to_string(port_) + path;
  }
  [[nodiscard]] std::vector<std::string> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }

 private:
  void run(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      pollfd item{listener_, POLLIN, 0};
      if (::poll(&item, 1, 20) <= 0) continue;
      const int connection = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (connection < 0) continue;
      const timeval timeout{10, 0};
      ::setsockopt(connection, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
      ::setsockopt(connection, SOL_SOCKET, SO_SNDTIMEO, &timeout, sizeof timeout);
      serve(connection);
      ::close(connection);
    }
  }

  void serve(int connection) {
    gnutls_session_t session = nullptr;
    must(gnutls_init(&session, GNUTLS_SERVER | GNUTLS_NO_SIGNAL), "session");
    gnutls_set_default_priority(session);
    gnutls_credentials_set(session, GNUTLS_CRD_CERTIFICATE, credentials_);
    gnutls_transport_set_int(session, connection);
    int code = 0;
    do {
      code = gnutls_handshake(session);
    } while (code < 0 && gnutls_error_is_fatal(code) == 0);
    std::string request;
    std::array<char, 4096> buffer;
    while (code == 0 && request.find("\r\n\r\n") == std::string::npos) {
      const ssize_t count = gnutls_record_recv(session, buffer.data(), buffer.size());
      if (count <= 0) break;
      request.append(buffer.data(), static_cast<std::size_t>(count));
    }
    if (request.find("\r\n\r\n") != std::string::npos) {
      {
        const std::lock_guard lock(mutex_);
        requests_.push_back(request);
      }
      const std::string reply = handler_(request);
      for (std::size_t at = 0; at < reply.size();) {
        const ssize_t count = gnutls_record_send(session, reply.data() + at, reply.size() - at);
        if (count <= 0) break;
        at += static_cast<std::size_t>(count);
      }
      gnutls_bye(session, GNUTLS_SHUT_WR);
    }
    gnutls_deinit(session);
  }

  const Handler handler_;
  gnutls_certificate_credentials_t credentials_ = nullptr;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  mutable std::mutex mutex_;
  std::vector<std::string> requests_;
  std::jthread thread_;
};

}  // namespace tarsier::test_support
