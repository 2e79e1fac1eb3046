// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/address.h"

#include <cstddef>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::mqtt {

// The version of libmosquitto on this machine ("2.0.11"). Empty if it is missing; `reason` then
// says what to do.
[[nodiscard]] std::string library_version(std::string& reason);

struct Message {
  std::string topic;
  std::string payload;
  bool retained = false;  // the broker had stored it before the subscription
};

struct ConnectionOptions {
  Address address;
  Login login;
  std::string client;          // id; a broker accepts one client per id at a time
  bool keeps_session = false;  // the broker stores messages for this id while it is disconnected
  std::string will_topic;      // empty: no will
  std::string will;            // the broker publishes it, retained, when the connection is lost
  std::size_t max_message = 1'000'000;  // bytes; larger incoming messages are skipped
};

// One connection to a broker, by libmosquitto, at QoS 1. All work happens within the calls; there
// is no thread. A lost connection cannot be reopened; make another object.
class Connection {
 public:
  // Throws Error where libmosquitto is missing, InputError for certificates that cannot be read.
  explicit Connection(const ConnectionOptions& options);
  ~Connection();  // as after a power cut: the broker sends the will
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Returns false on failure; problem() has the reason. Takes a few seconds at most.
  [[nodiscard]] bool open(const std::stop_token& stop);
  // Waits until there is work, at most `timeout_ms`, or until `wake` (a descriptor; -1 for none)
  // is readable. Then does the work.
  void step(int timeout_ms, int wake = -1);
  [[nodiscard]] bool is_open() const;  // the broker accepted the connection and it is not lost
  [[nodiscard]] bool is_over() const;  // refused or lost
  [[nodiscard]] const std::string& problem() const;

  void subscribe(const std::string& topic);
  // Returns the number by which take_acknowledged() reports that the broker has the message.
  int publish(const std::string& topic, const std::string& payload, bool retained);
  [[nodiscard]] std::vector<int> take_acknowledged();
  [[nodiscard]] std::vector<Message> take_messages();
  void close();  // disconnects cleanly: no will is sent

 private:
  class Client;
  std::unique_ptr<Client> client_;
};

}  // namespace tarsier::mqtt
