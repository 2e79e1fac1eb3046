// SPDX-License-Identifier: MIT
#include "http_server.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include "request_target.h"
#include "secrets.h"
#include <algorithm>
#include <arpa/inet.h>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <fcntl.h>
#include <microhttpd.h>
#include <mutex>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <new>
#include <poll.h>
#include <set>
#include <sys/socket.h>
#include <sys/stat.h>
#include <system_error>
#include <thread>
#include <unistd.h>
#include <utility>

namespace tarsier::web {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kHeadBytes = 32768;         // of a request, with its own copies
constexpr std::size_t kThreadStack = 512 << 10;   // as the parsers of small JSON need
constexpr unsigned kHandlerSeconds = 600;         // libmicrohttpd counts a handler's time, too
constexpr unsigned kStreamStallSeconds = 330;     // of a stream; see BodyStream
constexpr std::uint64_t kDrained = 64 << 10;      // a refused body of that size is read first
constexpr double kSlowestBytesPerSecond = 16384;  // of a body; an answer may take twice as long

// Nothing on a page comes from elsewhere, and nothing that stands in it is run.
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'";
// A file of the user, opened by itself, is no page of ours.
constexpr const char* kDataPolicy =
    "default-src 'none'; script-src 'none'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox";

std::string address_text(const sockaddr* address) {
  std::array<char, INET6_ADDRSTRLEN> text{};
  if (address == nullptr) return "?";
  if (address->sa_family == AF_INET) {
    const auto* four = reinterpret_cast<const sockaddr_in*>(address);
    ::inet_ntop(AF_INET, &four->sin_addr, text.data(), text.size());
  } else if (address->sa_family == AF_INET6) {
    const auto* six = reinterpret_cast<const sockaddr_in6*>(address);
    if (IN6_IS_ADDR_V4MAPPED(&six->sin6_addr)) {
      ::inet_ntop(AF_INET, six->sin6_addr.s6_addr + 12, text.data(), text.size());
    } else {
      ::inet_ntop(AF_INET6, &six->sin6_addr, text.data(), text.size());
    }
  }
  return text.data();
}

enum class Phase { kFirstHead, kIdle, kHead, kBody, kHandler, kAnswer, kStream };

struct Connection {
  int socket = -1;
  std::string address;
  Phase phase = Phase::kFirstHead;
  Clock::time_point since;
  Clock::time_point deadline;
  bool signed_in = false;
  bool is_ended = false;  // shut down by us
};

// One request on its way.
struct Pending {
  std::string target;  // as it stands in the request line
  bool has_begun = false;
  Request request;
  const Router::Route* route = nullptr;
  std::optional<Response> refusal;  // once the body was read
  std::uint64_t expected = 0;       // bytes of the body
  int spool = -1;
  std::string spool_path;

  Pending() = default;
  Pending(const Pending&) = delete;
  Pending& operator=(const Pending&) = delete;
  ~Pending() {
    if (spool >= 0) ::close(spool);
    if (!spool_path.empty()) (void)::unlink(spool_path.c_str());
  }
};

Response refused(int status, std::string_view message) { return error_response(status, message); }

bool is_change(std::string_view method) { return method != "GET"; }

}  // namespace

struct HttpServer::Impl {
  Impl(HttpServerOptions given, const Router& table, SignIns& known, AuditLog& log)
      : options(std::move(given)), router(table), sign_ins(known), audit(log) {}

  HttpServerOptions options;
  const Router& router;
  SignIns& sign_ins;
  AuditLog& audit;
  RateLimit bearer_tries{10, std::chrono::seconds(60)};
  HttpCounters counters;
  std::vector<MHD_Daemon*> daemons;
  std::vector<std::string> refusals;

  std::mutex mutex;
  std::condition_variable changed;
  std::set<Connection*> connections;
  bool closing = false;
  std::thread keeper;

  // --- connections ---

