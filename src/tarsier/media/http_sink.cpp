// SPDX-License-Identifier: MIT
#include "tarsier/media/http_sink.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/http_listen.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "assets.h"
#include <algorithm>
#include <array>
#include <cctype>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <microhttpd.h>
#include <mutex>
#include <optional>
#include <poll.h>
#include <set>
#include <string_view>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier {
namespace {

using Clock = std::chrono::steady_clock;
using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kMinToken = 16;
constexpr std::string_view kBoundary = "tarsier-frame";

// The time does not tell how many characters were right.
bool equals_in_constant_time(std::string_view given, std::string_view secret) {
  unsigned difference = given.size() == secret.size() ? 0 : 1;
  for (std::size_t i = 0; i < secret.size(); ++i) {
    const char c = i < given.size() ? given[i] : '\0';
    difference |= static_cast<unsigned>(static_cast<unsigned char>(c) ^
                                        static_cast<unsigned char>(secret[i]));
  }
  return difference == 0;
}

// --- what browsers get ---

// An image may hold the stream open for ever, but nothing on the page may come from elsewhere.
constexpr const char* kPolicy =
    "default-src 'none'; img-src 'self'; style-src 'self'; script-src 'self'; connect-src 'self'; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

// --- the sink ---

class HttpSink final : public FrameSink {
 public:
  HttpSink(const std::string& url, const SinkOptions& options)
      : url_(url), options_(options), address_(parse_listen_address(url)) {
    check_rules();
    if (options_.listen_all && address_.loopback) address_.open_to_all();
    const int fd = listen_on(url, address_);
    daemon_ = MHD_start_daemon(
        MHD_USE_THREAD_PER_CONNECTION | MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_POLL |
            MHD_USE_ITC,
        0, nullptr, nullptr, &HttpSink::answer, this, MHD_OPTION_LISTEN_SOCKET,
        static_cast<MHD_socket>(fd), MHD_OPTION_NOTIFY_CONNECTION, &HttpSink::note_connection, this,
        // Room beside the viewers, so that further ones can still be refused with a reason; and room beside one
        // address, so that nobody shuts the others out. One address may be a proxy for all viewers.
        MHD_OPTION_CONNECTION_LIMIT, static_cast<unsigned>(options_.max_viewers) + 16U,
        MHD_OPTION_PER_IP_CONNECTION_LIMIT, static_cast<unsigned>(options_.max_viewers) + 4U,
        MHD_OPTION_CONNECTION_TIMEOUT, kRequestSeconds, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        std::size_t{32768}, MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_END);
    if (daemon_ == nullptr) {
      ::close(fd);
      throw OutputError(url, "cannot start the HTTP server");
    }
  }

  ~HttpSink() override { stop(); }

  std::string write(const cv::Mat& image, const Frame&) override {
    TARSIER_REQUIRE(
        image.dims == 2 && !image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
        "{}x{}, type {}: sinks take 8-bit grey or BGR", image.cols, image.rows, image.type());
    TARSIER_REQUIRE(daemon_ != nullptr, "{} is finished", url_);
    Image* free = nullptr;
    {
      const std::lock_guard lock(mutex_);
      for (const auto& slot : images_) {
        if (slot.get() != newest_ && !slot->encoding) free = slot.get();
      }
      if (free == nullptr) free = images_.emplace_back(std::make_unique<Image>()).get();
      // Tells those who waited for its encoding that it is gone.
      free->number = 0;
      free->jpeg.reset();
    }
    // Nobody else touches the pixels now: it is neither the newest nor being encoded.
    image.copyTo(free->raw);
    {
      const std::lock_guard lock(mutex_);
      free->number = ++frames_;
      newest_ = free;
      newest_at_ = Clock::now();
    }
    changed_.notify_all();
    return {};
  }

  void finish() override { stop(); }

