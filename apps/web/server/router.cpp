// SPDX-License-Identifier: MIT
#include "router.h"

#include "tarsier/core/require.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::web {
namespace {

constexpr std::size_t kMaxQueryFields = 256;

std::vector<std::string_view> segments_of(std::string_view path) {
  std::vector<std::string_view> result;
  if (path.starts_with('/')) path.remove_prefix(1);
  while (true) {
    const std::size_t slash = path.find('/');
    result.push_back(path.substr(0, slash));
    if (slash == std::string_view::npos) return result;
    path.remove_prefix(slash + 1);
  }
}

bool is_parameter(std::string_view segment) { return segment.starts_with('{'); }
bool is_tail_parameter(std::string_view segment) {
  return is_parameter(segment) && segment.ends_with("...}");
}
std::string parameter_name(std::string_view segment) {
  segment.remove_prefix(1);
  segment.remove_suffix(
      is_tail_parameter(std::string_view(segment.data() - 1, segment.size() + 1)) ? 4 : 1);
  return std::string(segment);
}

bool matches(std::string_view pattern, std::string_view path,
             std::map<std::string, std::string>& params) {
  const auto pattern_segments = segments_of(pattern);
  const auto path_segments = segments_of(path);
  params.clear();
  for (std::size_t i = 0; i < pattern_segments.size(); ++i) {
    if (i >= path_segments.size()) return false;
    if (is_tail_parameter(pattern_segments[i])) {
      const auto begin = static_cast<std::size_t>(path_segments[i].data() - path.data());
      if (begin >= path.size()) return false;
      params[parameter_name(pattern_segments[i])] = std::string(path.substr(begin));
      return true;
    }
    if (is_parameter(pattern_segments[i])) {
      if (path_segments[i].empty()) return false;
      params[parameter_name(pattern_segments[i])] = std::string(path_segments[i]);
    } else if (pattern_segments[i] != path_segments[i]) {
      return false;
    }
  }
  return pattern_segments.size() == path_segments.size();
}

// The more literal pattern compares greater.
bool is_more_literal(std::string_view a, std::string_view b) {
  const auto of_a = segments_of(a);
  const auto of_b = segments_of(b);
  const auto rank = [](std::string_view segment) {
    return is_tail_parameter(segment) ? 0 : is_parameter(segment) ? 1 : 2;
  };
  for (std::size_t i = 0; i < std::min(of_a.size(), of_b.size()); ++i) {
    if (rank(of_a[i]) != rank(of_b[i])) return rank(of_a[i]) > rank(of_b[i]);
  }
  return of_a.size() > of_b.size();
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

}  // namespace

std::string_view Request::header(std::string_view lower_case_name) const {
  for (const auto& [name, value] : headers) {
    if (name == lower_case_name) return value;
  }
  return {};
}

std::optional<std::string> Request::query_value(std::string_view name) const {
  for (const auto& [key, value] : query) {
    if (key == name) return value;
  }
  return std::nullopt;
}

const std::string& Request::param(const std::string& name) const {
  const auto found = params.find(name);
  TARSIER_REQUIRE(found != params.end(), "the route has no {{{}}}", name);
  return found->second;
}

nlohmann::json Request::json() const {
  if (content_type != "application/json")
    throw HttpError(415, "the body must be JSON: send Content-Type: application/json");
  // Deeper nesting than any of our requests is refused: this bounds the parser's recursion.
  int depth = 0;
  bool too_deep = false;
  const nlohmann::json::parser_callback_t watch = [&](int at, nlohmann::json::parse_event_t event,
                                                      nlohmann::json&) {
    if (event == nlohmann::json::parse_event_t::object_start ||
        event == nlohmann::json::parse_event_t::array_start)
      depth = std::max(depth, at);
    too_deep = too_deep || depth > 32;
    return !too_deep;
  };
  nlohmann::json value = nlohmann::json::parse(body, watch, false);
  if (too_deep) throw HttpError(400, "the body is nested too deeply");
  if (value.is_discarded()) throw HttpError(400, "the body is not JSON");
  return value;
}

std::string to_text(const nlohmann::json& value) {
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

Response json_response(const nlohmann::json& value, int status) {
  Response response;
  response.status = status;
  response.body = to_text(value) + "\n";
  return response;
}

Response error_response(int status, std::string_view message) {
  return json_response({{"error", message}}, status);
}

Response no_content() {
  Response response;
  response.status = 204;
  response.type.clear();
  return response;
}

std::optional<std::string> optional_text(const nlohmann::json& object, const std::string& name) {
  if (!object.is_object()) throw HttpError(400, "the body must be a JSON object");
  const auto found = object.find(name);
  if (found == object.end() || found->is_null()) return std::nullopt;
  if (!found->is_string()) throw HttpError(400, fmt::format("\"{}\" must be a string", name));
  return found->get<std::string>();
}

std::string text_member(const nlohmann::json& object, const std::string& name) {
  auto value = optional_text(object, name);
  if (!value) throw HttpError(400, fmt::format("\"{}\" is missing", name));
  return *value;
}

void Router::add(const std::string& method, const std::string& pattern, Handler handler,
                 Access access, RouteOptions options) {
  TARSIER_REQUIRE(method == "GET" || method == "POST" || method == "PUT" || method == "DELETE",
                  "{}", method);
  TARSIER_REQUIRE(pattern.starts_with('/'), "{} must begin with '/'", pattern);
  const auto segments = segments_of(pattern);
  for (std::size_t i = 0; i < segments.size(); ++i) {
    TARSIER_REQUIRE(
        !is_parameter(segments[i]) || (segments[i].ends_with('}') && segments[i].size() > 2), "{}",
        pattern);
    TARSIER_REQUIRE(!is_tail_parameter(segments[i]) || i + 1 == segments.size(), "{}", pattern);
  }
  for (const auto& route : routes_)
    TARSIER_REQUIRE(route->method != method || route->pattern != pattern, "{} {} twice", method,
                    pattern);
  routes_.push_back(std::make_unique<Route>(
      Route{method, pattern, access, std::move(options), std::move(handler)}));
}

Router::Match Router::find(std::string_view method, std::string_view path) const {
  Match match;
  const std::string_view route_method = method == "HEAD" ? "GET" : method;
  std::vector<std::string> others;
  for (const auto& route : routes_) {
    std::map<std::string, std::string> params;
    if (!matches(route->pattern, path, params)) continue;
    if (route->method != route_method) {
      others.push_back(route->method);
    } else if (match.route == nullptr || is_more_literal(route->pattern, match.route->pattern)) {
      match.route = route.get();
      match.params = std::move(params);
    }
  }
  if (match.route != nullptr) return match;
  std::sort(others.begin(), others.end());
  others.erase(std::unique(others.begin(), others.end()), others.end());
  match.allowed = fmt::format("{}", fmt::join(others, ", "));
  return match;
}

std::vector<const Router::Route*> Router::routes() const {
  std::vector<const Route*> result;
  for (const auto& route : routes_) result.push_back(route.get());
  return result;
}

std::optional<std::string> percent_decoded(std::string_view text, bool of_query) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    char c = text[i];
    if (c == '%') {
      if (i + 2 >= text.size()) return std::nullopt;
      const int high = hex_digit(text[i + 1]);
      const int low = hex_digit(text[i + 2]);
      if (high < 0 || low < 0) return std::nullopt;
      c = static_cast<char>(high * 16 + low);
      i += 2;
    } else if (c == '+' && of_query) {
      c = ' ';
    }
    if (c == '\0') return std::nullopt;
    result += c;
  }
  return result;
}

std::optional<std::vector<std::pair<std::string, std::string>>> parse_query(std::string_view text) {
  std::vector<std::pair<std::string, std::string>> result;
  while (!text.empty()) {
    const std::size_t end = text.find('&');
    const std::string_view field = text.substr(0, end);
    text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
    if (field.empty()) continue;
    const std::size_t equals = field.find('=');
    auto key = percent_decoded(field.substr(0, equals), true);
    auto value = percent_decoded(
        equals == std::string_view::npos ? std::string_view() : field.substr(equals + 1), true);
    if (!key || !value || result.size() >= kMaxQueryFields) return std::nullopt;
    result.emplace_back(std::move(*key), std::move(*value));
  }
  return result;
}

}  // namespace tarsier::web
