// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// Requests, responses, and the table of paths. Nothing here uses sockets; http_server.h does.
namespace tarsier::web {

// Thrown by handlers; sent as {"error": message} with the status. The message is one plain line
// that says what is wrong and what to do.
class HttpError : public std::runtime_error {
 public:
  HttpError(int status, const std::string& message)
      : std::runtime_error(message), status_(status) {}
  [[nodiscard]] int status() const { return status_; }

 private:
  int status_;
};

enum class Access {
  kPublic,  // no sign-in: for responses without user data
  // Needs the cookie or the API token; changes (not GET) need the CSRF header with the cookie.
  kSignedIn,
};

using Headers = std::vector<std::pair<std::string, std::string>>;

// A request whose head was read, whose Host, Origin and sign-in were checked, and whose body is
// complete.
struct Request {
  std::string method;  // "GET", "POST", "PUT", "DELETE"; HEAD is passed as GET
  std::string path;    // decoded, begins with '/'; no NUL, no "..", no empty segments
  std::map<std::string, std::string> params;               // values of {name} in the route
  std::vector<std::pair<std::string, std::string>> query;  // decoded, in order
  Headers headers;                                         // names in lower case
  std::string content_type;  // lower case, without parameters: "application/json"
  std::string body;          // empty if it was spooled
  // RouteOptions::spool: path of the body. It is removed after the handler, which may rename or
  // link it.
  std::string body_file;
  std::uint64_t body_bytes = 0;
  // Of the client, without port; behind a proxy: as reported by the proxy.
  std::string address;
  bool by_api_token = false;  // a program, not a browser

  [[nodiscard]] std::string_view header(std::string_view lower_case_name) const;  // "" if absent
  [[nodiscard]] std::optional<std::string> query_value(std::string_view name) const;  // the first
  // from the route's pattern
  [[nodiscard]] const std::string& param(const std::string& name) const;
  // The body as a JSON object; HttpError 400 if it is not one, 415 for another content type.
  [[nodiscard]] nlohmann::json json() const;
};

// A body that is generated while it is sent. read() runs in the connection's own thread.
class BodyStream {
 public:
  virtual ~BodyStream() = default;
  // Writes the next bytes to `buffer`. Returns 0 if there are none yet (read() waits itself up to
  // about 0.5 s and is called again), -1 at the end. `socket` is the client's, only for poll().
  [[nodiscard]] virtual std::ptrdiff_t read(std::span<char> buffer, int socket) = 0;
  // Whether the body is sent without chunks, for very simple clients.
  [[nodiscard]] virtual bool is_plain() const { return false; }
};

struct Response {
  int status = 200;
  std::string type = "application/json";
  std::string body;
  // Instead of body: bytes that live as long as the program.
  std::string_view memory;
  // Instead of body: a path; single byte ranges are supported.
  std::string file;
  std::unique_ptr<BodyStream> stream;  // instead of body; closes the connection at its end
  Headers headers;
};

// {"a": 1}; invalid UTF-8 in strings (file names) is replaced and is not an error.
[[nodiscard]] Response json_response(const nlohmann::json& value, int status = 200);
[[nodiscard]] Response error_response(int status, std::string_view message);
[[nodiscard]] Response no_content();  // 204
[[nodiscard]] std::string to_text(const nlohmann::json& value);

// A member of a JSON object, with its type checked. HttpError 400 names the member.
[[nodiscard]] std::string text_member(const nlohmann::json& object, const std::string& name);
[[nodiscard]] std::optional<std::string> optional_text(const nlohmann::json& object,
                                                       const std::string& name);

using Handler = std::function<Response(const Request&)>;

struct RouteOptions {
  // Bytes; larger bodies are refused with 413 before they are read.
  std::uint64_t max_body = 64 << 10;
  bool spool = false;  // the body is stored as a file (Request::body_file)
  std::vector<std::string> types = {"application/json"};  // allowed types of a body; empty: any
};

// A table of patterns: "/api/jobs/{id}" matches one segment, "/api/jobs/{id}/files/{path...}" the
// rest (at least one character). More literal patterns take precedence, whatever the order of
// adding.
class Router {
 public:
  // Throws std::invalid_argument for a pattern that is malformed or exists already.
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
    const Route* route = nullptr;  // nullptr: 404, or 405 if `allowed` is not empty
    std::map<std::string, std::string> params;
    std::string allowed;  // "GET, POST"
  };
  [[nodiscard]] Match find(std::string_view method, std::string_view path) const;
  // All routes, in the order of adding.
  [[nodiscard]] std::vector<const Route*> routes() const;

 private:
  std::vector<std::unique_ptr<Route>> routes_;
};

// Decodes "%41b+c" to "Ab+c" (path) or "Ab c" (query); nullopt if it is malformed or contains NUL.
[[nodiscard]] std::optional<std::string> percent_decoded(std::string_view text, bool of_query);
// Parses "a=1&b=%20"; nullopt if it is malformed or has more than 256 fields.
[[nodiscard]] std::optional<std::vector<std::pair<std::string, std::string>>> parse_query(
    std::string_view text);

}  // namespace tarsier::web
