// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::web {

using WallClock = std::chrono::system_clock;

// At most so many tries in a window of time for each address (of IPv6 its /64). Bounded memory.
// Thread-safe.
class RateLimit {
 public:
  using Clock = std::chrono::steady_clock;
  RateLimit(int tries, std::chrono::seconds window) : tries_(tries), window_(window) {}
  // Counts a try; the seconds to wait where there were too many.
  [[nodiscard]] std::optional<int> refused(std::string_view address, Clock::time_point now);

 private:
  struct Window {
    Clock::time_point begin;
    int tries = 0;
  };
  const int tries_;
  const std::chrono::seconds window_;
  std::mutex mutex_;
  std::map<std::string, Window> windows_;
};

// Makes a link that signs one browser in, once: its token is returned, and its hash is a file in
// `folder`/links for 24 hours. Any program of this user may do that beside the server.
[[nodiscard]] std::string make_link_token(const std::string& folder);

// Who is signed in: browsers by a cookie that they got for a link's token, programs by the token
// in the file api-token. All is kept in `folder` (.studio of the workspace, mode 0700), hashes
// alone but for api-token (0600), so that sign-ins outlive a restart. Thread-safe.
class SignIns {
 public:
  static constexpr std::chrono::hours kLinkLife{24};
  static constexpr std::chrono::hours kCookieLife{24 * 30};
  static constexpr std::size_t kMost = 1000;  // sign-ins; the oldest one ends for a further one

  // Makes what is missing, and drops links and sign-ins that are over. Throws OutputError.
  explicit SignIns(std::string folder, std::function<WallClock::time_point()> now = &WallClock::now,
                   std::size_t most = kMost);

  // The cookie's secret for the token of a link, which is then used up; nothing for any other.
  // `address` and `agent`, the browser's name for itself, are kept for list().
  [[nodiscard]] std::optional<std::string> exchange(std::string_view token,
                                                    std::string_view address = {},
                                                    std::string_view agent = {});
  // Of a cookie. Signed in for 30 days since the sign-in. Notes the use, from `address` if it is
  // not empty.
  [[nodiscard]] bool is_signed_in(std::string_view cookie, std::string_view address = {});
  void sign_out(std::string_view cookie);
  [[nodiscard]] bool is_api_token(std::string_view token) const;

  struct SignIn {
    std::string id;  // 16 digits; nobody signs in by it
    WallClock::time_point began;
    WallClock::time_point used;  // after a restart it may be too early by kUsedEvery
    std::string address;         // of the sign-in
    std::string used_from;       // of the last use
    std::string agent;           // one line, 200 bytes at most
  };
  static constexpr std::chrono::minutes kUsedEvery{10};  // between two writes of the last use
  // Those that hold now, the one that was used last first.
  [[nodiscard]] std::vector<SignIn> list() const;
  [[nodiscard]] static std::string id_of(std::string_view cookie);
  // Ends one of list(); false for an unknown id.
  bool revoke(std::string_view id);
  // Ends all but that of `cookie`, which may be empty; how many. Links that nobody used end, too.
  std::size_t revoke_others(std::string_view cookie);
  // A new token for programs, which is returned; the one before is refused from now on. Throws
  // OutputError, and the one before holds.
  std::string renew_api_token();
  [[nodiscard]] WallClock::time_point api_token_made() const;
  // What a page sends back with every change: it follows from the cookie, which no other site can
  // read.
  [[nodiscard]] static std::string csrf_of(std::string_view cookie);
  [[nodiscard]] std::size_t count() const;

 private:
  struct Kept {
    WallClock::time_point began;
    WallClock::time_point used;
    WallClock::time_point written;  // what the file says of `used`
    std::string address;
    std::string used_from;
    std::string agent;
  };
  void load();
  void forget(const std::string& hash);
  void write(const std::string& hash, Kept& kept) const;

  const std::string folder_;
  const std::function<WallClock::time_point()> now_;
  const std::size_t most_;
  mutable std::mutex mutex_;  // of what follows
  std::string api_token_;
  std::map<std::string, Kept> cookies_;  // by hash
};

// The name of the cookie that a browser is signed in by.
inline constexpr std::string_view kCookieName = "tarsier_session";

// The first value of the cookie `name` in a Cookie header.
[[nodiscard]] std::optional<std::string> cookie_value(std::string_view header,
                                                      std::string_view name);

}  // namespace tarsier::web