  [[nodiscard]] static Clock::duration seconds(double value) {
    return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(value));
  }

  static Connection* connection_of(MHD_Connection* connection) {
    const MHD_ConnectionInfo* info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    return info == nullptr ? nullptr : static_cast<Connection*>(info->socket_context);
  }

  void enter(Connection* connection, Phase phase, double patience_s) {
    if (connection == nullptr) return;
    const std::lock_guard lock(mutex);
    connection->phase = phase;
    connection->since = Clock::now();
    connection->deadline =
        patience_s > 0 ? connection->since + seconds(patience_s) : Clock::time_point::max();
  }

  // With the mutex held.
  void end(Connection& connection) {
    if (connection.is_ended) return;
    connection.is_ended = true;
    ++counters.evicted;
    (void)::shutdown(connection.socket, SHUT_RDWR);
  }

  // The oldest that may be closed, of `address` (all: nullptr); with the mutex held.
  Connection* to_evict(const std::string* address, const Connection* except) {
    Connection* found = nullptr;
    for (Connection* connection : connections) {
      if (connection == except || connection->is_ended) continue;
      if (address != nullptr && connection->address != *address) continue;
      const bool waits = connection->phase == Phase::kFirstHead ||
                         connection->phase == Phase::kIdle || connection->phase == Phase::kHead;
      if (!waits && (connection->signed_in || connection->phase == Phase::kHandler)) continue;
      if (found == nullptr || connection->since < found->since) found = connection;
    }
    return found;
  }

  void make_room(Connection& fresh) {
    unsigned all = 0;
    unsigned same = 0;
    for (const Connection* connection : connections) {
      if (connection->is_ended) continue;
      ++all;
      if (connection->address == fresh.address) ++same;
    }
    const auto evict = [&](const std::string* address) {
      Connection* oldest = to_evict(address, &fresh);
      end(oldest != nullptr ? *oldest : fresh);
    };
    if (same > options.max_per_address) {
      evict(&fresh.address);
    } else if (all > options.max_connections) {
      evict(nullptr);
    }
  }

  // Runs in the thread of the connection, at the end before the socket closes.
  static void note_connection(void* cls, MHD_Connection* handle, void** context,
                              MHD_ConnectionNotificationCode what) {
    auto& server = *static_cast<Impl*>(cls);
    if (what == MHD_CONNECTION_NOTIFY_STARTED) {
      const MHD_ConnectionInfo* fd =
          MHD_get_connection_info(handle, MHD_CONNECTION_INFO_CONNECTION_FD);
      const MHD_ConnectionInfo* from =
          MHD_get_connection_info(handle, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
      if (fd == nullptr) return;
      auto connection = std::make_unique<Connection>();
      connection->socket = fd->connect_fd;
      connection->address = address_text(from == nullptr ? nullptr : from->client_addr);
      connection->since = Clock::now();
      connection->deadline = connection->since + seconds(server.options.head_s);
      const int one = 1;
      (void)::setsockopt(fd->connect_fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
      const std::lock_guard lock(server.mutex);
      *context = connection.get();
      server.connections.insert(connection.get());
      if (server.closing) {
        server.end(*connection);
      } else {
        server.make_room(*connection);
      }
      (void)connection.release();
      ++server.counters.connections;
      server.counters.open = server.connections.size();
      return;
    }
    const std::unique_ptr<Connection> connection(static_cast<Connection*>(*context));
    *context = nullptr;
    if (connection == nullptr) return;
    {
      const std::lock_guard lock(server.mutex);
      server.connections.erase(connection.get());
      server.counters.open = server.connections.size();
    }
    server.changed.notify_all();
  }

  // Closes connections whose time is over.
  void keep() {
    std::unique_lock lock(mutex);
    while (!closing) {
      changed.wait_for(lock, std::chrono::milliseconds(500), [&] { return closing; });
      const Clock::time_point now = Clock::now();
      for (Connection* connection : connections) {
        if (now >= connection->deadline) end(*connection);
      }
    }
  }

  // --- a request ---

  // The request line is here; its header fields are not yet.
  static void* note_target(void* cls, const char* uri, MHD_Connection* handle) {
    auto& server = *static_cast<Impl*>(cls);
    Connection* connection = connection_of(handle);
    if (connection != nullptr) {
      const std::lock_guard lock(server.mutex);
      // Of the first request the deadline stays: it is that of the connection.
      if (connection->phase == Phase::kIdle)
        connection->deadline = Clock::now() + seconds(server.options.head_s);
      connection->phase = Phase::kHead;
    }
    try {
      auto pending = std::make_unique<Pending>();
      pending->target = uri;
      return pending.release();  // note_completed's
    } catch (const std::bad_alloc&) {
      return nullptr;
    }
  }

  static std::size_t keep_escapes(void*, MHD_Connection*, char* text) { return std::strlen(text); }

  static MHD_Result add_header(void* cls, MHD_ValueKind, const char* name, const char* value) {
    auto& headers = *static_cast<Headers*>(cls);
    try {
      headers.emplace_back(lower_case(name), value == nullptr ? "" : value);
    } catch (const std::bad_alloc&) {
      return MHD_NO;
    }
    return headers.size() < 100 ? MHD_YES : MHD_NO;
  }

  static MHD_Result answer(void* cls, MHD_Connection* handle, const char*, const char* method,
                           const char*, const char* data, std::size_t* size, void** context) {
    auto& server = *static_cast<Impl*>(cls);
    try {
      Connection* connection = connection_of(handle);
      auto* pending = static_cast<Pending*>(*context);
      if (pending == nullptr || connection == nullptr) return MHD_NO;
      if (!std::exchange(pending->has_begun, true))
        return server.begin(handle, *connection, *pending, method);
      if (*size > 0) {
        if (!server.take(*pending, {data, *size})) return MHD_NO;
        *size = 0;
        return MHD_YES;
      }
      return server.finish(handle, *connection, *pending);
    } catch (const std::exception& error) {
      log_warning("HTTP: {}", error.what());
      return MHD_NO;
    }
  }

  static void note_completed(void* cls, MHD_Connection* handle, void** context,
                             MHD_RequestTerminationCode) {
    auto& server = *static_cast<Impl*>(cls);
    delete static_cast<Pending*>(*context);
    *context = nullptr;
    server.enter(connection_of(handle), Phase::kIdle, server.options.idle_s);
  }

  // The head is here: all that can be decided by it is.
  MHD_Result begin(MHD_Connection* handle, Connection& connection, Pending& pending,
                   const char* method) {
    ++counters.requests;
    Request& request = pending.request;
    request.method = method;
    request.address = connection.address;
    const int count =
        MHD_get_connection_values(handle, MHD_HEADER_KIND, &Impl::add_header, &request.headers);
    std::optional<Response> refusal;
    if (count < 0 || request.headers.size() >= 100)
      refusal = refused(431, "too many header fields");
    if (!refusal) refusal = check(pending);
    {
      const std::lock_guard lock(mutex);
      connection.signed_in = !refusal && pending.route->access == Access::kSignedIn;
    }
    const std::string_view length = request.header("content-length");
    const bool has_body =
        (!length.empty() && length != "0") || !request.header("transfer-encoding").empty();
    if (refusal) {
      // A client that is still sending would not read the answer: a small body is read first.
      if (!has_body || pending.expected == 0 || pending.expected > kDrained)
        return send(handle, connection, std::move(*refusal), "GET");
      pending.refusal = std::move(refusal);
    }
    enter(&connection, Phase::kBody,
          options.body_s + static_cast<double>(pending.expected) / kSlowestBytesPerSecond);
    return MHD_YES;
  }

  // Why the request is refused, or nothing; fills `pending`.
  std::optional<Response> check(Pending& pending) {
    Request& request = pending.request;
    const std::string_view length = request.header("content-length");
    const auto bytes = to_integer(length, 0, std::int64_t{1} << 50);
    if (bytes) pending.expected = static_cast<std::uint64_t>(*bytes);
    request.body_bytes = 0;

    const auto target = parse_target(pending.target);
    if (!target) return refused(400, "this path is malformed");
    request.path = target->path;
    if (const auto refusal = options.rules.refusal(head_of(request)))
      return refused(refusal->status, refusal->message);
    if (behind_proxy()) request.address = forwarded(request);
    auto query = parse_query(target->query);
    if (!query) return refused(400, "the query of this address is malformed");
    request.query = std::move(*query);

    Router::Match match = router.find(request.method, request.path);
    if (match.route == nullptr && match.allowed.empty())
      return refused(404, "there is nothing here; see /api/openapi.json");
    if (match.route == nullptr) {
      Response response = refused(405, "this address takes " + match.allowed);
      response.headers.emplace_back("Allow", match.allowed);
      return response;
    }
    pending.route = match.route;
    request.params = std::move(match.params);
    if (request.method == "HEAD") request.method = "GET";
    if (auto refusal = check_access(request, *match.route)) return refusal;
    return check_body(pending, bytes.has_value());
  }

  [[nodiscard]] static OriginRules::Head head_of(const Request& request) {
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

  [[nodiscard]] bool behind_proxy() const { return !options.rules.proxy_origin.empty(); }

  // The client that the proxy saw: the last word of X-Forwarded-For, the only one it vouches for.
  static std::string forwarded(const Request& request) {
    const std::string_view all = request.header("x-forwarded-for");
    const std::string last(trimmed(all.substr(all.find_last_of(',') + 1)));
    std::array<unsigned char, 16> bytes{};
    const bool is_address = ::inet_pton(AF_INET, last.c_str(), bytes.data()) == 1 ||
                            ::inet_pton(AF_INET6, last.c_str(), bytes.data()) == 1;
    return is_address ? last : request.address;
  }

  std::optional<Response> check_access(Request& request, const Router::Route& route) {
    const std::string_view authorization = request.header("authorization");
    constexpr std::string_view kBearer = "Bearer ";
    if (authorization.starts_with(kBearer)) {
      request.by_api_token = sign_ins.is_api_token(authorization.substr(kBearer.size()));
      if (!request.by_api_token) {
        if (const auto wait = bearer_tries.refused(request.address, RateLimit::Clock::now()))
          return too_many(*wait);
        audit.write("api token refused", request.address, {{"path", request.path}});
        return unauthorized("this token is none: see .studio/api-token of the workspace");
      }
    }
    if (route.access == Access::kPublic) return std::nullopt;
    if (request.by_api_token) return std::nullopt;
    const auto cookie = cookie_value(request.header("cookie"), kCookieName);
    if (!cookie || !sign_ins.is_signed_in(*cookie))
      return unauthorized(
          "you are not signed in: open the link that `tarsier serve --link` prints");
    if (is_change(request.method) &&
        !equals_in_constant_time(request.header("x-tarsier-csrf"), SignIns::csrf_of(*cookie)))
      return refused(403,
                     "the header X-Tarsier-CSRF is missing or wrong; GET /api/session tells it");
    return std::nullopt;
  }

  static Response unauthorized(std::string_view message) {
    Response response = refused(401, message);
    response.headers.emplace_back("WWW-Authenticate", "Bearer");
    return response;
  }

  static Response too_many(int wait) {
    Response response = refused(429, fmt::format("too many tries; wait {} s", wait));
    response.headers.emplace_back("Retry-After", std::to_string(wait));
    return response;
  }

  std::optional<Response> check_body(Pending& pending, bool has_length) {
    Request& request = pending.request;
    const RouteOptions& wanted = pending.route->options;
    const std::string_view type = request.header("content-type");
    request.content_type = lower_case(trimmed(type.substr(0, type.find(';'))));
    if (!request.header("transfer-encoding").empty())
      return refused(411, "send the body with a Content-Length");
    if (!has_length && !request.header("content-length").empty())
      return refused(400, "the Content-Length is malformed");
    if (pending.expected == 0) return std::nullopt;
    if (request.method == "GET") return refused(400, "a GET has no body");
    if (!wanted.types.empty() && std::find(wanted.types.begin(), wanted.types.end(),
                                           request.content_type) == wanted.types.end())
      return refused(415,
                     fmt::format("the body must be of type {}", fmt::join(wanted.types, " or ")));
    if (pending.expected > wanted.max_body)
      return refused(413, fmt::format("the body is larger than {} bytes", wanted.max_body));
    if (!wanted.spool) {
      request.body.reserve(pending.expected);
      return std::nullopt;
    }
    pending.spool_path =
        fmt::format("{}/body-{}", options.spool_folder, new_secret().substr(0, 16));
    pending.spool =
        ::open(pending.spool_path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (pending.spool < 0) {
      log_warning("{}: {}", pending.spool_path, std::generic_category().message(errno));
      pending.spool_path.clear();
      return refused(507, "the workspace cannot be written");
    }
    request.body_file = pending.spool_path;
    return std::nullopt;
  }

  // A piece of the body; false ends the connection.
  static bool take(Pending& pending, std::string_view bytes) {
    pending.request.body_bytes += bytes.size();
    if (pending.request.body_bytes > pending.expected) return false;
    if (pending.refusal) return true;
    if (pending.spool < 0) {
      pending.request.body += bytes;
      return true;
    }
    try {
      while (!bytes.empty()) {
        const ssize_t count = ::write(pending.spool, bytes.data(), bytes.size());
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) {
          pending.refusal = refused(507, fmt::format("the file cannot be stored: {}",
                                                     std::generic_category().message(errno)));
          return true;
        }
        bytes.remove_prefix(static_cast<std::size_t>(count));
      }
    } catch (const std::bad_alloc&) {
      return false;
    }
    return true;
  }

  MHD_Result finish(MHD_Connection* handle, Connection& connection, Pending& pending) {
    if (pending.refusal) return send(handle, connection, std::move(*pending.refusal), "GET");
    enter(&connection, Phase::kHandler, 0);
    (void)MHD_set_connection_option(handle, MHD_CONNECTION_OPTION_TIMEOUT, kHandlerSeconds);
    if (pending.spool >= 0) ::close(std::exchange(pending.spool, -1));
    Response response;
    try {
      response = pending.route->handler(pending.request);
    } catch (const HttpError& error) {
      response = refused(error.status(), error.what());
    } catch (const UsageError& error) {
      response = refused(400, error.what());
    } catch (const InputError& error) {
      response = refused(404, error.what());
    } catch (const std::bad_alloc&) {
      response = refused(503, "out of memory; try again with less");
    } catch (const std::exception& error) {
      log_warning("{} {}: {}", pending.request.method, pending.request.path, error.what());
      response = refused(500, "the server failed; its log tells more");
    }
    if (response.status == 200 && !pending.request.header("if-none-match").empty()) {
      for (const auto& [name, value] : response.headers) {
        if (name == "ETag" &&
            pending.request.header("if-none-match").find(value) != std::string_view::npos) {
          Response same;
          same.status = 304;
          same.type.clear();
          same.headers = std::move(response.headers);
          response = std::move(same);
          break;
        }
      }
    }
    return send(handle, connection, std::move(response), pending.request.header("range"));
  }

  // --- the answer ---

  struct Streaming {
    std::unique_ptr<BodyStream> stream;
    Impl* server = nullptr;
    int socket = -1;
    std::uint64_t sent = 0;
  };

  static ssize_t read_stream(void* cls, std::uint64_t, char* buffer, std::size_t most) {
    auto& streaming = *static_cast<Streaming*>(cls);
    try {
      {
        const std::lock_guard lock(streaming.server->mutex);
        if (streaming.server->closing) return MHD_CONTENT_READER_END_OF_STREAM;
      }
      const std::ptrdiff_t count = streaming.stream->read({buffer, most}, streaming.socket);
      if (count < 0) return MHD_CONTENT_READER_END_OF_STREAM;
      streaming.server->counters.bytes += static_cast<std::uint64_t>(count);
      return count;
    } catch (const std::exception& error) {
      log_warning("HTTP: {}", error.what());
      return MHD_CONTENT_READER_END_WITH_ERROR;
    }
  }

  static void end_stream(void* cls) { delete static_cast<Streaming*>(cls); }

  MHD_Result send(MHD_Connection* handle, Connection& connection, Response response,
                  std::string_view range) {
    if (response.status >= 500) {
      ++counters.failed;
    } else if (response.status >= 400) {
      ++counters.refused;
    }
    MHD_Response* body = nullptr;
    std::uint64_t size = 0;
    if (response.stream != nullptr) {
      auto streaming = std::make_unique<Streaming>();
      streaming->stream = std::move(response.stream);
      streaming->server = this;
      streaming->socket = connection.socket;
      const bool is_plain = streaming->stream->is_plain();
      constexpr std::size_t kBlock = 65536;
      body = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, kBlock, &Impl::read_stream,
                                               streaming.get(), &Impl::end_stream);
      if (body == nullptr) return MHD_NO;
      (void)streaming.release();  // end_stream's
      if (is_plain)
        (void)MHD_set_response_options(body, MHD_RF_HTTP_1_0_COMPATIBLE_STRICT, MHD_RO_END);
      (void)MHD_set_connection_option(handle, MHD_CONNECTION_OPTION_TIMEOUT, kStreamStallSeconds);
      enter(&connection, Phase::kStream, 0);
    } else {
      if (!response.file.empty()) {
        body = of_file(response, range, size);
      } else if (response.memory.data() != nullptr) {
        size = response.memory.size();
        body = MHD_create_response_from_buffer(response.memory.size(),
                                               const_cast<char*>(response.memory.data()),
                                               MHD_RESPMEM_PERSISTENT);
      }
      if (body == nullptr) {
        size = response.body.size();
        body = MHD_create_response_from_buffer(response.body.size(), response.body.data(),
                                               MHD_RESPMEM_MUST_COPY);
      }
      if (body == nullptr) return MHD_NO;
      counters.bytes += size;
      enter(&connection, Phase::kAnswer,
            options.body_s * 2 + 2 * static_cast<double>(size) / kSlowestBytesPerSecond);
    }
    add_headers(body, response);
    const MHD_Result result =
        MHD_queue_response(handle, static_cast<unsigned>(response.status), body);
    MHD_destroy_response(body);
    return result;
  }

  // Null where it is no regular file (any more): `response` is then a 404.
  static MHD_Response* of_file(Response& response, std::string_view range_text,
                               std::uint64_t& size) {
    const int fd = ::open(response.file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
    struct stat state {};
    if (fd < 0 || ::fstat(fd, &state) != 0 || !S_ISREG(state.st_mode)) {
      if (fd >= 0) ::close(fd);
      response = refused(404, "there is no such file");
      return nullptr;
    }
    size = static_cast<std::uint64_t>(state.st_size);
    response.headers.emplace_back("Accept-Ranges", "bytes");
    bool unsatisfiable = false;
    const auto range = response.status == 200 ? parse_range(range_text, size, unsatisfiable)
                                              : std::optional<ByteRange>();
    if (unsatisfiable) {
      ::close(fd);
      const std::string all = fmt::format("bytes */{}", size);
      response = refused(416, "the file is shorter");
      response.headers.emplace_back("Content-Range", all);
      return nullptr;
    }
    std::uint64_t first = 0;
    if (range) {
      response.status = 206;
      response.headers.emplace_back("Content-Range",
                                    fmt::format("bytes {}-{}/{}", range->first, range->last, size));
      first = range->first;
      size = range->last - range->first + 1;
    }
    MHD_Response* body = MHD_create_response_from_fd_at_offset64(size, fd, first);
    if (body == nullptr) ::close(fd);
    return body;
  }

  void add_headers(MHD_Response* body, const Response& response) const {
    const auto header = [&](const char* name, const std::string& value) {
      // A line end in a value would begin another field: libmicrohttpd refuses it.
      (void)MHD_add_response_header(body, name, value.c_str());
    };
    const auto has = [&](std::string_view name) {
      return std::any_of(response.headers.begin(), response.headers.end(),
                         [&](const auto& item) { return item.first == name; });
    };
    if (!response.type.empty()) header("Content-Type", response.type);
    for (const auto& [name, value] : response.headers) header(name.c_str(), value);
    if (!has("Cache-Control")) header("Cache-Control", "no-store");
    header("Content-Security-Policy", response.file.empty() ? kPolicy : kDataPolicy);
    header("X-Content-Type-Options", "nosniff");
    header("Referrer-Policy", "no-referrer");
    header("Cross-Origin-Opener-Policy", "same-origin");
    header("Cross-Origin-Resource-Policy", "same-origin");
    header("X-Frame-Options", "DENY");
    header("Permissions-Policy",
           "camera=(self), microphone=(), geolocation=(), display-capture=(), usb=(), serial=()");
  }

  // --- beginning and end ---

  void start() {
    for (int& socket : options.sockets) {
      std::vector<MHD_OptionItem> items;
      if (!options.tls_certificate.empty()) {
        items.push_back({MHD_OPTION_HTTPS_MEM_CERT, 0, options.tls_certificate.data()});
        items.push_back({MHD_OPTION_HTTPS_MEM_KEY, 0, options.tls_key.data()});
        static char priorities[] = "NORMAL:-VERS-ALL:+VERS-TLS1.3:+VERS-TLS1.2:%SERVER_PRECEDENCE";
        items.push_back({MHD_OPTION_HTTPS_PRIORITIES, 0, priorities});
      }
      items.push_back({MHD_OPTION_END, 0, nullptr});
      unsigned flags = MHD_USE_THREAD_PER_CONNECTION | MHD_USE_INTERNAL_POLLING_THREAD |
                       MHD_USE_POLL | MHD_USE_ITC;
      if (!options.tls_certificate.empty()) flags |= MHD_USE_TLS;
      MHD_Daemon* daemon = MHD_start_daemon(
          flags, 0, nullptr, nullptr, &Impl::answer, this, MHD_OPTION_LISTEN_SOCKET,
          static_cast<MHD_socket>(socket), MHD_OPTION_NOTIFY_CONNECTION, &Impl::note_connection,
          this, MHD_OPTION_NOTIFY_COMPLETED, &Impl::note_completed, this,
          MHD_OPTION_URI_LOG_CALLBACK, &Impl::note_target, this, MHD_OPTION_UNESCAPE_CALLBACK,
          &Impl::keep_escapes, nullptr,
          // Room beside ours, in which a new connection waits for an old one to end.
          MHD_OPTION_CONNECTION_LIMIT, options.max_connections + 64U, MHD_OPTION_CONNECTION_TIMEOUT,
          options.stall_s, MHD_OPTION_CONNECTION_MEMORY_LIMIT, kHeadBytes,
          MHD_OPTION_THREAD_STACK_SIZE, kThreadStack, MHD_OPTION_STRICT_FOR_CLIENT, 1,
          MHD_OPTION_ARRAY, items.data(), MHD_OPTION_END);
      if (daemon == nullptr) {
        stop();
        throw OutputError("http", options.tls_certificate.empty()
                                      ? "the server cannot start"
                                      : "the server cannot start: do the certificate and its key "
                                        "belong together?");
      }
      daemons.push_back(daemon);
      socket = -1;
    }
    keeper = std::thread([this] { keep(); });
  }

  void stop() {
    {
      const std::lock_guard lock(mutex);
      closing = true;
    }
    changed.notify_all();
    if (keeper.joinable()) keeper.join();
    // libmicrohttpd 0.9.75 reads through a null pointer when it refuses a malformed request while
    // it is being stopped. So every connection ends before: no new ones, and those that are open
    // meet the end of their input.
    for (MHD_Daemon* daemon : daemons) {
      const MHD_socket listening = MHD_quiesce_daemon(daemon);
      if (listening != MHD_INVALID_SOCKET) ::close(listening);
    }
    {
      std::unique_lock lock(mutex);
      for (const Connection* connection : connections)
        (void)::shutdown(connection->socket, SHUT_RDWR);
      (void)changed.wait_for(lock, std::chrono::seconds(5), [&] { return connections.empty(); });
    }
    for (MHD_Daemon* daemon : daemons) MHD_stop_daemon(daemon);
    daemons.clear();
    for (int& socket : options.sockets) {
      if (socket >= 0) ::close(std::exchange(socket, -1));
    }
  }
};

HttpServer::HttpServer(HttpServerOptions options, const Router& router, SignIns& sign_ins,
                       AuditLog& audit)
    : impl_(std::make_unique<Impl>(std::move(options), router, sign_ins, audit)) {
  impl_->start();
}

HttpServer::~HttpServer() { stop(); }

void HttpServer::stop() { impl_->stop(); }

const HttpCounters& HttpServer::counters() const { return impl_->counters; }

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
                     429, fmt::format("too many tries to sign in; wait {} s and try again", *wait));
                 response.headers.emplace_back("Retry-After", std::to_string(*wait));
                 return response;
               }
               const std::string token = text_member(request.json(), "token");
               const auto cookie = sign_ins.exchange(token);
               if (!cookie) {
                 audit.write("sign-in refused", request.address, {{"reason", "no such link"}});
                 throw HttpError(
                     401,
                     "this link is used up or too old: `tarsier serve --link` prints a new "
                     "one");
               }
               audit.write("sign-in", request.address,
                           {{"browser", std::string(request.header("user-agent"))}});
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
