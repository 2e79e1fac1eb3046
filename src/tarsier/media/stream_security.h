// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace tarsier {

// Whom https:// and rtsps:// addresses are believed to be. A server must show a certificate that
// one of the trusted authorities signed and that holds the name (or number) in the address;
// otherwise nothing is sent to it, passwords in particular.
struct StreamSecurity {
  // PEM file of the authorities that are trusted, or of the server's own certificate; empty: those
  // of the system (/etc/ssl/certs).
  std::string ca_file;
  bool insecure = false;  // believe any certificate: whoever is on the way can watch and forge
};

}  // namespace tarsier
