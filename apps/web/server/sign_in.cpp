// SPDX-License-Identifier: MIT
#include "sign_in.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/http_service.h"

#include "router.h"
#include "secrets.h"
#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <charconv>
#include <cstdint>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

namespace tarsier::web {
namespace {

constexpr std::size_t kMaxAddresses = 4096;
constexpr std::size_t kIdDigits = 16;

std::int64_t whole_seconds_of(WallClock::time_point time) {
  return std::chrono::duration_cast<std::chrono::seconds>(time.time_since_epoch()).count();
}

// Writes a file that has mode 0600 from the start. Throws OutputError.
void write_secret_file(const std::string& path, std::string_view text) {
  const std::string temporary = path + ".new";
  (void)::unlink(temporary.c_str());
  const int fd =
      ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (fd < 0) throw OutputError(temporary, errno_text(errno));
  try {
    write_all(fd, text, temporary);
  } catch (...) {
    ::close(fd);
    (void)::unlink(temporary.c_str());
    throw;
  }
  const bool synced = ::fsync(fd) == 0;
  ::close(fd);
  if (!synced || ::rename(temporary.c_str(), path.c_str()) != 0)
    throw OutputError(path, errno_text(errno));
}

void make_private_folder(const std::string& path) {
  make_folder(path);
  if (::chmod(path.c_str(), 0700) != 0) throw OutputError(path, errno_text(errno));
}

// Reads "1764000000" from a small file; nullopt if it contains something else.
std::optional<WallClock::time_point> read_time(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string text;
  std::getline(file, text);
  const auto seconds = to_integer(text, 0, std::int64_t{1} << 40);
  if (!seconds) return std::nullopt;
  return WallClock::time_point(std::chrono::seconds(*seconds));
}

// The object after the time in the file of a sign-in; empty in files of older versions.
nlohmann::json read_details(const std::filesystem::path& path) {
  std::ifstream file(path);
  std::string text;
  std::getline(file, text);
  text.clear();
  std::getline(file, text);
  nlohmann::json value = nlohmann::json::parse(text, nullptr, false);
  return value.is_object() ? value : nlohmann::json::object();
}

std::string text_of(const nlohmann::json& object, const char* name) {
  const auto found = object.find(name);
  return found != object.end() && found->is_string() ? found->get<std::string>() : std::string();
}

// One line of at most 200 bytes of a browser's user agent.
std::string plain_line(std::string_view text) {
  std::string line(text.substr(0, 200));
  std::replace_if(
      line.begin(), line.end(), [](char c) { return c < ' ' || c > '~'; }, '?');
  return line;
}

std::string read_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  return text;
}

// The key under which an address is counted.
std::string counted_as(std::string_view address) {
  in6_addr six{};
  const std::string text(address);
  if (::inet_pton(AF_INET6, text.c_str(), &six) != 1) return text;
  // One customer has a whole /64; an IPv4 address in IPv6 is one machine.
  if (IN6_IS_ADDR_V4MAPPED(&six)) return text;
  return {reinterpret_cast<const char*>(six.s6_addr), 8};
}

}  // namespace

std::optional<int> RateLimit::refused(std::string_view address, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  std::erase_if(windows_, [&](const auto& item) { return now - item.second.begin >= window_; });
  const std::string name = counted_as(address);
  auto found = windows_.find(name);
  if (found == windows_.end()) {
    if (windows_.size() >= kMaxAddresses) return static_cast<int>(window_.count());
    found = windows_.emplace(name, Window{now, 0}).first;
  }
  if (found->second.tries >= tries_) {
    const auto left = std::chrono::ceil<std::chrono::seconds>(found->second.begin + window_ - now);
    return static_cast<int>(std::max<std::int64_t>(1, left.count()));
  }
  ++found->second.tries;
  return std::nullopt;
}

