// SPDX-License-Identifier: MIT
#include "http_checks.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/http_service.h"

#include <fmt/format.h>

#include "request_target.h"
#include "secrets.h"
#include <algorithm>
#include <arpa/inet.h>
#include <array>
#include <cerrno>
#include <fcntl.h>
#include <utility>

namespace tarsier::web {
namespace {

bool is_change(std::string_view method) { return method != "GET"; }

OriginRules::Head head_of(const Request& request) {
  OriginRules::Head head;
  head.method = request.method;
  head.path = request.path;
  head.host = request.header("host");
  head.origin = request.header("origin");
  head.fetch_site = request.header("sec-fetch-site");
  head.fetch_mode = request.header("sec-fetch-mode");
  head.fetch_dest = request.header("sec-fetch-dest");
  return head;
}

// The client as seen by the proxy: the last word of X-Forwarded-For, the only one that it
// guarantees.
std::string forwarded(const Request& request) {
  const std::string_view all = request.header("x-forwarded-for");
  const std::string last(trimmed(all.substr(all.find_last_of(',') + 1)));
  std::array<unsigned char, 16> bytes{};
  const bool is_address = ::inet_pton(AF_INET, last.c_str(), bytes.data()) == 1 ||
                          ::inet_pton(AF_INET6, last.c_str(), bytes.data()) == 1;
  return is_address ? last : request.address;
}

Response unauthorized(std::string_view message) {
  Response response = error_response(401, message);
  response.headers.emplace_back("WWW-Authenticate", "Bearer");
  return response;
}

// The refusal of a request with a second length, host or authorization: a proxy may use the other
// one.
std::optional<Response> repeated_field(const Request& request) {
  for (const std::string_view name :
       {"content-length", "host", "transfer-encoding", "authorization"}) {
    const auto count = std::count_if(request.headers.begin(), request.headers.end(),
                                     [&](const auto& field) { return field.first == name; });
    if (count < 2) continue;
    Response response =
        error_response(400, fmt::format("the header field {} is given {} times", name, count));
    response.headers.emplace_back("Connection", "close");
    return response;
  }
  return std::nullopt;
}

Response too_many(int wait) {
  Response response = error_response(429, fmt::format("too many attempts; wait {} s", wait));
  response.headers.emplace_back("Retry-After", std::to_string(wait));
  return response;
}

}  // namespace

std::optional<Response> HttpChecks::refusal(PendingRequest& pending) {
  Request& request = pending.request;
  // Without a length, so the body is not read.
  if (auto repeated = repeated_field(request)) return repeated;
  const std::string_view length = request.header("content-length");
  const auto bytes = to_integer(length, 0, std::int64_t{1} << 50);
  if (bytes) pending.expected = static_cast<std::uint64_t>(*bytes);
  request.body_bytes = 0;

  const auto target = parse_target(pending.target);
  if (!target) return error_response(400, "this path is malformed");
  request.path = target->path;
  if (const auto foreign = options_.rules.refusal(head_of(request)))
    return error_response(foreign->status, foreign->message);
  if (behind_proxy()) request.address = forwarded(request);
  auto query = parse_query(target->query);
  if (!query) return error_response(400, "the query of this address is malformed");
  request.query = std::move(*query);

  Router::Match match = router_.find(request.method, request.path);
  if (match.route == nullptr && match.allowed.empty())
    return error_response(404, "no such address; /api/openapi.json lists them all");
  if (match.route == nullptr) {
    Response response = error_response(405, "this address accepts " + match.allowed);
    response.headers.emplace_back("Allow", match.allowed);
    return response;
  }
  pending.route = match.route;
  request.params = std::move(match.params);
  if (request.method == "HEAD") request.method = "GET";
  if (auto denied = check_access(request, *match.route)) return denied;
  return check_body(pending, bytes.has_value());
}

std::optional<Response> HttpChecks::check_access(Request& request, const Router::Route& route) {
  const std::string_view authorization = request.header("authorization");
  constexpr std::string_view kBearer = "Bearer ";
  if (authorization.starts_with(kBearer)) {
    request.by_api_token = sign_ins_.is_api_token(authorization.substr(kBearer.size()));
    if (!request.by_api_token) {
      if (const auto wait = bearer_tries_.refused(request.address, RateLimit::Clock::now()))
        return too_many(*wait);
      audit_.write("api token refused", request.address, {{"path", request.path}});
      return unauthorized("this is not the API token: see .studio/api-token in the workspace");
    }
  }
  if (route.access == Access::kPublic) return std::nullopt;
  if (request.by_api_token) return std::nullopt;
  const auto cookie = cookie_value(request.header("cookie"), kCookieName);
  if (!cookie || !sign_ins_.is_signed_in(*cookie, request.address))
    return unauthorized("you are not signed in: open the link that `tarsier serve --link` prints");
  if (is_change(request.method) &&
      !equals_in_constant_time(request.header("x-tarsier-csrf"), SignIns::csrf_of(*cookie)))
    return error_response(
        403, "the header X-Tarsier-CSRF is missing or wrong; GET /api/session returns it");
  return std::nullopt;
}

std::optional<Response> HttpChecks::check_body(PendingRequest& pending, bool has_length) const {
  Request& request = pending.request;
  const RouteOptions& options = pending.route->options;
  const std::string_view type = request.header("content-type");
  request.content_type = lower_case(trimmed(type.substr(0, type.find(';'))));
  if (!request.header("transfer-encoding").empty())
    return error_response(411, "send the body with a Content-Length");
  if (!has_length && !request.header("content-length").empty())
    return error_response(400, "the Content-Length is malformed");
  if (pending.expected == 0) return std::nullopt;
  if (request.method == "GET") return error_response(400, "a GET request must not have a body");
  if (!options.types.empty() && std::find(options.types.begin(), options.types.end(),
                                          request.content_type) == options.types.end())
    return error_response(
        415, fmt::format("the body must be of type {}", fmt::join(options.types, " or ")));
  if (pending.expected > options.max_body)
    return error_response(413, fmt::format("the body is larger than {} bytes", options.max_body));
  if (!options.spool) {
    request.body.reserve(pending.expected);
    return std::nullopt;
  }
  pending.spool_path = fmt::format("{}/body-{}", options_.spool_folder, new_secret().substr(0, 16));
  pending.spool = ::open(pending.spool_path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
  if (pending.spool < 0) {
    log_warning("{}: {}", pending.spool_path, errno_text(errno));
    pending.spool_path.clear();
    return error_response(507, "the workspace cannot be written");
  }
  request.body_file = pending.spool_path;
  return std::nullopt;
}

}  // namespace tarsier::web
