// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <vector>

namespace tarsier::web {

// PEM texts of a certificate and its key.
struct TlsFiles {
  std::string certificate;
  std::string key;
};

// Reads both. Throws InputError (missing, not PEM).
[[nodiscard]] TlsFiles read_tls_files(const std::string& certificate, const std::string& key);

// The self-signed certificate in `folder` (tls-cert.pem, and tls-key.pem of mode 0600): ECDSA
// P-256, 2 years. It is created if it is missing, expires within 30 days, or lacks one of `names`
// (host names and IP addresses). Throws OutputError.
[[nodiscard]] TlsFiles self_signed_certificate(const std::string& folder,
                                               const std::vector<std::string>& names);

// SHA-256 of the certificate as browsers show it: "AB:CD:..". Throws InputError if it is not PEM.
[[nodiscard]] std::string fingerprint_of(const std::string& certificate_pem);

}  // namespace tarsier::web
