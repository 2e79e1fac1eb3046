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
  std::vector<int> sockets;     // that listen; closed by the server
  std::string tls_certificate;  // PEM; empty: plain HTTP
  std::string tls_key;
  OriginRules rules;
  std::string spool_folder;  // for bodies that go to files; on the workspace's file system
  unsigned max_connections = 256;
  unsigned max_per_address = 64;  // behind a proxy, which is one address: max_connections
  double head_s = 10;             // for all of a request's head
  double idle_s = 60;             // of a connection without a request
  unsigned stall_s = 60;          // of a client that neither sends nor takes a byte
  double body_s = 20;             // for a body, and 1 s more for each 16 kB of it
};

// What the server did so far, for /metrics and /api/info.
struct HttpCounters {
  std::atomic<std::uint64_t> connections{0};  // accepted
  std::atomic<std::uint64_t> open{0};         // now
  std::atomic<std::uint64_t> requests{0};
  std::atomic<std::uint64_t> refused{0};  // answered with 400..499
  std::atomic<std::uint64_t> failed{0};   // answered with 500..599
  std::atomic<std::uint64_t> evicted{0};  // closed for their slowness, or to make room
  std::atomic<std::uint64_t> bytes{0};    // of bodies that were sent
};

// HTTP/1.1 over libmicrohttpd, a thread for each connection. Every request is checked, in this
// order, before a handler sees it: the shape of its path, Host, Origin and Sec-Fetch-Site
// (OriginRules), the route (404, 405), the sign-in (401), for changes the CSRF header (403), the
// type (415) and length (411, 413) of its body. Every answer carries the headers that keep a page
// from loading or running what is not ours. A handler's HttpError, UsageError (400) and other
// errors (500) become {"error": ..}.
//
// Connections that are slow with a request are closed; where there are too many, of one address or
// in all, the oldest that is not being answered makes room for a new one.
class HttpServer {
 public:
  // Throws OutputError where libmicrohttpd cannot start (a broken certificate, too few threads).
  HttpServer(HttpServerOptions options, const Router& router, SignIns& sign_ins, AuditLog& audit);
  ~HttpServer();  // stop()
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // Ends every connection within about 0.3 s; streams meet their end. Handlers that wait must have
  // been asked to end before.
  void stop();
  [[nodiscard]] const HttpCounters& counters() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The routes GET, POST and DELETE /api/session, which need more than a Request. `version` is shown
// to everybody.
void add_session_routes(Router& router, SignIns& sign_ins, AuditLog& audit, bool secure_cookie,
                        std::string version);

}  // namespace tarsier::web
