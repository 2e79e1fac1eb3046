// SPDX-License-Identifier: MIT
#include "tarsier/mqtt/hub.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/mqtt/connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <set>
#include <utility>

namespace tarsier::mqtt {
namespace {

constexpr std::size_t kMaxTransactionMessages = 500;  // messages per transaction

std::int64_t now_ms() {
  return std::chrono::duration_cast<std::chrono::milliseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

std::string node_of(const std::string& topic, const std::string& parent) {
  constexpr std::string_view kEnd = "/events";
  if (!topic.starts_with(parent + '/') || !topic.ends_with(kEnd) ||
      topic.size() <= parent.size() + 1 + kEnd.size())
    return {};
  const std::string node =
      topic.substr(parent.size() + 1, topic.size() - parent.size() - 1 - kEnd.size());
  return is_node_name(node) ? node : std::string();
}

void run_hub(HubLog& log, const HubOptions& options, const std::stop_token& stop) {
  sigset_t pipe;
  sigemptyset(&pipe);
  sigaddset(&pipe, SIGPIPE);
  ::pthread_sigmask(SIG_BLOCK, &pipe, nullptr);
  const std::string& parent = options.address.topic;
  ConnectionOptions connection_options;
  connection_options.address = options.address;
  connection_options.login = options.login;
  connection_options.client = "tarsier-hub-" + log.id().substr(0, 8);
  connection_options.keeps_session = true;
  std::chrono::milliseconds retry{500};
  bool warned = false;
  bool warned_of_invalid = false;
  while (!stop.stop_requested()) {
    Connection connection(connection_options);
    if (connection.open(stop)) {
      log_info("{}: stores the events of {}/+", address_text(options.address), parent);
      warned = false;
      retry = std::chrono::milliseconds(500);
      connection.subscribe(parent + "/+/events");
      for (const auto& [node, mark] : log.marks())
        connection.publish(parent + '/' + node + "/acked", mark_text(mark), true);
      while (connection.is_open() && !stop.stop_requested()) {
        connection.step(200);
        // One transaction for all messages that have arrived.
        std::vector<Message> messages = connection.take_messages();
        for (std::size_t before = 0;
             messages.size() > before && messages.size() < kMaxTransactionMessages;) {
          before = messages.size();
          connection.step(0);
          for (Message& message : connection.take_messages())
            messages.push_back(std::move(message));
        }
        std::vector<HubLog::Received> received;
        for (const Message& message : messages) {
          const std::string node = node_of(message.topic, parent);
          auto event = parse_event_message(message.payload);
          if (node.empty() || !event) {
            if (!std::exchange(warned_of_invalid, true))
              log_warning("{}: not an event of a node, skipped", printable(message.topic));
            continue;
          }
          received.push_back({node, std::move(*event)});
        }
        (void)connection.take_acknowledged();
        if (received.empty()) continue;
        const std::vector<bool> is_new = log.store(received, now_ms());
        std::set<std::pair<std::string, std::string>> outboxes;
        for (std::size_t k = 0; k < received.size(); ++k) {
          outboxes.emplace(received[k].node, received[k].message.outbox);
          if (is_new[k] && options.on_event)
            options.on_event(received[k].node, received[k].message.event);
        }
        for (const auto& [node, outbox] : outboxes) {
          connection.publish(parent + '/' + node + "/acked",
                             mark_text({outbox, log.mark(node, outbox)}), true);
        }
      }
      if (stop.stop_requested()) connection.close();
    }
    if (stop.stop_requested()) break;
    if (!std::exchange(warned, true)) {
      log_warning("{}: {}; waiting for it", address_text(options.address), connection.problem());
    }
    (void)sleep_unless_stopped(retry, stop);
    retry = std::min(2 * retry, std::chrono::milliseconds(10'000));
  }
}

}  // namespace tarsier::mqtt
