// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// What the parts of the server answer with: requests, responses, and the table of paths. Nothing
// here knows of sockets; http_server.h does.
namespace tarsier::web {

// Thrown by handlers; answered as {"error": message} with that status. The message is one plain
// line that says what is wrong and what to do.
class HttpError : public std::runtime_error {
 public:
  HttpError(int status, const std::string& message)
      : std::runtime_error(message), status_(status) {}
  [[nodiscard]] int status() const { return status_; }

 private:
  int status_;
};

enum class Access {
  kPublic,    // no sign-in: for answers without data of the user
  kSignedIn,  // the cookie, or the token of the API; changes (not GET) need the CSRF header with
              // the cookie
};

using Headers = std::vector<std::pair<std::string, std::string>>;

// A request whose head has been read, whose Host, Origin and sign-in have been checked, and whose
// body is complete.
struct Request {
  std::string method;  // "GET", "POST", "PUT", "DELETE"; HEAD comes as GET
  std::string path;    // decoded, begins with '/'; no NUL, no "..", no empty segments
  std::map<std::string, std::string> params;               // of {name} in the route
  std::vector<std::pair<std::string, std::string>> query;  // decoded, in their order
  Headers headers;                                         // names in lower case
  std::string content_type;  // lower case, without parameters: "application/json"
  std::string body;          // empty where it was spooled
  std::string body_file;     // RouteOptions::spool: its path; removed after the handler, which may
                             // rename or link it away
  std::uint64_t body_bytes = 0;
  std::string address;        // of the client, without port; behind a proxy: as the proxy tells
  bool by_api_token = false;  // a program, not a browser

  [[nodiscard]] std::string_view header(std::string_view lower_case_name) const;  // "" if absent
  [[nodiscard]] std::optional<std::string> query_value(std::string_view name) const;  // the first
  [[nodiscard]] const std::string& param(const std::string& name) const;  // of the route's pattern
  // The body as a JSON object; HttpError 400 for anything else, 415 for another content type.
  [[nodiscard]] nlohmann::json json() const;
};

// A body that is made while it is sent. read() runs in the connection's own thread.
class BodyStream {
 public:
  virtual ~BodyStream() = default;
  // Writes the next bytes into `buffer`. 0: none yet (read() has waited up to about 0.5 s itself and
  // is called again); -1: the end. `socket` is the client's, for poll() alone.
  [[nodiscard]] virtual std::ptrdiff_t read(std::span<char> buffer, int socket) = 0;
  // Without chunks, for the simplest clients.
  [[nodiscard]] virtual bool is_plain() const { return false; }
};

struct Response {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  std::string_view memory;             // instead of body: bytes that live as long as the program
  std::string file;                    // instead of body: a path; single byte ranges are answered
  std::unique_ptr<BodyStream> stream;  // instead of body; ends the connection with it
  Headers headers;
};

// {"a": 1}; invalid UTF-8 in strings (names of files) is replaced, never an error.
[[nodiscard]] Response json_response(const nlohmann::json& value, int status = 200);
[[nodiscard]] Response error_response(int status, std::string_view message);
[[nodiscard]] Response no_content();  // 204
[[nodiscard]] std::string to_text(const nlohmann::json& value);

// A member of a JSON object, with its type checked: HttpError 400 that names it.
[[nodiscard]] std::string text_member(const nlohmann::json& object, const std::string& name);
[[nodiscard]] std::optional<std::string> optional_text(const nlohmann::json& object,
                                                       const std::string& name);
[[nodiscard]] std::vector<std::string> text_list(const nlohmann::json& object,
                                                 const std::string& name);  // absent: empty

using Handler = std::function<Response(const Request&)>;

struct RouteOptions {
  std::uint64_t max_body =
      64 << 10;        // bytes; larger ones are refused with 413 before they are read
  bool spool = false;  // the body goes to a file (Request::body_file)
  std::vector<std::string> types = {"application/json"};  // of a body; empty: any
};

// A table of patterns: "/api/jobs/{id}" takes one segment, "/api/jobs/{id}/files/{path...}" the
// rest (at least one character). More literal patterns go first, whatever their order of adding.
class Router {
 public:
  // Throws std::invalid_argument for a pattern that is there already, or malformed.
  void add(const std::string& method, const std::string& pattern, Handler handler,
           Access access = Access::kSignedIn, RouteOptions options = {});

  struct Route {
    std::string method;
    std::string pattern;
    Access access = Access::kSignedIn;
    RouteOptions options;
    Handler handler;
  };
  struct Match {
    const Route* route = nullptr;  // nullptr: 404, or 405 where `allowed` is not empty
    std::map<std::string, std::string> params;
    std::string allowed;  // "GET, POST"
  };
  [[nodiscard]] Match find(std::string_view method, std::string_view path) const;
  // All, in the order of adding.
  [[nodiscard]] std::vector<const Route*> routes() const;

 private:
  std::vector<std::unique_ptr<Route>> routes_;
};

// "%41b+c" as "Ab+c" (of a path) or "Ab c" (of a query); nothing where it is malformed, or holds
// NUL.
[[nodiscard]] std::optional<std::string> percent_decoded(std::string_view text, bool of_query);
// "a=1&b=%20"; nothing where it is malformed or has more than 256 fields.
[[nodiscard]] std::optional<std::vector<std::pair<std::string, std::string>>> parse_query(
    std::string_view text);

}  // namespace tarsier::web
