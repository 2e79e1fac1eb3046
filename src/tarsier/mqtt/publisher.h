// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/mqtt/address.h"

#include <cstdint>
#include <memory>
#include <string>

namespace tarsier::mqtt {

struct PublisherOptions {
  Address address;  // its topic is the node's: events go to TOPIC/events
  Login login;
  std::string outbox;  // file
  bool home_assistant = false;
  std::string version;         // of the program, for Home Assistant
  std::string kind = "plate";  // of the events, for the same: plate, person, marker or target
  int max_events = 20'000;     // that wait in the outbox; the oldest are dropped
  int window = 500;            // events behind the hub's mark that are sent again at a time
  double resend_s = 20;  // without a mark before they are sent again; doubles up to ten minutes
  double finish_s = 5;   // for what waits, at the end

  [[nodiscard]] OptionFields fields() {
    return {{"max_events", max_events, range(100, 10'000'000), "--outbox-events",
             "maximum number of events in the outbox; beyond, the oldest are dropped"},
            {"window", window, range(1, 100'000)},
            {"resend_s", resend_s, range(0.05, 3600)},
            {"finish_s", finish_s, range(0, 3600)}};
  }
  void check() const { check_fields(*this); }
};

// Says events to a broker. Each is in the outbox, on the disk, when post() returns; a thread sends
// it at QoS 1 to TOPIC/events, and again until a hub has said at TOPIC/acked (retained) that it is
// stored; then it leaves the outbox. What a broker loses, or a node that dies has not sent, comes
// later: a hub gets every event, some of them more than once. TOPIC/state (retained) is
// {"state":"online"}, and by the last will "offline". A broker that is away is waited for, with one
// warning.
class Publisher {
 public:
  // Throws as Outbox and Connection.
  explicit Publisher(const PublisherOptions& options);
  ~Publisher();  // as finish()
  Publisher(const Publisher&) = delete;
  Publisher& operator=(const Publisher&) = delete;

  // A JSON object, one line. Throws OutputError of the outbox.
  void post(const std::string& event);

  // Waits until the broker has what was posted, `patience_s` at most, and goes offline. What waits
  // for a hub stays in the outbox for the next time.
  void finish(double patience_s);

 private:
  class Sender;
  std::unique_ptr<Sender> sender_;
};

// $XDG_STATE_HOME/tarsier/outbox-NAME.db (~/.local/state): where a node's events wait. Throws
// UsageError where neither variable is an absolute path.
[[nodiscard]] std::string default_outbox(const std::string& topic);

}  // namespace tarsier::mqtt
