// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/mqtt/address.h"

#include <cstdint>
#include <memory>
#include <string>

namespace tarsier::mqtt {

struct PublisherOptions {
  Address address;  // its topic is the node's: events are published at TOPIC/events
  Login login;
  std::string outbox;  // path of the file
  bool home_assistant = false;
  std::string version;         // of the program; for Home Assistant
  std::string kind = "plate";  // of the events, for Home Assistant: plate, person, marker or target
  int max_events = 20'000;     // in the outbox; beyond that the oldest are dropped
  int window = 500;            // max. events after the hub's mark that are resent at a time
  // s without a new mark until events are resent; doubles up to ten minutes.
  double resend_s = 20;
  // s for waiting events at the end.
  double finish_s = 5;

  [[nodiscard]] OptionFields fields() {
    return {{"max_events", max_events, range(100, 10'000'000), "--outbox-events",
             "maximum number of events in the outbox; beyond, the oldest are dropped"},
            {"window", window, range(1, 100'000)},
            {"resend_s", resend_s, range(0.05, 3600)},
            {"finish_s", finish_s, range(0, 3600)}};
  }
  void check() const { check_fields(*this); }
};

// Publishes events to a broker. When post() returns, the event is in the outbox on the disk. A
// thread sends it at QoS 1 to TOPIC/events, repeatedly until a hub has reported at TOPIC/acked
// (retained) that it is stored; then it is deleted from the outbox. Events that a broker loses, or
// that a node could not send before it stopped, are sent later. So a hub gets every event at least
// once. TOPIC/state (retained) is {"state":"online"}; the last will changes it to "offline". The
// thread waits for a broker that is not available, with one warning.
class Publisher {
 public:
  // Throws as Outbox and Connection do.
  explicit Publisher(const PublisherOptions& options);
  ~Publisher();  // calls finish()
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  // `event` is a JSON object in one line. Throws OutputError of the outbox.
  void post(const std::string& event);

  // Waits at most `timeout_s` until the broker has the posted events, then goes offline. Events
  // that no hub has confirmed stay in the outbox for the next run.
  void finish(double timeout_s);

 private:
  class Sender;
  std::unique_ptr<Sender> sender_;
};

// The default outbox file of a node: $XDG_STATE_HOME/tarsier/outbox-NAME.db (~/.local/state).
// Throws UsageError if neither variable is an absolute path.
[[nodiscard]] std::string default_outbox(const std::string& topic);

}  // namespace tarsier::mqtt
