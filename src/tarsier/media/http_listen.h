// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <netinet/in.h>
#include <string>
#include <string_view>

// Where a server listens.
namespace tarsier {

struct ListenAddress {
  std::string host;  // as written, without brackets
  bool ipv6 = false;
  bool loopback = false;  // this machine alone can reach it
  bool any = false;       // every interface
  ::in_addr v4{};
  ::in6_addr v6{};
  std::uint16_t port = 0;

  // Every interface instead of this machine alone.
  void open_to_all();
  // Whether a request for that "name:80" or "[::1]:80" is meant for a server here: a page of
  // another site that has its name point to 127.0.0.1 sends that name. The names by which other
  // interfaces are known are unknown: there any well-formed one will do.
  [[nodiscard]] bool is_own_host(std::string_view host) const;
};

// Of "http://127.0.0.1:8080/": localhost or an IP address; port 0: any that is free. Throws
// UsageError.
[[nodiscard]] ListenAddress parse_listen_address(const std::string& url);

// A listening socket, its port filled into `address`. Throws OutputError(url, ..), e.g. for a port
// that is taken.
[[nodiscard]] int listen_on(const std::string& url, ListenAddress& address);

}  // namespace tarsier
