// SPDX-License-Identifier: MIT
#include "tarsier/media/http_service.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <condition_variable>
#include <microhttpd.h>
#include <mutex>
#include <set>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

constexpr std::size_t kMinToken = 16;
constexpr unsigned kRequestSeconds = 5;  // s without a byte of a request

// An open image stream may last for ever, but nothing on the page may come from elsewhere.
constexpr const char* kPolicy =
    "default-src 'none'; img-src 'self'; style-src 'self'; script-src 'self'; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

MHD_Result result_of(bool accepted) { return accepted ? MHD_YES : MHD_NO; }

MHD_Response* response_of(std::string_view body, const char* type) {
  MHD_Response* response = MHD_create_response_from_buffer(
      body.size(), const_cast<char*>(body.data()), MHD_RESPMEM_MUST_COPY);
  if (response != nullptr) (void)MHD_add_response_header(response, "Content-Type", type);
  return response;
}

}  // namespace

bool equals_in_constant_time(std::string_view given, std::string_view secret) {
  unsigned difference = given.size() == secret.size() ? 0 : 1;
  for (std::size_t i = 0; i < secret.size(); ++i) {
    const char c = i < given.size() ? given[i] : '\0';
    difference |= static_cast<unsigned>(static_cast<unsigned char>(c) ^
                                        static_cast<unsigned char>(secret[i]));
  }
  return difference == 0;
}

class HttpService::Daemon {
 public:
  Daemon(const std::string& url, HttpAccess access, int max_connections, int max_per_address,
         Respond respond)
      : access_(std::move(access)),
        respond_(std::move(respond)),
        address_(parse_listen_address(url)) {
    check_rules(url);
    if (access_.listen_all && address_.loopback) address_.open_to_all();
    const int fd = listen_on(url, address_);
    daemon_ = MHD_start_daemon(
        MHD_USE_THREAD_PER_CONNECTION | MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_POLL |
            MHD_USE_ITC,
        0, nullptr, nullptr, &Daemon::answer, this, MHD_OPTION_LISTEN_SOCKET,
        static_cast<MHD_socket>(fd), MHD_OPTION_NOTIFY_CONNECTION, &Daemon::note_connection, this,
        MHD_OPTION_CONNECTION_LIMIT, static_cast<unsigned>(max_connections),
        MHD_OPTION_PER_IP_CONNECTION_LIMIT, static_cast<unsigned>(max_per_address),
        MHD_OPTION_CONNECTION_TIMEOUT, kRequestSeconds, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        std::size_t{32768}, MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_END);
    if (daemon_ == nullptr) {
      ::close(fd);
      throw OutputError(url, "cannot start the HTTP server");
    }
  }
  ~Daemon() { stop(); }
  Daemon(const Daemon&) = delete;
  Daemon& operator=(const Daemon&) = delete;

  void stop() {
    if (daemon_ == nullptr) return;
    // libmicrohttpd 0.9.75 dereferences a null pointer when it refuses a malformed request while it
    // is being stopped. So every connection is ended first: no new ones are accepted, and the input
    // of open ones is shut down.
    const MHD_socket listening = MHD_quiesce_daemon(daemon_);
    {
      std::unique_lock lock(mutex_);
      closing_ = true;
      for (const int socket : sockets_) (void)::shutdown(socket, SHUT_RDWR);
      (void)changed_.wait_for(lock, std::chrono::seconds(5), [&] { return sockets_.empty(); });
    }
    MHD_stop_daemon(daemon_);
    if (listening != MHD_INVALID_SOCKET) ::close(listening);
    daemon_ = nullptr;
  }

  [[nodiscard]] bool is_running() const { return daemon_ != nullptr; }
  [[nodiscard]] const ListenAddress& address() const { return address_; }

 private:
  void check_rules(const std::string& url) const {
    if (!access_.token.empty()) {
      const bool plain = std::all_of(access_.token.begin(), access_.token.end(), [](char c) {
        return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_' ||
               c == '.' || c == '~';
      });
      if (access_.token.size() < kMinToken || !plain) {
        throw UsageError(
            fmt::format("the token needs at least {} letters, digits, '-', '_', '.' or '~'; make "
                        "one by: openssl rand -hex 16",
                        kMinToken));
      }
    }
    if (!address_.loopback && !access_.listen_all) {
      throw UsageError(
          url +
          ": other machines could watch: add option 'listen_all' and a token (openssl rand "
          "-hex 16), or use 127.0.0.1");
    }
    if (access_.listen_all && access_.token.empty()) {
      throw UsageError(url +
                       ": listening beyond this machine needs a token of 16 characters or more; "
                       "make one by: openssl rand -hex 16");
    }
  }

  // Keeps the list of open connections. Runs in the connections' threads, finally before the socket
  // closes.
  static void note_connection(void* cls, MHD_Connection* connection, void**,
                              MHD_ConnectionNotificationCode what) {
    auto& server = *static_cast<Daemon*>(cls);
    const MHD_ConnectionInfo* info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    if (info == nullptr) return;
    {
      const std::lock_guard lock(server.mutex_);
      if (what == MHD_CONNECTION_NOTIFY_STARTED) {
        server.sockets_.insert(info->connect_fd);
        if (server.closing_) (void)::shutdown(info->connect_fd, SHUT_RDWR);
      } else {
        server.sockets_.erase(info->connect_fd);
      }
    }
    server.changed_.notify_all();
  }

