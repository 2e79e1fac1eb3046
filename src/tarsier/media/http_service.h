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

// Who may send requests to a server.
struct HttpAccess {
  bool listen_all = false;  // other machines may connect, too; needs a token
  // At least 16 letters, digits or - _ . ~; empty: no token is needed.
  std::string token;
};

// Compares two texts in constant time: the time does not reveal how many characters are equal.
[[nodiscard]] bool equals_in_constant_time(std::string_view given, std::string_view secret);

// Common base of the servers of this program: GET and HEAD over HTTP/1.1; reachable only from this
// machine unless `listen_all`; a token by ?token= or "Authorization: Bearer". Requests with a
// foreign Host (DNS rebinding) or Origin are refused. Security headers restrict what browsers do
// with a response. Each connection has a thread that calls `respond`, which sends a response with
// the functions below.
class HttpService {
 public:
  using Respond = std::function<bool(MHD_Connection* connection, std::string_view path)>;

  // `url` is in the form of parse_listen_address(). Throws UsageError for an address or token that
  // breaks the rules, OutputError if the address cannot be listened on.
  HttpService(const std::string& url, const HttpAccess& access, int max_connections,
              int max_connections_per_address, Respond respond);
  ~HttpService();  // calls stop()
  HttpService(const HttpService&) = delete;
  HttpService& operator=(const HttpService&) = delete;

  void stop();  // cuts open connections
  [[nodiscard]] bool is_running() const;
  // "http://HOST:PORT/", in a form for other machines if they may connect.
  [[nodiscard]] std::string url() const;
  [[nodiscard]] bool is_open_to_all() const;

  // Each sends one response; `send` releases `response`. Bodies are copied.
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
