// SPDX-License-Identifier: MIT
#include "tls_certificate.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <cstdio>
#include <ctime>
#include <fcntl.h>
#include <fstream>
#include <gnutls/crypto.h>
#include <gnutls/gnutls.h>
#include <gnutls/x509.h>
#include <iterator>
#include <memory>
#include <sys/stat.h>
#include <type_traits>
#include <unistd.h>

namespace tarsier::web {
namespace {

constexpr std::time_t kDay = 24 * 3600;

void check(int result, const std::string& what) {
  if (result < 0)
    throw OutputError("TLS certificate", fmt::format("{}: {}", what, gnutls_strerror(result)));
}

std::string read_pem(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path, errno_text(errno));
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

using Certificate =
    std::unique_ptr<std::remove_pointer_t<gnutls_x509_crt_t>, decltype(&gnutls_x509_crt_deinit)>;
using Key = std::unique_ptr<std::remove_pointer_t<gnutls_x509_privkey_t>,
                            decltype(&gnutls_x509_privkey_deinit)>;

Certificate new_certificate() {
  gnutls_x509_crt_t raw = nullptr;
  check(gnutls_x509_crt_init(&raw), "no memory");
  return {raw, &gnutls_x509_crt_deinit};
}

gnutls_datum_t datum_of(const std::string& text) {
  return {reinterpret_cast<unsigned char*>(const_cast<char*>(text.data())),
          static_cast<unsigned>(text.size())};
}

Certificate parse_certificate(const std::string& pem) {
  Certificate certificate = new_certificate();
  const gnutls_datum_t data = datum_of(pem);
  const int result = gnutls_x509_crt_import(certificate.get(), &data, GNUTLS_X509_FMT_PEM);
  if (result < 0)
    throw InputError("TLS certificate",
                     fmt::format("not a certificate in PEM format: {}", gnutls_strerror(result)));
  return certificate;
}

// Bytes of an IP address: 4 or 16; none if it is not an address.
std::string address_bytes(const std::string& name) {
  std::array<char, 16> bytes{};
  if (::inet_pton(AF_INET, name.c_str(), bytes.data()) == 1) return {bytes.data(), 4};
  if (::inet_pton(AF_INET6, name.c_str(), bytes.data()) == 1) return {bytes.data(), 16};
  return {};
}

bool serves(const Certificate& certificate, const std::vector<std::string>& names) {
  const std::time_t end = gnutls_x509_crt_get_expiration_time(certificate.get());
  if (end < std::time(nullptr) + 30 * kDay) return false;
  for (const std::string& name : names) {
    // This compares IP addresses, too.
    if (gnutls_x509_crt_check_hostname(certificate.get(), name.c_str()) == 0) return false;
  }
  return true;
}

template <class Export>
std::string exported(const Export& write) {
  gnutls_datum_t data{};
  check(write(&data), "export");
  std::string text(reinterpret_cast<const char*>(data.data), data.size);
  gnutls_free(data.data);
  return text;
}

TlsFiles make_certificate(const std::vector<std::string>& names) {
  gnutls_x509_privkey_t raw = nullptr;
  check(gnutls_x509_privkey_init(&raw), "no memory");
  const Key key(raw, &gnutls_x509_privkey_deinit);
  check(gnutls_x509_privkey_generate(key.get(), GNUTLS_PK_ECDSA,
                                     GNUTLS_CURVE_TO_BITS(GNUTLS_ECC_CURVE_SECP256R1), 0),
        "the key");
  const Certificate certificate = new_certificate();
  gnutls_x509_crt_t crt = certificate.get();
  std::array<unsigned char, 16> serial{};
  check(gnutls_rnd(GNUTLS_RND_NONCE, serial.data(), serial.size()), "random numbers");
  serial[0] = static_cast<unsigned char>((serial[0] & 0x7fU) | 0x01U);  // positive
  const std::time_t now = std::time(nullptr);
  check(gnutls_x509_crt_set_version(crt, 3), "version");
  check(gnutls_x509_crt_set_serial(crt, serial.data(), serial.size()), "serial");
  check(gnutls_x509_crt_set_activation_time(crt, now - kDay), "dates");
  check(gnutls_x509_crt_set_expiration_time(crt, now + 730 * kDay), "dates");
  const std::string common = "Tarsier studio";
  check(gnutls_x509_crt_set_dn_by_oid(crt, GNUTLS_OID_X520_COMMON_NAME, 0, common.data(),
                                      static_cast<unsigned>(common.size())),
        "name");
  check(gnutls_x509_crt_set_key(crt, key.get()), "key");
  check(gnutls_x509_crt_set_basic_constraints(crt, 0, -1), "constraints");
  check(gnutls_x509_crt_set_key_usage(crt, GNUTLS_KEY_DIGITAL_SIGNATURE), "usage");
  check(gnutls_x509_crt_set_key_purpose_oid(crt, GNUTLS_KP_TLS_WWW_SERVER, 0), "purpose");
  for (const std::string& name : names) {
    const std::string address = address_bytes(name);
    const std::string& value = address.empty() ? name : address;
    check(gnutls_x509_crt_set_subject_alt_name(
              crt, address.empty() ? GNUTLS_SAN_DNSNAME : GNUTLS_SAN_IPADDRESS, value.data(),
              static_cast<unsigned>(value.size()), GNUTLS_FSAN_APPEND),
          name);
  }
  check(gnutls_x509_crt_sign2(crt, crt, key.get(), GNUTLS_DIG_SHA256, 0), "signature");
  TlsFiles files;
  files.certificate = exported(
      [&](gnutls_datum_t* out) { return gnutls_x509_crt_export2(crt, GNUTLS_X509_FMT_PEM, out); });
  files.key = exported([&](gnutls_datum_t* out) {
    return gnutls_x509_privkey_export2(key.get(), GNUTLS_X509_FMT_PEM, out);
  });
  return files;
}

}  // namespace

TlsFiles read_tls_files(const std::string& certificate, const std::string& key) {
  TlsFiles files{read_pem(certificate), read_pem(key)};
  (void)parse_certificate(files.certificate);
  if (files.key.find("PRIVATE KEY-----") == std::string::npos)
    throw InputError(key, "not a private key in PEM format");
  return files;
}

TlsFiles self_signed_certificate(const std::string& folder, const std::vector<std::string>& names) {
  const std::string certificate_path = folder + "/tls-cert.pem";
  const std::string key_path = folder + "/tls-key.pem";
  try {
    TlsFiles files = read_tls_files(certificate_path, key_path);
    if (serves(parse_certificate(files.certificate), names)) return files;
    log_info("a new certificate of this server was made");
  } catch (const InputError&) {
    // No certificate yet.
  }
  TlsFiles files = make_certificate(names);
  (void)::unlink(key_path.c_str());
  const int fd = ::open(key_path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (fd < 0) throw OutputError(key_path, errno_text(errno));
  try {
    write_all(fd, files.key, key_path);
  } catch (...) {
    ::close(fd);
    throw;
  }
  ::close(fd);
  write_file_atomically(certificate_path, files.certificate);
  return files;
}

std::string fingerprint_of(const std::string& certificate_pem) {
  const Certificate certificate = parse_certificate(certificate_pem);
  std::array<unsigned char, 32> sum{};
  std::size_t size = sum.size();
  check(gnutls_x509_crt_get_fingerprint(certificate.get(), GNUTLS_DIG_SHA256, sum.data(), &size),
        "fingerprint");
  std::string text;
  for (const unsigned char byte : sum)
    text += fmt::format("{}{:02X}", text.empty() ? "" : ":", byte);
  return text;
}

}  // namespace tarsier::web