  [[nodiscard]] std::string description() const override {
    const std::lock_guard lock(mutex_);
    std::string host = address_.ipv6 ? "[" + address_.host + "]" : address_.host;
    if (address_.any) {
      std::array<char, 256> name{};
      if (::gethostname(name.data(), name.size() - 1) == 0 && name[0] != '\0') host = name.data();
    }
    return fmt::format("http://{}:{}/ ({} {}{})", host, address_.port, viewers_,
                       viewers_ == 1 ? "viewer" : "viewers",
                       address_.any ? ", every interface" : "");
  }

 private:
  static constexpr unsigned kRequestSeconds = 5;  // without a byte of a request
  static constexpr unsigned kViewerSeconds = 60;  // a viewer that takes nothing

  struct Image {
    cv::Mat raw;
    std::int64_t number = 0;
    bool encoding = false;
    std::shared_ptr<const Bytes> jpeg;
  };

  // One stream that is being watched.
  struct Viewer {
    HttpSink* sink = nullptr;
    int socket = -1;
    std::int64_t last = 0;  // number of the image that was sent
    std::string head;       // of the part
    std::shared_ptr<const Bytes> jpeg;
    std::size_t sent = 0;  // of head, jpeg and tail together
  };

  void check_rules() const {
    if (!options_.token.empty()) {
      const bool plain = std::all_of(options_.token.begin(), options_.token.end(), [](char c) {
        return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '-' || c == '_' ||
               c == '.' || c == '~';
      });
      if (options_.token.size() < kMinToken || !plain) {
        throw UsageError(
            fmt::format("the token needs at least {} letters, digits, '-', '_', '.' or '~'; make "
                        "one by: openssl rand -hex 16",
                        kMinToken));
      }
    }
    if (!address_.loopback && !options_.listen_all) {
      throw UsageError(url_ +
                       ": other machines could watch: add --listen-all and a token (openssl rand "
                       "-hex 16), or use 127.0.0.1");
    }
    if (options_.listen_all && options_.token.empty()) {
      throw UsageError(url_ +
                       ": listening beyond this machine needs a token of 16 characters or more; "
                       "make one by: openssl rand -hex 16");
    }
  }

  void stop() {
    if (daemon_ == nullptr) return;
    {
      std::unique_lock lock(mutex_);
      closing_ = true;
      changed_.notify_all();
      // Viewers that keep up get the last image whole; those that do not are cut off.
      (void)changed_.wait_for(lock, std::chrono::milliseconds(300), [&] { return viewers_ == 0; });
    }
    // libmicrohttpd 0.9.75 reads through a null pointer when it refuses a malformed request while
    // it is being stopped. So every connection ends before: no new ones, and those that are open
    // meet the end of their input.
    const MHD_socket listening = MHD_quiesce_daemon(daemon_);
    {
      std::unique_lock lock(mutex_);
      for (const int socket : sockets_) (void)::shutdown(socket, SHUT_RDWR);
      (void)changed_.wait_for(lock, std::chrono::seconds(5), [&] { return sockets_.empty(); });
    }
    MHD_stop_daemon(daemon_);
    if (listening != MHD_INVALID_SOCKET) ::close(listening);
    daemon_ = nullptr;
  }

  // Keeps the list of open connections. Runs in their threads, at the end before the socket closes.
  static void note_connection(void* cls, MHD_Connection* connection, void**,
                              MHD_ConnectionNotificationCode what) {
    auto& sink = *static_cast<HttpSink*>(cls);
    const MHD_ConnectionInfo* info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    if (info == nullptr) return;
    {
      const std::lock_guard lock(sink.mutex_);
      if (what == MHD_CONNECTION_NOTIFY_STARTED) {
        sink.sockets_.insert(info->connect_fd);
        if (sink.closing_) (void)::shutdown(info->connect_fd, SHUT_RDWR);
      } else {
        sink.sockets_.erase(info->connect_fd);
      }
    }
    sink.changed_.notify_all();
  }

