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

// Limits the tries of each address (for IPv6 its /64) in a window of time. Bounded memory.
// Thread-safe.
class RateLimit {
 public:
  using Clock = std::chrono::steady_clock;
  RateLimit(int tries, std::chrono::seconds window) : tries_(tries), window_(window) {}
  // Counts a try; returns the seconds to wait if there were too many.
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

// Creates a link that signs in one browser, once. Returns its token; its hash is a file in
// `folder`/links for 24 hours. Any program of this user may call this while the server runs.
[[nodiscard]] std::string make_link_token(const std::string& folder);

// Who is signed in: browsers by a cookie, which they get for a link's token; programs by the token
// in the file api-token. All state is in `folder` (.studio of the workspace, mode 0700), as hashes
// except for api-token (0600), so that sign-ins survive a restart. Thread-safe.
class SignIns {
 public:
  static constexpr std::chrono::hours kLinkLife{24};
  static constexpr std::chrono::hours kCookieLife{24 * 30};
  static constexpr std::size_t kMaxSignIns = 1000;  // sign-ins; beyond that the oldest one ends

  // Creates missing files and removes expired links and sign-ins. Throws OutputError.
  explicit SignIns(std::string folder, std::function<WallClock::time_point()> now = &WallClock::now,
                   std::size_t max_sign_ins = kMaxSignIns);

  // Exchanges the token of a link, which is then invalid, for the cookie's secret; nullopt for any
  // other token. list() shows `address` and `agent`, the browser's name.
  [[nodiscard]] std::optional<std::string> exchange(std::string_view token,
                                                    std::string_view address = {},
                                                    std::string_view agent = {});
  // Whether a cookie is signed in; a sign-in lasts 30 days. Records the use, and `address` if not
  // empty.
  [[nodiscard]] bool is_signed_in(std::string_view cookie, std::string_view address = {});
  void sign_out(std::string_view cookie);
  [[nodiscard]] bool is_api_token(std::string_view token) const;

  struct SignIn {
    std::string id;  // 16 digits; not a secret
    WallClock::time_point began;
    WallClock::time_point used;  // after a restart it may be too early by kUsedEvery
    std::string address;         // of the sign-in
    std::string used_from;       // of the last use
    std::string agent;           // one line, 200 bytes at most
  };
  static constexpr std::chrono::minutes kUsedEvery{10};  // between two writes of the last use
  // The valid sign-ins, the most recently used first.
  [[nodiscard]] std::vector<SignIn> list() const;
  [[nodiscard]] static std::string id_of(std::string_view cookie);
  // Ends one of list(); false for an unknown id.
  bool revoke(std::string_view id);
  // Ends all sign-ins except that of `cookie`, which may be empty; returns how many. Unused links
  // end, too.
  std::size_t revoke_others(std::string_view cookie);
  // Returns a new token for programs; the old one is invalid from now on. If it throws OutputError,
  // the old one remains valid.
  std::string renew_api_token();
  [[nodiscard]] WallClock::time_point api_token_made() const;
  // The value that a page sends with every change. It is derived from the cookie, which no other
  // site can read.
  [[nodiscard]] static std::string csrf_of(std::string_view cookie);

 private:
  struct StoredSignIn {
    WallClock::time_point began;
    WallClock::time_point used;
    WallClock::time_point written;  // `used` as in the file
    std::string address;
    std::string used_from;
    std::string agent;
  };
  void load();
  void forget(const std::string& hash);
  void write(const std::string& hash, StoredSignIn& stored) const;

  const std::string folder_;
  const std::function<WallClock::time_point()> now_;
  const std::size_t max_sign_ins_;
  mutable std::mutex mutex_;  // protects the following members
  std::string api_token_;
  std::map<std::string, StoredSignIn> cookies_;  // by hash
};

// The name of the cookie of signed-in browsers.
inline constexpr std::string_view kCookieName = "tarsier_session";

// The first value of the cookie `name` in a Cookie header.
[[nodiscard]] std::optional<std::string> cookie_value(std::string_view header,
                                                      std::string_view name);

}  // namespace tarsier::web
