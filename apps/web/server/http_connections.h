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

enum class Phase { kFirstHead, kIdle, kHead, kBody, kHandler, kAnswer, kStream };

struct Connection {
  int socket = -1;
  std::string address;
  Phase phase = Phase::kFirstHead;
  std::chrono::steady_clock::time_point since;
  std::chrono::steady_clock::time_point deadline;
  bool signed_in = false;
  bool is_ended = false;  // shut down by us
};

// The open connections: each has so much time for what it is doing, and where there are too many,
// one makes room. Thread-safe.
class HttpConnections {
 public:
  HttpConnections(const HttpServerOptions& options, HttpCounters& counters)
      : options_(options), counters_(counters) {}
  ~HttpConnections() { close(); }
  HttpConnections(const HttpConnections&) = delete;
  HttpConnections& operator=(const HttpConnections&) = delete;

  void start();  // the thread that closes those whose time is over
  // One that was accepted; it may be closed at once. remove() takes it back.
  [[nodiscard]] Connection* add(int socket, const sockaddr* from);
  void remove(Connection* connection);
  // What it does now, and how long it may; 0: for ever. Null is passed over.
  void enter(Connection* connection, Phase phase, double patience_s);
  // A request line is here: its head has head_s from now, of the first request from the beginning.
  void begin_head(Connection* connection);
  void set_signed_in(Connection& connection, bool signed_in);

  // From now on every connection is closed as it comes.
  void close();
  [[nodiscard]] bool is_closing() const;
  // Closes all, and waits until they are gone, `patience` at most.
  void end_all(std::chrono::milliseconds patience);

 private:
  using Clock = std::chrono::steady_clock;
  // With the mutex held.
  void end(Connection& connection);
  Connection* to_evict(const std::string* address, const Connection* except);
  void make_room(Connection& fresh);
  void keep();

  const HttpServerOptions& options_;
  HttpCounters& counters_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::set<Connection*> connections_;
  bool closing_ = false;
  std::thread keeper_;
};

}  // namespace tarsier::web
