// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/http_listen.h"

#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

struct MHD_Connection;
struct MHD_Response;

namespace tarsier {

// Who may ask a server.
struct HttpAccess {
  bool listen_all = false;  // other machines, too; needs a token
  std::string token;        // 16 letters, digits or - _ . ~ at least; empty: nobody needs one
};

// Whether both are equal; the time does not tell how many characters were.
[[nodiscard]] bool equals_in_constant_time(std::string_view given, std::string_view secret);

// What servers of this program have in common: GET and HEAD over HTTP/1.1; this machine alone unless
// `listen_all`; a token by ?token= or "Authorization: Bearer"; requests with a foreign Host (DNS
// rebinding) or Origin are refused; headers that keep browsers from reading more into an answer. A
// thread a connection calls `respond`, which sends an answer by the functions below.
class HttpService {
 public:
  using Respond = std::function<bool(MHD_Connection* connection, std::string_view path)>;

  // `url`: as parse_listen_address() takes it. Throws UsageError for an address or token that breaks
  // the rules, OutputError where it cannot be listened on.
  HttpService(const std::string& url, const HttpAccess& access, int max_connections,
              int max_connections_of_one, Respond respond);
  ~HttpService();  // as stop()
  HttpService(const HttpService&) = delete;
  HttpService& operator=(const HttpService&) = delete;

  void stop();  // cuts off what is on its way
  [[nodiscard]] bool is_running() const;
  // "http://HOST:PORT/", as other machines can use it where they may.
  [[nodiscard]] std::string url() const;
  [[nodiscard]] bool is_open_to_all() const;

  // Each sends one answer, and gives `response` up. Bodies are copied.
  static bool send(MHD_Connection* connection, unsigned status, MHD_Response* response);
  static bool send(MHD_Connection* connection, unsigned status, std::string_view body,
                   const char* type);
  static bool refuse(MHD_Connection* connection, unsigned status, std::string_view why,
                     const char* header = nullptr, const char* value = nullptr);
  [[nodiscard]] static std::optional<std::string_view> header_of(MHD_Connection* connection,
                                                                 const char* name);

 private:
  class Daemon;
  std::unique_ptr<Daemon> daemon_;
};

}  // namespace tarsier
