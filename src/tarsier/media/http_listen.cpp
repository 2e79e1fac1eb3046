// SPDX-License-Identifier: MIT
#include "tarsier/media/http_listen.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <optional>
#include <sys/socket.h>
#include <system_error>
#include <unistd.h>

namespace tarsier {
namespace {

// "name:80" or "[::1]:80" without the port; nullopt if it is malformed.
std::optional<std::string> host_name(std::string_view host) {
  std::size_t end = 0;
  if (!host.empty() && host.front() == '[') {
    end = host.find(']');
    if (end == std::string_view::npos) return std::nullopt;
    ++end;
  } else {
    end = std::min(host.find(':'), host.size());
  }
  const std::string_view port = host.substr(end);
  if (!port.empty() && (port.front() != ':' || port.size() > 6 ||
                        port.find_first_not_of("0123456789", 1) != std::string_view::npos)) {
    return std::nullopt;
  }
  return lower_case(host.substr(0, end));
}

}  // namespace

void ListenAddress::open_to_all() {
  any = true;
  loopback = false;
  v4.s_addr = INADDR_ANY;
  v6 = in6addr_any;
}

bool ListenAddress::is_own_host(std::string_view text) const {
  const auto name = host_name(text);
  if (!name) return false;
  if (!loopback) return true;
  const std::string own = lower_case(ipv6 ? fmt::format("[{}]", host) : host);
  return *name == "localhost" || *name == "127.0.0.1" || *name == "[::1]" || *name == own;
}

ListenAddress parse_listen_address(const std::string& url) {
  constexpr std::string_view kScheme = "http://";
  const auto fail = [&](std::string_view reason) -> ListenAddress {
    throw UsageError(fmt::format("{}: {}; expected http://127.0.0.1:8080/", url, reason));
  };
  if (url.rfind(kScheme, 0) != 0) return fail("is not an http:// address");
  std::string_view rest = std::string_view(url).substr(kScheme.size());
  const std::size_t slash = rest.find_first_of("/?#");
  if (slash != std::string_view::npos) {
    if (rest.substr(slash) != "/") return fail("nothing may follow the port");
    rest = rest.substr(0, slash);
  }
  if (rest.find('@') != std::string_view::npos) return fail("a user name has no place here");
  ListenAddress address;
  std::string_view port;
  if (!rest.empty() && rest.front() == '[') {
    const std::size_t end = rest.find(']');
    if (end == std::string_view::npos) return fail("']' is missing");
    address.host = rest.substr(1, end - 1);
    address.ipv6 = true;
    port = rest.substr(end + 1);
  } else {
    const std::size_t colon = rest.find(':');
    address.host = rest.substr(0, colon);
    port = colon == std::string_view::npos ? "" : rest.substr(colon);
  }
  address.port = 80;
  if (!port.empty()) {
    if (port.front() != ':') return fail("the port is unreadable");
    port.remove_prefix(1);
    const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), address.port);
    if (error != std::errc() || end != port.data() + port.size())
      return fail("the port must be 0..65535");
  }
  if (address.ipv6) {
    if (::inet_pton(AF_INET6, address.host.c_str(), &address.v6) != 1)
      return fail("that is not an IPv6 address");
    address.loopback = IN6_IS_ADDR_LOOPBACK(&address.v6);
    address.any = IN6_IS_ADDR_UNSPECIFIED(&address.v6);
    return address;
  }
  const std::string literal = address.host == "localhost" ? "127.0.0.1" : address.host;
  if (::inet_pton(AF_INET, literal.c_str(), &address.v4) != 1)
    return fail("the host must be localhost or an IP address of this machine");
  address.loopback = (ntohl(address.v4.s_addr) >> 24U) == 127;
  address.any = address.v4.s_addr == INADDR_ANY;
  return address;
}

int listen_on(const std::string& url, ListenAddress& address) {
  const auto fail = [&](int error) {
    throw OutputError(url,
                      error == EADDRINUSE
                          ? "the port is taken by another program: choose another, or 0 for any"
                          : "cannot listen: " + errno_text(error));
  };
  const int fd = ::socket(address.ipv6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) fail(errno);
  const auto set = [&](int level, int option, int value) {
    (void)::setsockopt(fd, level, option, &value, sizeof value);
  };
  set(SOL_SOCKET, SO_REUSEADDR, 1);
  // Accepted sockets inherit it. Images in a large kernel buffer would be old when they arrive.
  set(SOL_SOCKET, SO_SNDBUF, 128 * 1024);
  ::sockaddr_storage storage{};
  ::socklen_t size = 0;
  if (address.ipv6) {
    set(IPPROTO_IPV6, IPV6_V6ONLY, address.any ? 0 : 1);
    ::sockaddr_in6 name{};
    name.sin6_family = AF_INET6;
    name.sin6_port = htons(address.port);
    name.sin6_addr = address.v6;
    std::memcpy(&storage, &name, sizeof name);
    size = sizeof name;
  } else {
    ::sockaddr_in name{};
    name.sin_family = AF_INET;
    name.sin_port = htons(address.port);
    name.sin_addr = address.v4;
    std::memcpy(&storage, &name, sizeof name);
    size = sizeof name;
  }
  if (::bind(fd, reinterpret_cast<::sockaddr*>(&storage), size) != 0 || ::listen(fd, 32) != 0 ||
      ::getsockname(fd, reinterpret_cast<::sockaddr*>(&storage), &size) != 0) {
    const int error = errno;
    ::close(fd);
    fail(error);
  }
  if (address.ipv6) {
    ::sockaddr_in6 name{};
    std::memcpy(&name, &storage, sizeof name);
    address.port = ntohs(name.sin6_port);
  } else {
    ::sockaddr_in name{};
    std::memcpy(&name, &storage, sizeof name);
    address.port = ntohs(name.sin_port);
  }
  return fd;
}

}  // namespace tarsier
