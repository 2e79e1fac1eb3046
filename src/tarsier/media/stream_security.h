// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace tarsier {

// Verification of https:// and rtsps:// servers. A server must show a certificate that a trusted
// authority signed and that contains the host name (or IP address) of the URL. Otherwise nothing is
// sent to it, in particular no password.
struct StreamSecurity {
  // PEM file of the trusted authorities, or of the server's own certificate; empty: the system's
  // authorities (/etc/ssl/certs).
  std::string ca_file;
  // Accept any certificate: then anybody on the network path can read and forge the data.
  bool insecure = false;
};

}  // namespace tarsier
