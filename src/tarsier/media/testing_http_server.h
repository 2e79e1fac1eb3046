// SPDX-License-Identifier: MIT
#pragma once

// A camera for tests: serves MJPEG on 127.0.0.1. It can freeze, send garbage, hang up, disappear
// and return.

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <arpa/inet.h>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <fcntl.h>
#include <functional>
#include <list>
#include <mutex>
#include <netinet/in.h>
#include <poll.h>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::test_support {

inline std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// A JPEG of one grey level, which survives compression: level = 8 * (number % 32).
inline std::string jpeg_of(int number, cv::Size size = {64, 48}) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", cv::Mat(size, CV_8UC3, cv::Scalar::all(8.0 * (number % 32))), bytes);
  return {bytes.begin(), bytes.end()};
}
inline int number_of(const cv::Mat& image) { return cvRound(cv::mean(image)[0] / 8); }

inline std::string part_of(const std::string& jpeg) {
  return "--frame\r\nContent-Type: image/jpeg\r\nContent-Length: " + std::to_string(jpeg.size()) +
         "\r\n\r\n" + jpeg + "\r\n";
}

class HttpServer {
 public:
  enum class Mode { kServe, kFreeze, kGarbage };
  struct Reply {
    std::string bytes;     // header, and body if there is no stream
    bool stream = false;   // frames follow ..
    bool chunked = false;  // .. in chunked coding
  };
  using Handler = std::function<Reply(const std::string& request)>;

  static Reply mjpeg() {
    return {"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n",
            true, false};
  }

  explicit HttpServer(Handler handler = [](const std::string&) { return mjpeg(); })
      : handler_(std::move(handler)) {
    start();
  }
  ~HttpServer() { stop(); }
  HttpServer(const HttpServer&) = delete;
  HttpServer& operator=(const HttpServer&) = delete;

  // Starts, or restarts on the same port.
  void start() {
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    const int on = 1;
    ::setsockopt(listener_, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(port_);
    socklen_t size = sizeof address;
    if (::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0 ||
        ::listen(listener_, 8) != 0 ||
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size) != 0) {
      throw std::runtime_error("test server: no port");
    }
    port_ = ntohs(address.sin_port);
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
  }
  // Disappears: cuts the connections and stops listening.
  void stop() {
    if (!thread_.joinable()) return;
    thread_.request_stop();
    thread_.join();
    thread_ = {};
  }

  [[nodiscard]] std::uint16_t port() const { return port_; }
  [[nodiscard]] std::string url(const std::string& path = "/cam") const {
    return "http://127.0.0.1:" + std::to_string(port_) + path;
  }
  [[nodiscard]] int connections() const { return connections_; }
  [[nodiscard]] int sent() const { return sent_; }
  [[nodiscard]] std::vector<std::string> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }

  std::atomic<Mode> mode{Mode::kServe};
  std::atomic<int> period_ms{20};
  std::atomic<bool> hang_up{false};     // once: cuts the connections, but keeps listening
  std::atomic<bool> one_client{false};  // like ffmpeg -listen 1: stops listening after the first
  std::atomic<int> width{64};

 private:
  struct Client {
    int descriptor = -1;
    std::string in;
    std::string out;
    bool streams = false;
    bool chunked = false;
    bool closes = false;  // once `out` is sent
  };

  static void put(Client& client, const std::string& bytes) {
    if (client.out.size() > (8U << 20U)) return;  // slow reader: frames are lost, as in a camera
    if (!client.chunked) {
      client.out += bytes;
      return;
    }
    // Chunk borders differ from frame borders.
    for (std::size_t at = 0; at < bytes.size(); at += 700) {
      const std::string chunk = bytes.substr(at, 700);
      char size[16];
      std::snprintf(size, sizeof size, "%zx\r\n", chunk.size());
      client.out += size + chunk + "\r\n";
    }
  }

  void run(const std::stop_token& stop) {
    std::list<Client> clients;
    auto next_frame = std::chrono::steady_clock::now();
    std::uint32_t noise = 12345;
    while (!stop.stop_requested()) {
      if (listener_ >= 0) {
        const int descriptor = ::accept4(listener_, nullptr, nullptr, SOCK_NONBLOCK | SOCK_CLOEXEC);
        if (descriptor >= 0) {
          Client client;
          client.descriptor = descriptor;
          clients.push_back(std::move(client));
          ++connections_;
          if (one_client) ::close(std::exchange(listener_, -1));
        }
      }
      const auto now = std::chrono::steady_clock::now();
      const bool is_due = now >= next_frame;
      if (is_due) next_frame = now + std::chrono::milliseconds(period_ms.load());
      const bool cuts = hang_up.exchange(false);
      std::string frame;
      if (is_due && mode == Mode::kServe) frame = part_of(jpeg_of(sent_++, {width, 48}));
      if (is_due && mode == Mode::kGarbage) {
        for (int i = 0; i < 5000; ++i) {
          noise = noise * 1664525U + 1013904223U;
          frame += static_cast<char>(noise >> 24U);
        }
      }
      for (auto client = clients.begin(); client != clients.end();) {
        bool dead = cuts;
        char buffer[4096];
        const ssize_t count =
            mode == Mode::kFreeze ? -1 : ::recv(client->descriptor, buffer, sizeof buffer, 0);
        if (count == 0) dead = true;
        if (count > 0 && !client->streams) {
          client->in.append(buffer, static_cast<std::size_t>(count));
          if (client->in.find("\r\n\r\n") != std::string::npos) {
            {
              const std::lock_guard lock(mutex_);
              requests_.push_back(client->in);
            }
            const Reply reply = handler_(client->in);
            client->in.clear();
            client->out += reply.bytes;
            client->chunked = reply.chunked;
            client->streams = reply.stream;
            client->closes = !reply.stream;
          }
        }
        if (client->streams && !frame.empty()) put(*client, frame);
        if (!client->out.empty() && mode != Mode::kFreeze) {
          const ssize_t sent =
              ::send(client->descriptor, client->out.data(), client->out.size(), MSG_NOSIGNAL);
          if (sent > 0) client->out.erase(0, static_cast<std::size_t>(sent));
          if (sent < 0 && errno != EAGAIN) dead = true;
        }
        if (client->closes && client->out.empty()) dead = true;
        if (dead) {
          ::close(client->descriptor);
          client = clients.erase(client);
        } else {
          ++client;
        }
      }
      ::poll(nullptr, 0, 2);
    }
    for (const Client& client : clients) ::close(client.descriptor);
    if (listener_ >= 0) ::close(std::exchange(listener_, -1));
  }

  const Handler handler_;
  int listener_ = -1;
  std::uint16_t port_ = 0;
  std::atomic<int> connections_{0};
  std::atomic<int> sent_{0};
  mutable std::mutex mutex_;
  std::vector<std::string> requests_;
  std::jthread thread_;
};

}  // namespace tarsier::test_support
