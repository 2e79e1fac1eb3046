// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>

namespace tarsier::web {

// Rules that keep pages of other sites away from a server on this machine. Their requests have a
// foreign Host (a foreign name that points to this machine: DNS rebinding), a foreign Origin, or a
// Sec-Fetch-Site that reveals them.
struct OriginRules {
  bool tls = false;
  std::uint16_t port = 0;
  // Lower case, without port: "localhost", "127.0.0.1", "[::1]"; with --listen-all also the names
  // and addresses of this machine.
  std::set<std::string> hosts;
  // "https://studio.example" of --behind-proxy, lower case, without a default port; or empty.
  std::string proxy_origin;

  // The relevant parts of a request's head; "" for an absent header.
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
  // The reason why the request is refused, or nullopt.
  [[nodiscard]] std::optional<Refusal> refusal(const Head& head) const;

 private:
  [[nodiscard]] bool is_direct_host(std::string_view host) const;
  [[nodiscard]] bool is_own_host(std::string_view host) const;
  [[nodiscard]] bool is_own_origin(std::string_view origin) const;
};

// Converts "HTTPS://Studio.Example:443" to "https://studio.example". Throws UsageError unless the
// text is a scheme (http or https), a host and an optional port.
[[nodiscard]] std::string normal_origin(std::string_view text);

// Splits "name", "name:80", "[::1]:80" in lower case; nullopt if malformed. Port 0: no port given.
struct HostAndPort {
  std::string host;
  std::uint16_t port = 0;
};
[[nodiscard]] std::optional<HostAndPort> parse_host(std::string_view text);

}  // namespace tarsier::web
