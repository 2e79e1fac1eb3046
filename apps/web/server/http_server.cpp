// SPDX-License-Identifier: MIT
#include "http_server.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include "http_checks.h"
#include "http_connections.h"
#include "mhd_response.h"
#include "sign_ins_api.h"
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>
#include <microhttpd.h>
#include <new>
#include <unistd.h>
#include <utility>

namespace tarsier::web {
namespace {

constexpr std::size_t kHeadBytes = 32768;         // of a request, including copies
constexpr std::size_t kThreadStack = 512 << 10;   // needed by the parsers for small JSON
constexpr unsigned kHandlerSeconds = 600;         // libmicrohttpd counts a handler's time, too
constexpr unsigned kStreamStallSeconds = 330;     // for a stream; see BodyStream
constexpr std::uint64_t kDrained = 64 << 10;      // a refused body up to this size is read first
constexpr double kSlowestBytesPerSecond = 16384;  // of a body; a response may take twice as long

}  // namespace

struct HttpServer::Impl {
  Impl(HttpServerOptions given, const Router& table, SignIns& known, AuditLog& log)
      : options(std::move(given)), router(table), sign_ins(known), audit(log) {}

  HttpServerOptions options;
  const Router& router;
  SignIns& sign_ins;
  AuditLog& audit;
  HttpCounters counters;
  HttpConnections connections{options, counters};
  HttpChecks checks{options, router, sign_ins, audit};
  std::vector<MHD_Daemon*> daemons;

  // --- connections ---

  static Connection* connection_of(MHD_Connection* connection) {
    const MHD_ConnectionInfo* info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    return info == nullptr ? nullptr : static_cast<Connection*>(info->socket_context);
  }

  // Runs in the thread of the connection, finally before the socket closes.
  static void note_connection(void* cls, MHD_Connection* handle, void** context,
                              MHD_ConnectionNotificationCode what) {
    auto& server = *static_cast<Impl*>(cls);
    if (what == MHD_CONNECTION_NOTIFY_STARTED) {
      const MHD_ConnectionInfo* fd =
          MHD_get_connection_info(handle, MHD_CONNECTION_INFO_CONNECTION_FD);
      const MHD_ConnectionInfo* from =
          MHD_get_connection_info(handle, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
      if (fd == nullptr) return;
      *context =
          server.connections.add(fd->connect_fd, from == nullptr ? nullptr : from->client_addr);
      return;
    }
    server.connections.remove(static_cast<Connection*>(std::exchange(*context, nullptr)));
  }

  // --- a request ---

  // The request line has arrived; the header fields have not.
  static void* note_target(void* cls, const char* uri, MHD_Connection* handle) {
    auto& server = *static_cast<Impl*>(cls);
    server.connections.begin_head(connection_of(handle));
    try {
      auto pending = std::make_unique<PendingRequest>();
      pending->target = uri;
      return pending.release();  // note_completed owns it
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
      auto* pending = static_cast<PendingRequest*>(*context);
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
    delete static_cast<PendingRequest*>(*context);
    *context = nullptr;
    server.connections.enter(connection_of(handle), Phase::kIdle, server.options.idle_s);
  }

  // The head has arrived: make all checks that need only the head.
  MHD_Result begin(MHD_Connection* handle, Connection& connection, PendingRequest& pending,
                   const char* method) {
    ++counters.requests;
    Request& request = pending.request;
    request.method = method;
    request.address = connection.address;
    const int count =
        MHD_get_connection_values(handle, MHD_HEADER_KIND, &Impl::add_header, &request.headers);
    std::optional<Response> refusal;
    if (count < 0 || request.headers.size() >= 100)
      refusal = error_response(431, "too many header fields");
    if (!refusal) refusal = checks.refusal(pending);
    connections.set_signed_in(connection, !refusal && pending.route->access == Access::kSignedIn);
    const std::string_view length = request.header("content-length");
    const bool has_body =
        (!length.empty() && length != "0") || !request.header("transfer-encoding").empty();
    if (refusal) {
      // A client that is still sending would not read the response: a small body is read first.
      if (!has_body || pending.expected == 0 || pending.expected > kDrained)
        return send(handle, connection, std::move(*refusal), "GET");
      pending.refusal = std::move(refusal);
    }
    connections.enter(
        &connection, Phase::kBody,
        options.body_s + static_cast<double>(pending.expected) / kSlowestBytesPerSecond);
    return MHD_YES;
  }

  // Takes a piece of the body; false ends the connection.
  static bool take(PendingRequest& pending, std::string_view bytes) {
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
          pending.refusal =
              error_response(507, fmt::format("the file cannot be stored: {}", errno_text(errno)));
          return true;
        }
        bytes.remove_prefix(static_cast<std::size_t>(count));
      }
    } catch (const std::bad_alloc&) {
      return false;
    }
    return true;
  }

  MHD_Result finish(MHD_Connection* handle, Connection& connection, PendingRequest& pending) {
    if (pending.refusal) return send(handle, connection, std::move(*pending.refusal), "GET");
    connections.enter(&connection, Phase::kHandler, 0);
    (void)MHD_set_connection_option(handle, MHD_CONNECTION_OPTION_TIMEOUT, kHandlerSeconds);
    if (pending.spool >= 0) ::close(std::exchange(pending.spool, -1));
    Response response;
    try {
      response = pending.route->handler(pending.request);
      if (response.stream != nullptr && pending.route->access == Access::kSignedIn)
        response.stream = while_signed_in(std::move(response.stream), sign_ins, pending.request);
    } catch (const HttpError& error) {
      response = error_response(error.status(), error.what());
    } catch (const UsageError& error) {
      response = error_response(400, error.what());
    } catch (const InputError& error) {
      response = error_response(404, error.what());
    } catch (const std::bad_alloc&) {
      response = error_response(503, "out of memory; try again with less");
    } catch (const std::exception& error) {
      log_warning("{} {}: {}", pending.request.method, pending.request.path, error.what());
      response = error_response(500, "the server failed; see its log");
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

  MHD_Result send(MHD_Connection* handle, Connection& connection, Response response,
                  std::string_view range) {
    if (response.status >= 500) {
      ++counters.failed;
    } else if (response.status >= 400) {
      ++counters.refused;
    }
    const MhdResponse answer =
        make_mhd_response(response, range, connection.socket, connections, counters);
    if (answer.body == nullptr) return MHD_NO;
    if (answer.is_stream) {
      (void)MHD_set_connection_option(handle, MHD_CONNECTION_OPTION_TIMEOUT, kStreamStallSeconds);
      connections.enter(&connection, Phase::kStream, 0);
    } else {
      counters.bytes += answer.bytes;
      connections.enter(
          &connection, Phase::kResponse,
          options.body_s * 2 + 2 * static_cast<double>(answer.bytes) / kSlowestBytesPerSecond);
    }
    const MHD_Result result =
        MHD_queue_response(handle, static_cast<unsigned>(response.status), answer.body);
    MHD_destroy_response(answer.body);
    return result;
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
          // More than our limit: a new connection waits here until an old one ends.
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
    connections.start();
  }

  void stop() {
    connections.close();
    // libmicrohttpd 0.9.75 dereferences a null pointer when it refuses a malformed request while it
    // is being stopped. So every connection is ended first: no new ones are accepted, and the input
    // of open ones is shut down.
    for (MHD_Daemon* daemon : daemons) {
      const MHD_socket listening = MHD_quiesce_daemon(daemon);
      if (listening != MHD_INVALID_SOCKET) ::close(listening);
    }
    connections.end_all(std::chrono::seconds(5));
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

}  // namespace tarsier::web
