// SPDX-License-Identifier: MIT
#pragma once

#include "http_server.h"
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>
#include <unistd.h>

namespace tarsier::web {

// A request that is being received.
struct PendingRequest {
  std::string target;  // as in the request line
  bool has_begun = false;
  Request request;
  const Router::Route* route = nullptr;
  std::optional<Response> refusal;  // sent after the body was read
  std::uint64_t expected = 0;       // bytes of the body
  int spool = -1;
  std::string spool_path;

  PendingRequest() = default;
  PendingRequest(const PendingRequest&) = delete;
  PendingRequest& operator=(const PendingRequest&) = delete;
  ~PendingRequest() {
    if (spool >= 0) ::close(spool);
    if (!spool_path.empty()) (void)::unlink(spool_path.c_str());
  }
};

// The checks of a request's head, in the order given in http_server.h. Thread-safe.
class HttpChecks {
 public:
  HttpChecks(const HttpServerOptions& options, const Router& router, SignIns& sign_ins,
             AuditLog& audit)
      : options_(options), router_(router), sign_ins_(sign_ins), audit_(audit) {}

  // The reason why the request is refused, or nullopt; fills `pending`.
  [[nodiscard]] std::optional<Response> refusal(PendingRequest& pending);

 private:
  [[nodiscard]] bool behind_proxy() const { return !options_.rules.proxy_origin.empty(); }
  std::optional<Response> check_access(Request& request, const Router::Route& route);
  std::optional<Response> check_body(PendingRequest& pending, bool has_length) const;

  const HttpServerOptions& options_;
  const Router& router_;
  SignIns& sign_ins_;
  AuditLog& audit_;
  RateLimit bearer_tries_{10, std::chrono::seconds(60)};
};

}  // namespace tarsier::web
