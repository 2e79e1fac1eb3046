// SPDX-License-Identifier: MIT
#pragma once

#include "audit_log.h"
#include "origin_rules.h"
#include "router.h"
#include "sign_in.h"
#include <array>
#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::web {

struct HttpServerOptions {
  std::vector<int> sockets;     // listening sockets; the server closes them
  std::string tls_certificate;  // PEM; empty: plain HTTP
  std::string tls_key;
  OriginRules rules;
  std::string spool_folder;  // for bodies stored as files; on the workspace's file system
  unsigned max_connections = 256;
  // Behind a proxy, which has a single address: max_connections.
  unsigned max_per_address = 64;
  double head_s = 10;     // s for the whole head of a request
  double idle_s = 60;     // s for a connection without a request
  unsigned stall_s = 60;  // s without any transfer to or from the client
  double body_s = 20;     // s for a body, plus 1 s for each 16 kB of it
};

// Counters of the server for /metrics and /api/info.
struct HttpCounters {
  std::atomic<std::uint64_t> open{0};  // open now
  std::atomic<std::uint64_t> requests{0};
  std::atomic<std::uint64_t> refused{0};  // answered with 400..499
  std::atomic<std::uint64_t> failed{0};   // answered with 500..599
  std::atomic<std::uint64_t> evicted{0};  // closed because they were slow, or for a new connection
  std::atomic<std::uint64_t> bytes{0};    // bytes of sent bodies
};

// HTTP/1.1 over libmicrohttpd, with one thread per connection. Every request is checked before a
// handler sees it, in this order: the form of its path; Host, Origin and Sec-Fetch-Site
// (OriginRules); the route (404, 405); the sign-in (401); for changes the CSRF header (403); the
// type (415) and length (411, 413) of its body. Every response has headers that keep pages from
// loading or running foreign content. A handler's HttpError, UsageError (400) and other errors
// (500) become {"error": ..}.
//
// Connections that are slow with a request are closed. If there are too many, in total or of one
// address, the oldest one that is not being answered is closed for the new one.
class HttpServer {
 public:
  // Throws OutputError if libmicrohttpd cannot start (an invalid certificate, too few threads).
  HttpServer(HttpServerOptions options, const Router& router, SignIns& sign_ins, AuditLog& audit);
  ~HttpServer();  // calls stop()
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // Closes every connection within about 0.3 s; streams end. Handlers that wait must be asked to
  // end before this call.
  void stop();
  [[nodiscard]] const HttpCounters& counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Adds the routes GET, POST and DELETE /api/session, which need more than a Request. `version` is
// public.
void add_session_routes(Router& router, SignIns& sign_ins, AuditLog& audit, bool secure_cookie,
                        std::string version);

}  // namespace tarsier::web
