// SPDX-License-Identifier: MIT
#include "sign_ins_api.h"

#include <fmt/format.h>

#include "audit_log.h"
#include "http_server.h"
#include <array>
#include <chrono>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <utility>

namespace tarsier::web {
namespace {

using Json = nlohmann::json;

double seconds_of(WallClock::time_point time) {
  return std::chrono::duration<double>(time.time_since_epoch()).count();
}

std::string cookie_of(const Request& request) {
  return cookie_value(request.header("cookie"), kCookieName).value_or("");
}

Response list(const Request& request, const SignIns& sign_ins) {
  const std::string cookie = cookie_of(request);
  const std::string own = cookie.empty() ? "" : SignIns::id_of(cookie);
  Json rows = Json::array();
  for (const SignIns::SignIn& one : sign_ins.list()) {
    rows.push_back({{"id", one.id},
                    {"began", seconds_of(one.began)},
                    {"used", seconds_of(one.used)},
                    {"ends", seconds_of(one.began + SignIns::kCookieLife)},
                    {"address", one.address},
                    {"used_from", one.used_from},
                    {"browser", short_agent(one.agent)},
                    {"agent", one.agent},
                    {"own", one.id == own}});
  }
  return json_response(
      {{"sign_ins", rows}, {"api_token", {{"made", seconds_of(sign_ins.api_token_made())}}}});
}

class Guarded final : public BodyStream {
 public:
  using Clock = std::chrono::steady_clock;
  Guarded(std::unique_ptr<BodyStream> stream, std::function<bool()> is_signed_in,
          std::chrono::milliseconds interval)
      : stream_(std::move(stream)), is_signed_in_(std::move(is_signed_in)), interval_(interval) {}
  std::ptrdiff_t read(std::span<char> buffer, int socket) override {
    const Clock::time_point now = Clock::now();
    if (now - last_check_ >= interval_) {
      last_check_ = now;
      if (!is_signed_in_()) return -1;
    }
    return stream_->read(buffer, socket);
  }
  [[nodiscard]] bool is_plain() const override { return stream_->is_plain(); }

 private:
  std::unique_ptr<BodyStream> stream_;
  std::function<bool()> is_signed_in_;
  const std::chrono::milliseconds interval_;
  Clock::time_point last_check_ = Clock::now();
};

}  // namespace

std::string short_agent(std::string_view agent) {
  // The most specific word first: the text of a browser also contains words of later entries.
  constexpr std::array<std::pair<std::string_view, std::string_view>, 8> kBrowsers{
      {{"Edg", "Edge"},
       {"OPR/", "Opera"},
       {"SamsungBrowser", "Samsung Internet"},
       {"Firefox", "Firefox"},
       {"FxiOS", "Firefox"},
       {"Chrom", "Chrome"},
       {"CriOS", "Chrome"},
       {"Safari", "Safari"}}};
  constexpr std::array<std::pair<std::string_view, std::string_view>, 7> kSystems{
      {{"Android", "Android"},
       {"iPhone", "iPhone"},
       {"iPad", "iPad"},
       {"CrOS", "ChromeOS"},
       {"Windows", "Windows"},
       {"Mac OS", "macOS"},
       {"Linux", "Linux"}}};
  const auto first_in = [&](const auto& names) {
    for (const auto& [word, name] : names) {
      if (agent.find(word) != std::string_view::npos) return std::string(name);
    }
    return std::string();
  };
  const std::string browser = first_in(kBrowsers);
  const std::string system = first_in(kSystems);
  if (browser.empty()) return std::string(agent.substr(0, agent.find_first_of(" /")).substr(0, 40));
  return system.empty() ? browser : browser + " on " + system;
}

void bind_sign_ins(Router& router, SignIns& sign_ins, AuditLog& audit) {
  router.add("GET", "/api/sign-ins",
             [&sign_ins](const Request& request) { return list(request, sign_ins); });
  router.add("DELETE", "/api/sign-ins/{id}", [&sign_ins, &audit](const Request& request) {
    const std::string& id = request.param("id");
    if (!sign_ins.revoke(id)) throw HttpError(404, "no such sign-in; it may have ended");
    audit.write("sign-in revoked", request.address, {{"sign_in", id}});
    return no_content();
  });
  router.add("DELETE", "/api/sign-ins", [&sign_ins, &audit](const Request& request) {
    const std::size_t count = sign_ins.revoke_others(cookie_of(request));
    audit.write("other sign-ins revoked", request.address, {{"count", count}});
    return json_response({{"revoked", count}});
  });
  router.add("POST", "/api/api-token", [&sign_ins, &audit](const Request& request) {
    // A program with the current token must not be able to lock out others.
    if (request.by_api_token) throw HttpError(403, "only a signed-in browser can do this");
    const std::string token = sign_ins.renew_api_token();
    audit.write("api token renewed", request.address);
    return json_response({{"token", token}, {"made", seconds_of(sign_ins.api_token_made())}});
  });
}

std::unique_ptr<BodyStream> while_signed_in(std::unique_ptr<BodyStream> stream, SignIns& sign_ins,
                                            const Request& request,
                                            std::chrono::milliseconds interval) {
  std::function<bool()> is_signed_in;
  if (request.by_api_token) {
    constexpr std::string_view kBearer = "Bearer ";
    const std::string token(request.header("authorization").substr(kBearer.size()));
    is_signed_in = [&sign_ins, token] { return sign_ins.is_api_token(token); };
  } else {
    const std::string cookie = cookie_of(request);
    is_signed_in = [&sign_ins, cookie] { return sign_ins.is_signed_in(cookie); };
  }
  return std::make_unique<Guarded>(std::move(stream), std::move(is_signed_in), interval);
}

}  // namespace tarsier::web
