// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/address.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/frame_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <unistd.h>

namespace tarsier::mqtt {
namespace {

constexpr std::size_t kMaxTopic = 200;
constexpr std::size_t kMaxHost = 253;
constexpr std::size_t kMaxNode = 64;

bool is_word(char c) {
  return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
         c == '_' || c == '.';
}

bool is_topic(std::string_view topic) {
  if (topic.empty() || topic.size() > kMaxTopic || topic.front() == '/' || topic.back() == '/')
    return false;
  if (topic.find("//") != std::string_view::npos) return false;
  return std::all_of(topic.begin(), topic.end(), [](char c) { return is_word(c) || c == '/'; });
}

int hex_value(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

// Decodes "%40" to '@'. Throws for an invalid number or a control character.
std::string decoded(std::string_view text) {
  std::string result;
  for (std::size_t k = 0; k < text.size(); ++k) {
    int value = static_cast<unsigned char>(text[k]);
    if (text[k] == '%') {
      const int high = k + 2 < text.size() ? hex_value(text[k + 1]) : -1;
      const int low = high >= 0 ? hex_value(text[k + 2]) : -1;
      if (low < 0) throw UsageError("'%' begins two hexadecimal digits: %40 is '@'");
      value = 16 * high + low;
      k += 2;
    }
    if (value < 0x20 || value == 0x7F) throw UsageError("control characters are not expected");
    result += static_cast<char>(value);
  }
  return result;
}

Address parsed(std::string_view text, std::string_view topic) {
  constexpr std::string_view kPlain = "mqtt://";
  constexpr std::string_view kTls = "mqtts://";
  Address address;
  if (text.starts_with(kTls)) {
    address.tls = true;
    text.remove_prefix(kTls.size());
  } else if (text.starts_with(kPlain)) {
    text.remove_prefix(kPlain.size());
  } else {
    throw UsageError("expected mqtt://HOST[:PORT]/TOPIC, or mqtts:// for TLS");
  }
  const std::size_t slash = text.find('/');
  std::string_view authority = text.substr(0, slash);
  address.topic = slash == std::string_view::npos || slash + 1 == text.size()
                      ? std::string(topic)
                      : std::string(text.substr(slash + 1));
  if (const std::size_t at = authority.rfind('@'); at != std::string_view::npos) {
    const std::string_view login = authority.substr(0, at);
    const std::size_t colon = login.find(':');
    address.user = decoded(login.substr(0, colon));
    if (colon != std::string_view::npos) address.password = decoded(login.substr(colon + 1));
    authority.remove_prefix(at + 1);
  }
  address.port = address.tls ? 8883 : 1883;
  std::string_view port;
  if (authority.starts_with('[')) {
    const std::size_t end = authority.find(']');
    if (end == std::string_view::npos) throw UsageError("a ']' is missing");
    address.host = authority.substr(1, end - 1);
    port = authority.substr(end + 1);
  } else {
    const std::size_t colon = authority.find(':');
    address.host = authority.substr(0, colon);
    if (colon != std::string_view::npos) port = authority.substr(colon);
  }
  if (!port.empty()) {
    const auto number = port.front() == ':' ? to_integer(port.substr(1), 1, 65535) : std::nullopt;
    if (!number) throw UsageError("the port is expected to be 1..65535");
    address.port = static_cast<std::uint16_t>(*number);
  }
  const bool is_host = !address.host.empty() && address.host.size() <= kMaxHost &&
                       std::all_of(address.host.begin(), address.host.end(),
                                   [](char c) { return is_word(c) || c == ':' || c == '%'; });
  if (!is_host) throw UsageError("the host is missing, or has other characters than a name's");
  if (!is_topic(address.topic)) {
    throw UsageError(fmt::format(
        "the topic is expected to be 1..{} letters, digits and - _ . with / between its levels",
        kMaxTopic));
  }
  return address;
}

}  // namespace

Address parse_address(std::string_view text, std::string_view topic, std::string_view what) {
  try {
    return parsed(text, topic);
  } catch (const UsageError& error) {
    throw UsageError(
        fmt::format("{} '{}': {}", what, printable(masked(text).substr(0, 300)), error.what()));
  }
}

std::string address_text(const Address& address) {
  const bool is_number = address.host.find(':') != std::string::npos;
  return fmt::format("{}://{}{}{}:{}/{}", address.tls ? "mqtts" : "mqtt", is_number ? "[" : "",
                     address.host, is_number ? "]" : "", address.port, address.topic);
}

bool is_node_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxNode && std::all_of(name.begin(), name.end(), is_word);
}

std::string machine_node_name() {
  char buffer[256] = {};
  if (::gethostname(buffer, sizeof buffer - 1) != 0) return "node";
  std::string name = std::string(buffer).substr(0, kMaxNode);
  std::replace_if(
      name.begin(), name.end(), [](char c) { return !is_word(c); }, '-');
  return name.empty() ? "node" : name;
}

}  // namespace tarsier::mqtt