  // The newest image that is newer than `last`, encoded; nothing if none came in time or the sink
  // closes.
  std::shared_ptr<const Bytes> wait_for_image(std::int64_t& last,
                                              std::chrono::milliseconds patience) {
    std::unique_lock lock(mutex_);
    const auto is_new = [&] { return closing_ || (newest_ != nullptr && newest_->number > last); };
    if (!changed_.wait_for(lock, patience, is_new) || newest_ == nullptr || newest_->number <= last)
      return nullptr;
    Image* const slot = newest_;
    const std::int64_t number = slot->number;
    if (slot->encoding) {
      // Somebody else is at it. The image may be replaced meanwhile, and is then not waited for.
      encoded_.wait(lock, [&] { return slot->number != number || !slot->encoding; });
      if (slot->number != number || slot->jpeg == nullptr) return nullptr;
      last = number;
      return slot->jpeg;
    }
    if (slot->jpeg == nullptr) {
      slot->encoding = true;
      lock.unlock();
      std::shared_ptr<const Bytes> jpeg;
      try {
        jpeg = std::make_shared<const Bytes>(
            encode_image(".jpg", slot->raw, url_, options_.jpeg_quality));
      } catch (const std::exception& error) {
        log_warning("{}", error.what());
      }
      lock.lock();
      slot->encoding = false;
      slot->jpeg = jpeg;
      encoded_.notify_all();
      last = number;
      return jpeg;
    }
    last = number;
    return slot->jpeg;
  }

  // Fills `buffer` with the next bytes of the stream. Runs in the connection's own thread, so it
  // may wait.
  static ssize_t read_stream(void* cls, std::uint64_t, char* buffer, std::size_t most) {
    auto& viewer = *static_cast<Viewer*>(cls);
    // The boundary follows its part at once: browsers show an image only when they have seen the
    // next boundary.
    static const std::string kTail = fmt::format("\r\n--{}\r\n", kBoundary);
    if (viewer.jpeg == nullptr) {
      viewer.jpeg = viewer.sink->wait_for_image(viewer.last, std::chrono::milliseconds(500));
      if (viewer.jpeg == nullptr) {
        // Without images nothing is sent, and nobody else would notice that the viewer has left.
        ::pollfd state{viewer.socket, POLLRDHUP, 0};
        const bool gone = ::poll(&state, 1, 0) > 0 && state.revents != 0;
        return gone || viewer.sink->is_closing() ? MHD_CONTENT_READER_END_OF_STREAM : 0;
      }
      viewer.head += fmt::format("Content-Type: image/jpeg\r\nContent-Length: {}\r\n\r\n",
                                 viewer.jpeg->size());
      viewer.sent = 0;
    }
    std::size_t written = 0;
    std::size_t start = 0;
    const auto copy = [&](const void* data, std::size_t size) {
      if (viewer.sent >= start && viewer.sent < start + size && written < most) {
        const std::size_t from = viewer.sent - start;
        const std::size_t count = std::min(size - from, most - written);
        std::memcpy(buffer + written, static_cast<const char*>(data) + from, count);
        written += count;
        viewer.sent += count;
      }
      start += size;
    };
    copy(viewer.head.data(), viewer.head.size());
    copy(viewer.jpeg->data(), viewer.jpeg->size());
    copy(kTail.data(), kTail.size());
    if (viewer.sent == start) {
      viewer.jpeg.reset();
      viewer.head.clear();
    }
    return static_cast<ssize_t>(written);
  }

  static void end_stream(void* cls) {
    const std::unique_ptr<Viewer> viewer(static_cast<Viewer*>(cls));
    HttpSink& sink = *viewer->sink;
    {
      const std::lock_guard lock(sink.mutex_);
      --sink.viewers_;
    }
    sink.changed_.notify_all();
  }

  [[nodiscard]] bool is_closing() const {
    const std::lock_guard lock(mutex_);
    return closing_;
  }

  // Sends `response` and gives it up.
  static MHD_Result send(MHD_Connection* connection, unsigned status, MHD_Response* response) {
    if (response == nullptr) return MHD_NO;
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
    return result;
  }

  static MHD_Response* response_of(std::string_view body, const char* type) {
    MHD_Response* response = MHD_create_response_from_buffer(
        body.size(), const_cast<char*>(body.data()), MHD_RESPMEM_MUST_COPY);
    if (response != nullptr) (void)MHD_add_response_header(response, "Content-Type", type);
    return response;
  }

