// SPDX-License-Identifier: MIT
#include "origin_rules.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <algorithm>

namespace tarsier::web {
namespace {

bool is_host_character(char c) {
  return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-' || c == '.' || c == '_';
}

std::uint16_t default_port(bool tls) { return tls ? 443 : 80; }

}  // namespace

std::optional<HostAndPort> parse_host(std::string_view text) {
  HostAndPort result;
  const std::string lower = lower_case(text);
  std::string_view rest = lower;
  if (rest.starts_with('[')) {
    const std::size_t end = rest.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    const std::string_view inside = rest.substr(1, end - 1);
    if (inside.empty() || inside.find_first_not_of("0123456789abcdef:.") != std::string_view::npos)
      return std::nullopt;
    result.host = rest.substr(0, end + 1);
    rest.remove_prefix(end + 1);
  } else {
    const std::size_t end = std::min(rest.find(':'), rest.size());
    result.host = rest.substr(0, end);
    if (result.host.empty() || result.host.size() > 253 ||
        !std::all_of(result.host.begin(), result.host.end(), is_host_character))
      return std::nullopt;
    rest.remove_prefix(end);
  }
  if (rest.empty()) return result;
  rest.remove_prefix(1);
  const auto port = to_integer(rest, 1, 65535);
  if (rest.empty() || rest.front() == '+' || rest.front() == '-' || !port) return std::nullopt;
  result.port = static_cast<std::uint16_t>(*port);
  return result;
}

std::string normal_origin(std::string_view text) {
  const std::string lower = lower_case(text);
  std::string_view rest = lower;
  const bool tls = rest.starts_with("https://");
  if (!tls && !rest.starts_with("http://"))
    throw UsageError(fmt::format("{}: an origin begins with https:// (or http://)", text));
  rest.remove_prefix(tls ? 8 : 7);
  if (rest.ends_with('/')) rest.remove_suffix(1);
  const auto host = parse_host(rest);
  if (!host)
    throw UsageError(fmt::format("{}: expected an origin as https://studio.example:8443", text));
  const bool is_default = host->port == 0 || host->port == default_port(tls);
  return fmt::format("http{}://{}{}", tls ? "s" : "", host->host,
                     is_default ? "" : fmt::format(":{}", host->port));
}

bool OriginRules::is_direct_host(std::string_view text) const {
  const auto host = parse_host(text);
  return host && (host->port != 0 ? host->port : default_port(tls)) == port &&
         hosts.contains(host->host);
}

bool OriginRules::is_own_host(std::string_view text) const {
  if (is_direct_host(text)) return true;
  const auto host = parse_host(text);
  if (!host || proxy_origin.empty()) return false;
  // A proxy forwards either its own host name or ours.
  for (const std::string_view scheme : {"https://", "http://"}) {
    if (!proxy_origin.starts_with(scheme)) continue;
    const auto own = parse_host(std::string_view(proxy_origin).substr(scheme.size()));
    const std::uint16_t scheme_port = default_port(scheme == "https://");
    return own && own->host == host->host &&
           (own->port != 0 ? own->port : scheme_port) ==
               (host->port != 0 ? host->port : scheme_port);
  }
  return false;
}

bool OriginRules::is_own_origin(std::string_view text) const {
  std::string origin;
  try {
    origin = normal_origin(text);
  } catch (const UsageError&) {
    return false;  // includes "null"
  }
  if (!proxy_origin.empty() && origin == proxy_origin) return true;
  const std::string_view scheme = tls ? "https://" : "http://";
  return std::string_view(origin).starts_with(scheme) &&
         is_direct_host(std::string_view(origin).substr(scheme.size()));
}

std::optional<OriginRules::Refusal> OriginRules::refusal(const Head& head) const {
  if (!head.has_host || head.host.empty()) return Refusal{400, "the request has no Host header"};
  if (!is_own_host(head.host))
    return Refusal{421,
                   "this server has a different name: open the link that tarsier serve printed"};
  if (!head.origin.empty() && !is_own_origin(head.origin))
    return Refusal{403, "requests from other sites are refused"};
  const bool is_api = head.path.starts_with("/api/") || head.path == "/metrics";
  // A link on another page may lead to our pages, which contain no data. Everything else from there
  // is refused.
  const bool is_link = head.method == "GET" && !is_api && head.fetch_mode == "navigate" &&
                       head.fetch_dest == "document";
  if (!head.fetch_site.empty() && head.fetch_site != "same-origin" && head.fetch_site != "none" &&
      !is_link)
    return Refusal{403, "requests from other sites are refused"};
  return std::nullopt;
}

}  // namespace tarsier::web
