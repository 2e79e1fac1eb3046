// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

// The address of a broker and the topics published there. MQTT 3.1.1 (OASIS, 2014).
namespace tarsier::mqtt {

// mqtt://[USER[:PASSWORD]@]HOST[:PORT][/TOPIC]; mqtts:// for TLS.
struct Address {
  std::string host;           // a name, an IPv4 or (without brackets) IPv6 address
  std::uint16_t port = 1883;  // 8883 by default for TLS
  bool tls = false;
  std::string user;
  std::string password;
  std::string topic;  // levels of letters, digits and - _ . ; 1..200 bytes; no wildcards
};

// `topic` is used for an address without one. Throws UsageError that names `what`, passwords
// masked.
[[nodiscard]] Address parse_address(std::string_view text, std::string_view topic,
                                    std::string_view what);

// "mqtt://host:1883/topic", without user and password.
[[nodiscard]] std::string address_text(const Address& address);

// Whether a text is a valid node name: 1..64 letters, digits and - _ .
[[nodiscard]] bool is_node_name(std::string_view name);

// The machine's name as a node name: invalid characters become '-'.
[[nodiscard]] std::string machine_node_name();

// A client's credentials at a broker, in addition to the user of its address.
struct Login {
  std::string user;  // used if the address has none
  // its first line is the password; so it is not visible in process lists
  std::string password_file;
  std::string ca_file;      // PEM of the trusted authorities; empty: those of the system
  std::string certificate;  // PEM of this client, with `key`
  std::string key;
};

}  // namespace tarsier::mqtt