  static MHD_Result refuse(MHD_Connection* connection, unsigned status, std::string_view why,
                           const char* header = nullptr, const char* value = nullptr) {
    MHD_Response* response = response_of(fmt::format("{}\n", why), "text/plain; charset=utf-8");
    if (response != nullptr && header != nullptr)
      (void)MHD_add_response_header(response, header, value);
    return send(connection, status, response);
  }

  static std::optional<std::string_view> header_of(MHD_Connection* connection, const char* name) {
    const char* value = MHD_lookup_connection_value(connection, MHD_HEADER_KIND, name);
    return value == nullptr ? std::nullopt : std::optional<std::string_view>(value);
  }

  [[nodiscard]] bool is_allowed(MHD_Connection* connection) const {
    if (options_.token.empty()) return true;
    const char* argument = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, "token");
    if (argument != nullptr && equals_in_constant_time(argument, options_.token)) return true;
    constexpr std::string_view kBearer = "Bearer ";
    const auto authorization = header_of(connection, "Authorization");
    return authorization && authorization->substr(0, kBearer.size()) == kBearer &&
           equals_in_constant_time(authorization->substr(kBearer.size()), options_.token);
  }

  static MHD_Result answer(void* cls, MHD_Connection* connection, const char* path,
                           const char* method, const char*, const char*, std::size_t* upload_size,
                           void** request) {
    try {
      auto& sink = *static_cast<HttpSink*>(cls);
      const std::string_view verb = method;
      if (verb != "GET" && verb != "HEAD") {
        return refuse(connection, MHD_HTTP_METHOD_NOT_ALLOWED, "only GET and HEAD", "Allow",
                      "GET, HEAD");
      }
      static char seen = 0;
      if (*request ==
          nullptr) {  // the headers are here; the answer follows when the whole request is
        *request = &seen;
        return MHD_YES;
      }
      if (*upload_size != 0) return MHD_NO;  // a body has no place here
      return sink.respond(connection, path);
    } catch (const std::exception& error) {
      log_warning("HTTP: {}", error.what());
      return MHD_NO;
    }
  }

  MHD_Result respond(MHD_Connection* connection, std::string_view path) {
    const auto host = header_of(connection, "Host");
    if (!host) return refuse(connection, MHD_HTTP_BAD_REQUEST, "no Host header");
    if (!address_.is_own_host(*host))
      return refuse(connection, MHD_HTTP_MISDIRECTED_REQUEST, "this server has another name");
    // A script of another site sends its origin.
    const auto origin = header_of(connection, "Origin");
    if (origin && lower_case(*origin) != "http://" + lower_case(*host)) {
      return refuse(connection, MHD_HTTP_FORBIDDEN, "requests from other sites are refused");
    }
    if (!is_allowed(connection)) {
      return refuse(connection, MHD_HTTP_UNAUTHORIZED,
                    "a token is needed: add ?token=... to the address", "WWW-Authenticate",
                    "Bearer");
    }
    if (path == "/stream.mjpg") return send_stream(connection);
    if (path == "/snapshot.jpg") return send_snapshot(connection);
    if (path == "/healthz")
      return send(connection, MHD_HTTP_OK, response_of(health(), "application/json"));
    if (path == "/viewer.css")
      return send(connection, MHD_HTTP_OK, response_of(kViewerCss, "text/css; charset=utf-8"));
    if (path == "/viewer.js")
      return send(connection, MHD_HTTP_OK,
                  response_of(kViewerJs, "text/javascript; charset=utf-8"));
    if (path != "/")
      return refuse(connection, MHD_HTTP_NOT_FOUND,
                    "there are /, /stream.mjpg, /snapshot.jpg and /healthz");
    const auto accept = header_of(connection, "Accept");
    if (!accept || accept->find("text/html") == std::string_view::npos)
      return send_stream(connection);
    std::string page(kViewerHtml);
    // The token has no character that means anything in HTML (see check_rules).
    const std::string query = options_.token.empty() ? "" : "?token=" + options_.token;
    constexpr std::string_view kMark = "@TOKEN@";
    for (std::size_t at = page.find(kMark); at != std::string::npos; at = page.find(kMark, at))
      page.replace(at, kMark.size(), query);
    return send(connection, MHD_HTTP_OK, response_of(page, "text/html; charset=utf-8"));
  }

