// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace tarsier::web {

// What keeps pages of other sites away from a server on this machine: their requests carry another
// Host (a name of theirs that points here: DNS rebinding), another Origin, or a Sec-Fetch-Site that
// tells of them.
struct OriginRules {
  bool tls = false;
  std::uint16_t port = 0;
  // Lower case, without port: "localhost", "127.0.0.1", "[::1]", with --listen-all also the names
  // and addresses of this machine.
  std::set<std::string> hosts;
  // "https://studio.example" of --behind-proxy, lower case, without a default port; or empty.
  std::string proxy_origin;

  // The facts of a request's head; "" is an absent header.
  struct Head {
    std::string_view method;
    std::string_view path;
    std::string_view host;
    bool has_host = true;
    std::string_view origin;
    std::string_view fetch_site;
    std::string_view fetch_mode;
    std::string_view fetch_dest;
  };
  struct Refusal {
    int status = 403;
    std::string message;
  };
  // Why the request is refused, or nothing.
  [[nodiscard]] std::optional<Refusal> refusal(const Head& head) const;

 private:
  [[nodiscard]] bool is_direct_host(std::string_view host) const;
  [[nodiscard]] bool is_own_host(std::string_view host) const;
  [[nodiscard]] bool is_own_origin(std::string_view origin) const;
};

// "HTTPS://Studio.Example:443" as "https://studio.example". Throws UsageError for anything but a
// scheme (http or https), a host and perhaps a port.
[[nodiscard]] std::string normal_origin(std::string_view text);

// "name", "name:80", "[::1]:80" in lower case, split; nothing where it is malformed. Port 0: none.
struct HostAndPort {
  std::string host;
  std::uint16_t port = 0;
};
[[nodiscard]] std::optional<HostAndPort> parse_host(std::string_view text);

}  // namespace tarsier::web
