// SPDX-License-Identifier: MIT
#include "tarsier/media/http_sink.h"

#include "tarsier/core/elapsed.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/http_service.h"
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
using Jpeg = std::vector<std::uint8_t>;

constexpr std::string_view kBoundary = "tarsier-frame";

// --- the sink ---

class HttpSink final : public FrameSink {
 public:
  HttpSink(const std::string& url, const SinkOptions& options)
      : url_(url),
        options_(options),
        // More connections than viewers, so that further viewers can be refused with a reason; and
        // more in total than for one address, so that one address cannot block all others. One
        // address may be a proxy for all viewers.
        server_(url, {options.listen_all, options.token}, options.max_viewers + 16,
                options.max_viewers + 4, [this](MHD_Connection* connection, std::string_view path) {
                  return respond(connection, path);
                }) {}

  ~HttpSink() override { stop(); }

  std::string write(const cv::Mat& image, const Frame&) override {
    TARSIER_REQUIRE(
        image.dims == 2 && !image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
        "{}x{}, type {}: sinks take 8-bit grey or BGR", image.cols, image.rows, image.type());
    TARSIER_REQUIRE(server_.is_running(), "{} is finished", url_);
    Image* free = nullptr;
    {
      const std::lock_guard lock(mutex_);
      for (const auto& slot : images_) {
        if (slot.get() != newest_ && !slot->encoding) free = slot.get();
      }
      if (free == nullptr) free = images_.emplace_back(std::make_unique<Image>()).get();
      // Notifies those who wait for its encoding that it is replaced.
      free->number = 0;
      free->jpeg.reset();
    }
    // Nobody else uses the pixels now: the image is neither the newest nor being encoded.
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
    return fmt::format("{} ({} {}{})", server_.url(), viewers_,
                       viewers_ == 1 ? "viewer" : "viewers",
                       server_.is_open_to_all() ? ", every interface" : "");
  }

 private:
  static constexpr unsigned kViewerSeconds = 60;  // s until a viewer that reads nothing is closed

  struct Image {
    cv::Mat raw;
    std::int64_t number = 0;
    bool encoding = false;
    std::shared_ptr<const Jpeg> jpeg;
  };

  // One stream with a viewer.
  struct Viewer {
    HttpSink* sink = nullptr;
    int socket = -1;
    std::int64_t last = 0;  // number of the last sent image
    std::string head;       // of the part
    std::shared_ptr<const Jpeg> jpeg;
    std::size_t sent = 0;  // of head, jpeg and tail together
  };

  void stop() {
    if (!server_.is_running()) return;
    {
      std::unique_lock lock(mutex_);
      closing_ = true;
      changed_.notify_all();
      // Viewers that keep up get the whole last image; others are cut off.
      (void)changed_.wait_for(lock, std::chrono::milliseconds(300), [&] { return viewers_ == 0; });
    }
    server_.stop();
  }

