// SPDX-License-Identifier: MIT
// GET, POST and DELETE /api/session: sign-in state, sign-in and sign-out.
#include <fmt/format.h>

#include "http_server.h"
#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::web {

void add_session_routes(Router& router, SignIns& sign_ins, AuditLog& audit, bool secure_cookie,
                        std::string version) {
  const auto cookie_line = [secure_cookie](std::string_view value, std::int64_t seconds) {
    return fmt::format("{}={}; Path=/; Max-Age={}; HttpOnly; SameSite=Strict{}", kCookieName, value,
                       seconds, secure_cookie ? "; Secure" : "");
  };
  router.add(
      "GET", "/api/session",
      [&sign_ins, secure_cookie, version](const Request& request) {
        const auto cookie = cookie_value(request.header("cookie"), kCookieName);
        const bool signed_in = cookie && sign_ins.is_signed_in(*cookie);
        nlohmann::json value{{"signed_in", signed_in || request.by_api_token},
                             {"version", version},
                             {"tls", secure_cookie}};
        if (signed_in) value["csrf"] = SignIns::csrf_of(*cookie);
        return json_response(value);
      },
      Access::kPublic);
  const auto tries = std::make_shared<RateLimit>(10, std::chrono::seconds(60));
  router.add("POST", "/api/session",
             [&sign_ins, &audit, tries, cookie_line](const Request& request) {
               const auto wait = tries->refused(request.address, RateLimit::Clock::now());
               if (wait) {
                 audit.write("sign-in refused", request.address, {{"reason", "too many tries"}});
                 Response response = error_response(
                     429, fmt::format("too many sign-in attempts; wait {} s, then retry", *wait));
                 response.headers.emplace_back("Retry-After", std::to_string(*wait));
                 return response;
               }
               const std::string token = text_member(request.json(), "token");
               const std::string agent(request.header("user-agent"));
               const auto cookie = sign_ins.exchange(token, request.address, agent);
               if (!cookie) {
                 audit.write("sign-in refused", request.address, {{"reason", "no such link"}});
                 throw HttpError(
                     401,
                     "this link is used up or expired: `tarsier serve --link` prints a new "
                     "one");
               }
               audit.write("sign-in", request.address,
                           {{"browser", agent}, {"sign_in", SignIns::id_of(*cookie)}});
               Response response = json_response({{"csrf", SignIns::csrf_of(*cookie)}});
               const std::int64_t life =
                   std::chrono::duration_cast<std::chrono::seconds>(SignIns::kCookieLife).count();
               response.headers.emplace_back("Set-Cookie", cookie_line(*cookie, life));
               return response;
             },
             Access::kPublic, {.max_body = 1024});
  router.add("DELETE", "/api/session", [&sign_ins, &audit, cookie_line](const Request& request) {
    const auto cookie = cookie_value(request.header("cookie"), kCookieName);
    if (cookie) sign_ins.sign_out(*cookie);
    audit.write("sign-out", request.address);
    Response response = no_content();
    response.headers.emplace_back("Set-Cookie", cookie_line("", 0));
    return response;
  });
}

}  // namespace tarsier::web