std::string make_link_token(const std::string& folder) {
  make_private_folder(folder + "/links");
  const std::string token = new_secret();
  const std::string path = folder + "/links/" + hash_of(token);
  write_secret_file(path, std::to_string(whole_seconds_of(WallClock::now())) + "\n");
  // A link that root creates for a service user must belong to that user.
  struct stat state {};
  if (::geteuid() == 0 && ::stat(folder.c_str(), &state) == 0 && state.st_uid != 0)
    (void)!::chown(path.c_str(), state.st_uid, state.st_gid);
  return token;
}

SignIns::SignIns(std::string folder, std::function<WallClock::time_point()> now,
                 std::size_t max_sign_ins)
    : folder_(std::move(folder)), now_(std::move(now)), max_sign_ins_(max_sign_ins) {
  make_private_folder(folder_);
  make_private_folder(folder_ + "/links");
  make_private_folder(folder_ + "/sign-ins");
  const std::string path = folder_ + "/api-token";
  struct stat state {};
  if (::lstat(path.c_str(), &state) == 0 && S_ISREG(state.st_mode)) {
    if ((state.st_mode & 077U) != 0 && ::chmod(path.c_str(), 0600) != 0)
      throw OutputError(path, errno_text(errno));
    api_token_ = read_text(path);
  }
  if (!looks_like_secret(api_token_)) {
    api_token_ = new_secret();
    write_secret_file(path, api_token_ + "\n");
  }
  load();
}

void SignIns::load() {
  const WallClock::time_point now = now_();
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_ + "/links", error)) {
    const auto made = read_time(entry.path());
    if (!made || now - *made > kLinkLife) (void)::unlink(entry.path().c_str());
  }
  for (const auto& entry : std::filesystem::directory_iterator(folder_ + "/sign-ins", error)) {
    const auto begin = read_time(entry.path());
    const std::string hash = entry.path().filename().string();
    if (!begin || !looks_like_secret(hash) || now - *begin > kCookieLife) {
      (void)::unlink(entry.path().c_str());
      continue;
    }
    const nlohmann::json details = read_details(entry.path());
    StoredSignIn& stored = cookies_[hash];
    stored.began = stored.used = *begin;
    const auto used = details.find("used");
    if (used != details.end() && used->is_number_integer() && *used >= whole_seconds_of(*begin) &&
        *used <= whole_seconds_of(now))
      stored.used = WallClock::time_point(std::chrono::seconds(used->get<std::int64_t>()));
    stored.written = stored.used;
    stored.address = text_of(details, "address");
    stored.used_from = text_of(details, "used_from");
    stored.agent = text_of(details, "agent");
  }
}

void SignIns::write(const std::string& hash, StoredSignIn& stored) const {
  const nlohmann::json details{{"used", whole_seconds_of(stored.used)},
                               {"address", stored.address},
                               {"used_from", stored.used_from},
                               {"agent", stored.agent}};
  write_secret_file(folder_ + "/sign-ins/" + hash, std::to_string(whole_seconds_of(stored.began)) +
                                                       "\n" + to_text(details) + "\n");
  stored.written = stored.used;
}

std::optional<std::string> SignIns::exchange(std::string_view token, std::string_view address,
                                             std::string_view agent) {
  if (!looks_like_secret(token)) return std::nullopt;
  const std::lock_guard lock(mutex_);
  const std::string link = folder_ + "/links/" + hash_of(token);
  const auto made = read_time(link);
  // Removing the file uses the token: this succeeds only once, also for two simultaneous requests.
  if (::unlink(link.c_str()) != 0) return std::nullopt;
  const WallClock::time_point now = now_();
  if (!made || now - *made > kLinkLife) return std::nullopt;
  while (cookies_.size() >= max_sign_ins_) {
    const auto oldest = std::min_element(
        cookies_.begin(), cookies_.end(),
        [](const auto& a, const auto& b) { return a.second.began < b.second.began; });
    forget(oldest->first);
  }
  std::string cookie = new_secret();
  const std::string hash = hash_of(cookie);
  StoredSignIn stored{now, now, now, plain_line(address), plain_line(address), plain_line(agent)};
  write(hash, stored);
  cookies_[hash] = std::move(stored);
  return cookie;
}

