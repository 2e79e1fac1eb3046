// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <netinet/in.h>
#include <string>
#include <string_view>

// The address on which a server listens.
namespace tarsier {

struct ListenAddress {
  std::string host;  // as written, without brackets
  bool ipv6 = false;
  bool loopback = false;  // reachable only from this machine
  bool any = false;       // all interfaces
  ::in_addr v4{};
  ::in6_addr v6{};
  std::uint16_t port = 0;

  // Listens on all interfaces instead of this machine only.
  void open_to_all();
  // Whether a request with the header Host "name:80" or "[::1]:80" is meant for this server. A page
  // of another site whose name points to 127.0.0.1 sends that site's name (DNS rebinding). The
  // names of other interfaces are not known; for those any well-formed name is accepted.
  [[nodiscard]] bool is_own_host(std::string_view host) const;
};

// Parses "http://127.0.0.1:8080/": localhost or an IP address; port 0 means any free port. Throws
// UsageError.
[[nodiscard]] ListenAddress parse_listen_address(const std::string& url);

// Opens a listening socket and stores its port in `address`. Throws OutputError(url, ..), e.g. for
// a port in use.
[[nodiscard]] int listen_on(const std::string& url, ListenAddress& address);

}  // namespace tarsier