  MHD_Result send_stream(MHD_Connection* connection) {
    {
      const std::lock_guard lock(mutex_);
      if (viewers_ >= options_.max_viewers) {
        return refuse(connection, MHD_HTTP_SERVICE_UNAVAILABLE,
                      fmt::format("{} viewers are the limit", options_.max_viewers), "Retry-After",
                      "10");
      }
      ++viewers_;
    }
    auto viewer = std::make_unique<Viewer>();
    viewer->sink = this;
    const MHD_ConnectionInfo* info =
        MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    if (info != nullptr) viewer->socket = info->connect_fd;
    viewer->head = fmt::format("--{}\r\n", kBoundary);
    constexpr std::size_t kBlock = 65536;
    MHD_Response* response = MHD_create_response_from_callback(
        MHD_SIZE_UNKNOWN, kBlock, &HttpSink::read_stream, viewer.get(), &HttpSink::end_stream);
    if (response == nullptr) {
      const std::lock_guard lock(mutex_);
      --viewers_;
      return MHD_NO;
    }
    (void)viewer.release();  // end_stream's
    (void)MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT, kViewerSeconds);
    // No chunks, and the connection ends with the stream: what the simplest clients understand.
    (void)MHD_set_response_options(response, MHD_RF_HTTP_1_0_COMPATIBLE_STRICT, MHD_RO_END);
    (void)MHD_add_response_header(
        response, "Content-Type",
        fmt::format("multipart/x-mixed-replace; boundary={}", kBoundary).c_str());
    return send(connection, MHD_HTTP_OK, response);
  }

  MHD_Result send_snapshot(MHD_Connection* connection) {
    // An image that is replaced while it is encoded for somebody else is tried again.
    for (int attempt = 0; attempt < 10; ++attempt) {
      std::int64_t last = 0;
      if (const auto jpeg = wait_for_image(last, std::chrono::milliseconds(0))) {
        return send(
            connection, MHD_HTTP_OK,
            response_of({reinterpret_cast<const char*>(jpeg->data()), jpeg->size()}, "image/jpeg"));
      }
    }
    return refuse(connection, MHD_HTTP_SERVICE_UNAVAILABLE, "no image yet", "Retry-After", "1");
  }

  [[nodiscard]] std::string health() const {
    const std::lock_guard lock(mutex_);
    const double age = std::chrono::duration<double>(Clock::now() - newest_at_).count();
    const std::string_view state = frames_ == 0 ? "connecting" : age < 3 ? "live" : "stale";
    return fmt::format(
        "{{\"state\":\"{}\",\"frames\":{},\"viewers\":{},\"seconds_since_frame\":{}}}\n", state,
        frames_, viewers_, frames_ == 0 ? "null" : fmt::format("{:.3f}", age));
  }

  const std::string url_;
  const SinkOptions options_;
  ListenAddress address_;
  MHD_Daemon* daemon_ = nullptr;

  mutable std::mutex mutex_;         // of all below
  std::condition_variable changed_;  // a new image, a viewer gone, or closing
  std::condition_variable encoded_;
  std::vector<std::unique_ptr<Image>> images_;  // as many as are encoded at the same time, and two
  Image* newest_ = nullptr;
  Clock::time_point newest_at_;
  std::int64_t frames_ = 0;
  int viewers_ = 0;
  std::set<int> sockets_;  // of the open connections
  bool closing_ = false;
};

}  // namespace

std::unique_ptr<FrameSink> open_http_sink(const std::string& url, const SinkOptions& options) {
  options.check();
  return std::make_unique<HttpSink>(url, options);
}

}  // namespace tarsier
