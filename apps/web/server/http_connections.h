// SPDX-License-Identifier: MIT
#pragma once

#include "http_server.h"
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <set>
#include <string>
#include <thread>

struct sockaddr;

namespace tarsier::web {

enum class Phase { kFirstHead, kIdle, kHead, kBody, kHandler, kResponse, kStream };

struct Connection {
  int socket = -1;
  std::string address;
  Phase phase = Phase::kFirstHead;
  std::chrono::steady_clock::time_point since;
  std::chrono::steady_clock::time_point deadline;
  bool signed_in = false;
  bool is_ended = false;  // we shut it down
};

// The open connections. Each phase of a connection has a time limit. If there are too many
// connections, one is closed for a new one. Thread-safe.
class HttpConnections {
 public:
  HttpConnections(const HttpServerOptions& options, HttpCounters& counters)
      : options_(options), counters_(counters) {}
  ~HttpConnections() { close(); }
  HttpConnections(const HttpConnections&) = delete;
  HttpConnections& operator=(const HttpConnections&) = delete;

  void start();  // starts the thread that closes connections after their time limit
  // Adds an accepted connection, which may be closed at once. remove() deletes it.
  [[nodiscard]] Connection* add(int socket, const sockaddr* from);
  void remove(Connection* connection);
  // Sets the phase and its time limit; 0: no limit. A null connection is ignored.
  void enter(Connection* connection, Phase phase, double timeout_s);
  // A request line arrived: its head must be complete head_s from now; for the first request head_s
  // counts from the beginning.
  void begin_head(Connection* connection);
  void set_signed_in(Connection& connection, bool signed_in);

  // From now on every new connection is closed at once.
  void close();
  [[nodiscard]] bool is_closing() const;
  // Closes all connections and waits until they are gone, at most `timeout`.
  void end_all(std::chrono::milliseconds timeout);

 private:
  using Clock = std::chrono::steady_clock;
  // Call these with the mutex held.
  void end(Connection& connection);
  Connection* to_evict(const std::string* address, const Connection* except);
  void make_room(Connection& added);
  void run_watchdog();

  const HttpServerOptions& options_;
  HttpCounters& counters_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::set<Connection*> connections_;
  bool closing_ = false;
  std::thread watchdog_;
};

}  // namespace tarsier::web
