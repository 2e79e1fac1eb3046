// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/mqtt/address.h"

#include <cstddef>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::mqtt {

// Whether this machine has libmosquitto: its version ("2.0.11"), or an empty string; `reason` then
// says what to do.
[[nodiscard]] std::string library_version(std::string& reason);

struct Message {
  std::string topic;
  std::string payload;
  bool retained = false;  // it was there before we came
};

struct ConnectionOptions {
  Address address;
  Login login;
  std::string client;                   // id; a broker has one client of an id at a time
  bool keeps_session = false;           // the broker keeps what comes for this id while it is away
  std::string will_topic;               // empty: no will
  std::string will;                     // retained by the broker when the connection is lost
  std::size_t max_message = 1'000'000;  // bytes; larger ones that come are passed over
};

// One connection to a broker, by libmosquitto, at QoS 1. Everything happens within the calls: no
// thread. Where the connection is lost it is over; make another one.
class Connection {
 public:
  // Throws Error where libmosquitto is missing, InputError for certificates that cannot be read.
  explicit Connection(const ConnectionOptions& options);
  ~Connection();  // as if the power went: the will is sent
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // False: `problem()` says why. Takes a few seconds at most.
  [[nodiscard]] bool open(const std::stop_token& stop);
  // Waits until there is something to do, `patience_ms` at most, or until `wake` (a descriptor; -1
  // for none) can be read; and does it.
  void step(int patience_ms, int wake = -1);
  [[nodiscard]] bool is_open() const;  // the broker has taken us and has not been lost since
  [[nodiscard]] bool is_over() const;  // refused or lost
  [[nodiscard]] const std::string& problem() const;

  void subscribe(const std::string& topic);
  // Returns the number by which take_acknowledged() tells that the broker has it.
  int publish(const std::string& topic, const std::string& payload, bool retained);
  [[nodiscard]] std::vector<int> take_acknowledged();
  [[nodiscard]] std::vector<Message> take_messages();
  void close();  // says goodbye: no will

 private:
  class Client;
  std::unique_ptr<Client> client_;
};

}  // namespace tarsier::mqtt