  // The newest image that is newer than `last`, encoded; null if none came in time or the sink
  // closes.
  std::shared_ptr<const Jpeg> wait_for_image(std::int64_t& last,
                                             std::chrono::milliseconds timeout) {
    std::unique_lock lock(mutex_);
    const auto is_new = [&] { return closing_ || (newest_ != nullptr && newest_->number > last); };
    if (!changed_.wait_for(lock, timeout, is_new) || newest_ == nullptr || newest_->number <= last)
      return nullptr;
    Image* const slot = newest_;
    const std::int64_t number = slot->number;
    if (slot->encoding) {
      // Another thread is encoding it. If the image is replaced meanwhile, do not wait for it.
      encoded_.wait(lock, [&] { return slot->number != number || !slot->encoding; });
      if (slot->number != number || slot->jpeg == nullptr) return nullptr;
      last = number;
      return slot->jpeg;
    }
    if (slot->jpeg == nullptr) {
      slot->encoding = true;
      lock.unlock();
      std::shared_ptr<const Jpeg> jpeg;
      try {
        jpeg = std::make_shared<const Jpeg>(
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
  static ssize_t read_stream(void* cls, std::uint64_t, char* buffer, std::size_t max_bytes) {
    auto& viewer = *static_cast<Viewer*>(cls);
    // The boundary follows its part at once: browsers show an image only after the next boundary.
    static const std::string kTail = fmt::format("\r\n--{}\r\n", kBoundary);
    if (viewer.jpeg == nullptr) {
      viewer.jpeg = viewer.sink->wait_for_image(viewer.last, std::chrono::milliseconds(500));
      if (viewer.jpeg == nullptr) {
        // While no image is sent, this is the only way to notice that the viewer has left.
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
      if (viewer.sent >= start && viewer.sent < start + size && written < max_bytes) {
        const std::size_t from = viewer.sent - start;
        const std::size_t count = std::min(size - from, max_bytes - written);
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

  bool respond(MHD_Connection* connection, std::string_view path) {
    if (path == "/stream.mjpg") return send_stream(connection);
    if (path == "/snapshot.jpg") return send_snapshot(connection);
    if (path == "/healthz")
      return HttpService::send(connection, MHD_HTTP_OK, health(), "application/json");
    if (path == "/viewer.css")
      return HttpService::send(connection, MHD_HTTP_OK, kViewerCss, "text/css; charset=utf-8");
    if (path == "/viewer.js")
      return HttpService::send(connection, MHD_HTTP_OK, kViewerJs,
                               "text/javascript; charset=utf-8");
    if (path != "/")
      return HttpService::refuse(connection, MHD_HTTP_NOT_FOUND,
                                 "there are /, /stream.mjpg, /snapshot.jpg and /healthz");
    const auto accept = HttpService::header_of(connection, "Accept");
    if (!accept || accept->find("text/html") == std::string_view::npos)
      return send_stream(connection);
    std::string page(kViewerHtml);
    // The token has no character that is special in HTML (see HttpAccess).
    const std::string query = options_.token.empty() ? "" : "?token=" + options_.token;
    constexpr std::string_view kMark = "@TOKEN@";
    for (std::size_t at = page.find(kMark); at != std::string::npos; at = page.find(kMark, at))
      page.replace(at, kMark.size(), query);
    return HttpService::send(connection, MHD_HTTP_OK, page, "text/html; charset=utf-8");
  }

  bool send_stream(MHD_Connection* connection) {
    {
      const std::lock_guard lock(mutex_);
      if (viewers_ >= options_.max_viewers) {
        return HttpService::refuse(connection, MHD_HTTP_SERVICE_UNAVAILABLE,
                                   fmt::format("{} viewers are the limit", options_.max_viewers),
                                   "Retry-After", "10");
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
      return false;
    }
    (void)viewer.release();  // end_stream owns it
    (void)MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT, kViewerSeconds);
    // No chunks, and the connection ends with the stream: the simplest clients understand this.
    (void)MHD_set_response_options(response, MHD_RF_HTTP_1_0_COMPATIBLE_STRICT, MHD_RO_END);
    (void)MHD_add_response_header(
        response, "Content-Type",
        fmt::format("multipart/x-mixed-replace; boundary={}", kBoundary).c_str());
    return HttpService::send(connection, MHD_HTTP_OK, response);
  }

  bool send_snapshot(MHD_Connection* connection) {
    // Retry if an image is replaced while another thread encodes it.
    for (int attempt = 0; attempt < 10; ++attempt) {
      std::int64_t last = 0;
      if (const auto jpeg = wait_for_image(last, std::chrono::milliseconds(0))) {
        return HttpService::send(connection, MHD_HTTP_OK,
                                 {reinterpret_cast<const char*>(jpeg->data()), jpeg->size()},
                                 "image/jpeg");
      }
    }
    return HttpService::refuse(connection, MHD_HTTP_SERVICE_UNAVAILABLE, "no image yet",
                               "Retry-After", "1");
  }

  [[nodiscard]] std::string health() const {
    const std::lock_guard lock(mutex_);
    const double age = seconds_since(newest_at_);
    const std::string_view state = frames_ == 0 ? "connecting" : age < 3 ? "live" : "stale";
    return fmt::format(
        "{{\"state\":\"{}\",\"frames\":{},\"viewers\":{},\"seconds_since_frame\":{}}}\n", state,
        frames_, viewers_, frames_ == 0 ? "null" : fmt::format("{:.3f}", age));
  }

  const std::string url_;
  const SinkOptions options_;
  mutable std::mutex mutex_;         // protects the following members
  std::condition_variable changed_;  // a new image, a viewer left, or closing
  std::condition_variable encoded_;
  // As many as are encoded at the same time, plus two.
  std::vector<std::unique_ptr<Image>> images_;
  Image* newest_ = nullptr;
  Clock::time_point newest_at_;
  std::int64_t frames_ = 0;
  int viewers_ = 0;
  bool closing_ = false;
  HttpService server_;  // last: its threads use the members above
};

}  // namespace

std::unique_ptr<FrameSink> open_http_sink(const std::string& url, const SinkOptions& options) {
  options.check();
  return std::make_unique<HttpSink>(url, options);
}

}  // namespace tarsier