  [[nodiscard]] bool is_allowed(MHD_Connection* connection) const {
    if (access_.token.empty()) return true;
    const char* argument = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, "token");
    if (argument != nullptr && equals_in_constant_time(argument, access_.token)) return true;
    constexpr std::string_view kBearer = "Bearer ";
    const auto authorization = header_of(connection, "Authorization");
    return authorization && authorization->substr(0, kBearer.size()) == kBearer &&
           equals_in_constant_time(authorization->substr(kBearer.size()), access_.token);
  }

  static MHD_Result answer(void* cls, MHD_Connection* connection, const char* path,
                           const char* method, const char*, const char*, std::size_t* upload_size,
                           void** request) {
    try {
      auto& server = *static_cast<Daemon*>(cls);
      const std::string_view verb = method;
      if (verb != "GET" && verb != "HEAD") {
        return result_of(refuse(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "only GET and HEAD",
                                "Allow", "GET, HEAD"));
      }
      static char seen = 0;
      if (*request ==
          // The headers are complete; the response follows when the whole request has arrived.
          nullptr) {
        *request = &seen;
        return MHD_YES;
      }
      if (*upload_size != 0) return MHD_NO;  // a body is not allowed
      return result_of(server.respond(connection, path));
    } catch (const std::exception& error) {
      log_warning("HTTP: {}", error.what());
      return MHD_NO;
    }
  }

  bool respond(MHD_Connection* connection, std::string_view path) {
    const auto host = header_of(connection, "Host");
    if (!host) return refuse(connection, MHD_HTTP_BAD_REQUEST, "no Host header");
    if (!address_.is_own_host(*host))
      return refuse(connection, MHD_HTTP_MISDIRECTED_REQUEST, "this server has another name");
    // A script of another site sends its own origin.
    const auto origin = header_of(connection, "Origin");
    if (origin && lower_case(*origin) != "http://" + lower_case(*host)) {
      return refuse(connection, MHD_HTTP_FORBIDDEN, "requests from other sites are refused");
    }
    if (!is_allowed(connection)) {
      return refuse(connection, MHD_HTTP_UNAUTHORIZED,
                    "a token is needed: add ?token=... to the address", "WWW-Authenticate",
                    "Bearer");
    }
    return respond_(connection, path);
  }

  const HttpAccess access_;
  const Respond respond_;
  ListenAddress address_;
  MHD_Daemon* daemon_ = nullptr;
  std::mutex mutex_;  // protects the following members
  std::condition_variable changed_;
  std::set<int> sockets_;  // of the open connections
  bool closing_ = false;
};

HttpService::HttpService(const std::string& url, const HttpAccess& access, int max_connections,
                         int max_connections_per_address, Respond respond)
    : daemon_(std::make_unique<Daemon>(url, access, max_connections, max_connections_per_address,
                                       std::move(respond))) {}

HttpService::~HttpService() = default;

void HttpService::stop() { daemon_->stop(); }

bool HttpService::is_running() const { return daemon_->is_running(); }

bool HttpService::is_open_to_all() const { return daemon_->address().any; }

std::string HttpService::url() const {
  const ListenAddress& address = daemon_->address();
  std::string host = address.ipv6 ? "[" + address.host + "]" : address.host;
  if (address.any) {
    std::array<char, 256> name{};
    if (::gethostname(name.data(), name.size() - 1) == 0 && name[0] != '\0') host = name.data();
  }
  return fmt::format("http://{}:{}/", host, address.port);
}

bool HttpService::send(MHD_Connection* connection, unsigned status, MHD_Response* response) {
  if (response == nullptr) return false;
  const auto header = [&](const char* name, const char* value) {
    (void)MHD_add_response_header(response, name, value);
  };
  header("Cache-Control", "no-store");
  header("X-Content-Type-Options", "nosniff");
  header("Content-Security-Policy", kPolicy);
  header("Cross-Origin-Resource-Policy", "same-origin");
  header("Referrer-Policy", "no-referrer");
  header("X-Frame-Options", "DENY");
  const MHD_Result result = MHD_queue_response(connection, status, response);
  MHD_destroy_response(response);
  return result == MHD_YES;
}

bool HttpService::send(MHD_Connection* connection, unsigned status, std::string_view body,
                       const char* type) {
  return send(connection, status, response_of(body, type));
}

bool HttpService::refuse(MHD_Connection* connection, unsigned status, std::string_view why,
                         const char* header, const char* value) {
  MHD_Response* response = response_of(fmt::format("{}\n", why), "text/plain; charset=utf-8");
  if (response != nullptr && header != nullptr)
    (void)MHD_add_response_header(response, header, value);
  return send(connection, status, response);
}

std::optional<std::string_view> HttpService::header_of(MHD_Connection* connection,
                                                       const char* name) {
  const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
  return value == nullptr ? std::nullopt : std::optional<std::string_view>(value);
}

}  // namespace tarsier