bool SignIns::is_signed_in(std::string_view cookie, std::string_view address) {
  if (!looks_like_secret(cookie)) return false;
  const std::string hash = hash_of(cookie);
  const std::lock_guard lock(mutex_);
  const auto found = cookies_.find(hash);
  if (found == cookies_.end()) return false;
  const WallClock::time_point now = now_();
  StoredSignIn& stored = found->second;
  if (now - stored.began > kCookieLife) {
    forget(hash);
    return false;
  }
  stored.used = std::max(stored.used, now);
  const bool has_moved = !address.empty() && address != stored.used_from;
  if (has_moved) stored.used_from = plain_line(address);
  if (has_moved || stored.used - stored.written > kUsedEvery) {
    try {
      write(hash, stored);
    } catch (const OutputError& error) {
      stored.written = stored.used;  // so that the next try is later
      log_warning("{}", error.what());
    }
  }
  return true;
}

std::string SignIns::id_of(std::string_view cookie) { return hash_of(cookie).substr(0, kIdDigits); }

std::vector<SignIns::SignIn> SignIns::list() const {
  const WallClock::time_point now = now_();
  std::vector<SignIn> result;
  {
    const std::lock_guard lock(mutex_);
    for (const auto& [hash, stored] : cookies_) {
      if (now - stored.began > kCookieLife) continue;
      result.push_back({hash.substr(0, kIdDigits), stored.began, stored.used, stored.address,
                        stored.used_from, stored.agent});
    }
  }
  std::sort(result.begin(), result.end(), [](const SignIn& a, const SignIn& b) {
    return a.used != b.used ? a.used > b.used : a.id < b.id;
  });
  return result;
}

bool SignIns::revoke(std::string_view id) {
  if (id.size() != kIdDigits) return false;
  const std::lock_guard lock(mutex_);
  const auto found = cookies_.lower_bound(std::string(id));
  if (found == cookies_.end() || !found->first.starts_with(id)) return false;
  forget(found->first);
  return true;
}

std::size_t SignIns::revoke_others(std::string_view cookie) {
  const std::string own = hash_of(cookie);
  std::size_t count = 0;
  const std::lock_guard lock(mutex_);
  for (auto item = cookies_.begin(); item != cookies_.end();) {
    const std::string hash = (item++)->first;
    if (hash == own) continue;
    forget(hash);
    ++count;
  }
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(folder_ + "/links", error))
    (void)::unlink(entry.path().c_str());
  return count;
}

std::string SignIns::renew_api_token() {
  std::string token = new_secret();
  const std::lock_guard lock(mutex_);
  write_secret_file(folder_ + "/api-token", token + "\n");
  api_token_ = token;
  return token;
}

WallClock::time_point SignIns::api_token_made() const {
  struct stat state {};
  if (::stat((folder_ + "/api-token").c_str(), &state) != 0) return {};
  return WallClock::from_time_t(state.st_mtime);
}

void SignIns::sign_out(std::string_view cookie) {
  const std::lock_guard lock(mutex_);
  forget(hash_of(cookie));
}

void SignIns::forget(const std::string& hash) {
  const std::string gone = hash;  // a copy, because `hash` may be the key itself
  (void)::unlink((folder_ + "/sign-ins/" + gone).c_str());
  cookies_.erase(gone);
}

bool SignIns::is_api_token(std::string_view token) const {
  const std::lock_guard lock(mutex_);
  return equals_in_constant_time(token, api_token_);
}

std::string SignIns::csrf_of(std::string_view cookie) {
  return hash_of("csrf of " + std::string(cookie));
}

std::optional<std::string> cookie_value(std::string_view header, std::string_view name) {
  while (!header.empty()) {
    const std::size_t end = header.find(';');
    const std::string_view item = trimmed(header.substr(0, end));
    header.remove_prefix(end == std::string_view::npos ? header.size() : end + 1);
    const std::size_t equals = item.find('=');
    if (equals == std::string_view::npos || item.substr(0, equals) != name) continue;
    return std::string(item.substr(equals + 1));
  }
  return std::nullopt;
}

}  // namespace tarsier::web
