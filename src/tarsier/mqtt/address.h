// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

// Where a broker is and what is published there. MQTT 3.1.1 (OASIS, 2014).
namespace tarsier::mqtt {

// mqtt://[USER[:PASSWORD]@]HOST[:PORT][/TOPIC]; mqtts:// by TLS.
struct Address {
  std::string host;           // a name, an IPv4 or (without brackets) IPv6 address
  std::uint16_t port = 1883;  // 8883 where nothing is said and TLS is used
  bool tls = false;
  std::string user;
  std::string password;
  std::string topic;  // levels of letters, digits and - _ . ; 1..200 bytes; no wildcards
};

// `topic` is the one of an address without one. Throws UsageError naming `what`, passwords masked.
[[nodiscard]] Address parse_address(std::string_view text, std::string_view topic,
                                    std::string_view what);

// "mqtt://host:1883/topic", without user and password.
[[nodiscard]] std::string address_text(const Address& address);

// Whether a name can be a node's: 1..64 letters, digits and - _ .
[[nodiscard]] bool is_node_name(std::string_view name);

// The machine's name as a node's: what cannot stand in one becomes '-'.
[[nodiscard]] std::string machine_node_name();

// How a broker knows a client, beside the user of its address.
struct Login {
  std::string user;           // where the address has none
  std::string password_file;  // its first line; no one else sees it in a list of processes
  std::string ca_file;        // PEM of the authorities to trust; empty: those of the system
  std::string certificate;    // PEM of this client, with `key`
  std::string key;
};

}  // namespace tarsier::mqtt
