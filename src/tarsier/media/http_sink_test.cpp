// SPDX-License-Identifier: MIT
#include "tarsier/media/http_sink.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <arpa/inet.h>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <future>
#include <memory>
#include <netinet/in.h>
#include <nlohmann/json.hpp>
#include <optional>
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

namespace tarsier {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr int kTimeout_ms = 300'000;  // only reached if something hangs

int port_of(const FrameSink& sink) {
  const std::string text = sink.description();
  const std::size_t slash = text.find('/', 7);
  return std::stoi(text.substr(text.rfind(':', slash) + 1));
}

// A client that uses the socket directly.
class Client {
 public:
  // `from`: the last number of the client's own address, 127.0.0.x.
  explicit Client(int port, bool ipv6 = false, int from = 1)
      : fd_(::socket(ipv6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    if (from != 1) {
      ::sockaddr_in own{};
      own.sin_family = AF_INET;
      own.sin_addr.s_addr = htonl(0x7f000000U + static_cast<std::uint32_t>(from));
      if (::bind(fd_, reinterpret_cast<::sockaddr*>(&own), sizeof own) != 0)
        throw std::runtime_error("bind");
    }
    ::sockaddr_in v4{};
    v4.sin_family = AF_INET;
    v4.sin_port = htons(static_cast<std::uint16_t>(port));
    v4.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ::sockaddr_in6 v6{};
    v6.sin6_family = AF_INET6;
    v6.sin6_port = htons(static_cast<std::uint16_t>(port));
    v6.sin6_addr = in6addr_loopback;
    const int result = ipv6 ? ::connect(fd_, reinterpret_cast<::sockaddr*>(&v6), sizeof v6)
                            : ::connect(fd_, reinterpret_cast<::sockaddr*>(&v4), sizeof v4);
    if (result != 0) throw std::runtime_error("connect");
  }
  ~Client() { ::close(fd_); }
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  void send(std::string_view text) const {
    if (::send(fd_, text.data(), text.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(text.size()))
      throw std::runtime_error("send");
  }
  void get(const std::string& path, const std::string& headers = "Host: 127.0.0.1\r\n",
           const std::string& method = "GET") const {
    send(method + " " + path + " HTTP/1.1\r\n" + headers + "\r\n");
  }
  // Reads more bytes into buffer(); false at the end of the stream.
  bool more() {
    ::pollfd ready{fd_, POLLIN, 0};
    if (::poll(&ready, 1, kTimeout_ms) != 1) throw std::runtime_error("nothing came");
    std::array<char, 65536> chunk;
    const ssize_t got = ::recv(fd_, chunk.data(), chunk.size(), 0);
    if (got <= 0) return false;
    buffer_.append(chunk.data(), static_cast<std::size_t>(got));
    return true;
  }
  std::string line() {
    while (buffer_.find("\r\n") == std::string::npos) {
      if (!more()) throw std::runtime_error("ended within a line");
    }
    const std::size_t end = buffer_.find("\r\n");
    std::string result = buffer_.substr(0, end);
    buffer_.erase(0, end + 2);
    return result;
  }
  std::string bytes(std::size_t count) {
    while (buffer_.size() < count) {
      if (!more()) throw std::runtime_error("ended within a body");
    }
    std::string result = buffer_.substr(0, count);
    buffer_.erase(0, count);
    return result;
  }
  std::string rest() {
    while (more()) {
    }
    return std::exchange(buffer_, {});
  }

 private:
  int fd_;
  std::string buffer_;
};

struct Reply {
  int status = 0;
  std::string headers;
  std::string body;
};

std::string header(const std::string& headers, const std::string& name) {
  const std::size_t at = headers.find("\n" + name + ": ");
  if (at == std::string::npos) return {};
  const std::size_t start = at + name.size() + 3;
  return headers.substr(start, headers.find('\n', start) - start);
}

Reply read_head(Client& client) {
  Reply reply;
  const std::string status = client.line();
  EXPECT_THAT(status, StartsWith("HTTP/1.1 "));
  reply.status = std::stoi(status.substr(9));
  for (std::string line = client.line(); !line.empty(); line = client.line())
    reply.headers += "\n" + line;
  reply.headers += "\n";
  return reply;
}

Reply ask(int port, const std::string& path, const std::string& headers = "Host: 127.0.0.1\r\n",
          const std::string& method = "GET") {
  Client client(port);
  client.get(path, headers, method);
  Reply reply = read_head(client);
  const std::string length = header(reply.headers, "Content-Length");
  if (method != "HEAD" && !length.empty()) reply.body = client.bytes(std::stoul(length));
  return reply;
}

cv::Mat decoded(const std::string& jpeg) {
  return decode_image({reinterpret_cast<const std::uint8_t*>(jpeg.data()), jpeg.size()}, "part");
}

// The next part of a stream, after the head and the first boundary were read.
std::string read_part(Client& client, const std::string& boundary) {
  std::string line = client.line();
  EXPECT_EQ(line, "Content-Type: image/jpeg");
  line = client.line();
  EXPECT_THAT(line, StartsWith("Content-Length: "));
  const std::size_t size = std::stoul(line.substr(16));
  EXPECT_EQ(client.line(), "");
  std::string jpeg = client.bytes(size);
  EXPECT_EQ(client.line(), "");
  EXPECT_EQ(client.line(), "--" + boundary);
  return jpeg;
}

std::string start_stream(Client& client, const std::string& path = "/stream.mjpg",
                         const std::string& headers = "Host: 127.0.0.1\r\n") {
  client.get(path, headers);
  const Reply reply = read_head(client);
  EXPECT_EQ(reply.status, 200);
  const std::string type = header(reply.headers, "Content-Type");
  EXPECT_THAT(type, StartsWith("multipart/x-mixed-replace; boundary="));
  EXPECT_THAT(reply.headers, Not(HasSubstr("chunked")));
  std::string boundary = type.substr(type.find('=') + 1);
  EXPECT_EQ(client.line(), "--" + boundary);
  return boundary;
}

cv::Mat uniform(int value, int width = 64, int height = 48) {
  return {height, width, CV_8UC3, cv::Scalar::all(value)};
}

nlohmann::json health(int port) { return nlohmann::json::parse(ask(port, "/healthz").body); }

// Polls until `done`; the time limit of the test ends an endless wait.
void wait_until(const std::function<bool()>& done) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(kTimeout_ms);
  while (!done()) {
    ASSERT_LT(std::chrono::steady_clock::now(), end) << "never happened";
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

std::unique_ptr<FrameSink> open_local(const SinkOptions& options = {}) {
  return open_http_sink("http://127.0.0.1:0/", options);
}

TEST(HttpSink, StreamsEachImageAsAPartWithItsLength) {
  const auto sink = open_local();
  EXPECT_THAT(sink->description(), HasSubstr("(0 viewers)"));
  (void)sink->write(uniform(40), {});
  Client client(port_of(*sink));
  const std::string boundary = start_stream(client);
  for (int value = 40; value < 240; value += 40) {
    if (value > 40) (void)sink->write(uniform(value), {});
    const cv::Mat image = decoded(read_part(client, boundary));
    EXPECT_EQ(image.size(), cv::Size(64, 48));
    EXPECT_NEAR(image.at<cv::Vec3b>(20, 20)[1], value, 3);
  }
  EXPECT_THAT(sink->description(), HasSubstr("(1 viewer)"));
  sink->finish();
  EXPECT_EQ(client.rest(), "");
  EXPECT_THROW((void)sink->write(uniform(1), {}), std::invalid_argument);
}

TEST(HttpSink, EarlyViewerWaitsForFirstImage) {
  const auto sink = open_local();
  Client client(port_of(*sink));
  auto first = std::async(std::launch::async, [&] {
    const std::string boundary = start_stream(client);
    return read_part(client, boundary);
  });
  wait_until([&] { return health(port_of(*sink))["viewers"] == 1; });
  EXPECT_EQ(health(port_of(*sink))["state"], "connecting");
  (void)sink->write(cv::Mat(48, 64, CV_8UC1, cv::Scalar(90)), {});
  EXPECT_NEAR(decoded(first.get()).at<cv::Vec3b>(20, 20)[0], 90, 3);
}

TEST(HttpSink, SlowViewerDelaysNeitherProducerNorOthers) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  cv::Mat noise(480, 640, CV_8UC3);  // about 500 kB as JPEG: more than the socket's buffer
  cv::randu(noise, 0, 256);
  (void)sink->write(noise, {});
  Client slow(port);
  slow.get("/stream.mjpg");
  wait_until([&] { return health(port)["viewers"] == 1; });
  // Writes a hundred images. The other viewer receives each image before the next is written.
  Client quick(port);
  const std::string boundary = start_stream(quick);
  (void)read_part(quick, boundary);
  for (int i = 0; i < 100; ++i) {
    (void)sink->write(i == 99 ? uniform(200) : noise, {});
    const std::string jpeg = read_part(quick, boundary);
    if (i == 99) {
      EXPECT_NEAR(decoded(jpeg).at<cv::Vec3b>(9, 9)[0], 200, 3);
    }
  }
  // The slow client reads again: it gets a few complete images, and the last one.
  const Reply head = read_head(slow);
  const std::string type = header(head.headers, "Content-Type");
  const std::string mark = type.substr(type.find('=') + 1);
  EXPECT_EQ(slow.line(), "--" + mark);
  int parts = 0;
  cv::Mat image;
  do {
    image = decoded(read_part(slow, mark));
    ++parts;
  } while (image.size() != cv::Size(64, 48));
  EXPECT_LT(parts, 30);
}

TEST(HttpSink, DetectsDisconnectWithoutImages) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  (void)sink->write(uniform(1), {});
  {
    Client client(port);
    const std::string boundary = start_stream(client);
    (void)read_part(client, boundary);
    EXPECT_EQ(health(port)["viewers"], 1);
  }
  wait_until([&] { return health(port)["viewers"] == 0; });
}

TEST(HttpSink, FinishDoesNotWaitForStalledViewers) {
  auto sink = open_local();
  const int port = port_of(*sink);
  cv::Mat noise(480, 640, CV_8UC3);
  cv::randu(noise, 0, 256);
  std::vector<std::unique_ptr<Client>> clients;
  for (int i = 0; i < 4; ++i) {
    clients.push_back(std::make_unique<Client>(port));
    clients.back()->get("/stream.mjpg");
  }
  wait_until([&] { return health(port)["viewers"] == 4; });
  for (int i = 0; i < 20; ++i) (void)sink->write(noise, {});
  const Client idle(port);  // has sent no request
  sink.reset();             // hangs here if the idle client is not closed
  EXPECT_THROW(Client{port}, std::runtime_error);
}

TEST(HttpSink, SnapshotIsTheNewestImage) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  EXPECT_EQ(ask(port, "/snapshot.jpg").status, 503);
  (void)sink->write(uniform(10), {});
  (void)sink->write(uniform(170), {});
  for (int i = 0; i < 2; ++i) {
    const Reply reply = ask(port, "/snapshot.jpg");
    EXPECT_EQ(reply.status, 200);
    EXPECT_EQ(header(reply.headers, "Content-Type"), "image/jpeg");
    EXPECT_NEAR(decoded(reply.body).at<cv::Vec3b>(5, 5)[0], 170, 3);
  }
}

TEST(HttpSink, HealthReportsFramesViewersAndAge) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  EXPECT_TRUE(health(port)["seconds_since_frame"].is_null());
  (void)sink->write(uniform(10), {});
  const Reply reply = ask(port, "/healthz");
  EXPECT_EQ(header(reply.headers, "Content-Type"), "application/json");
  const nlohmann::json state = nlohmann::json::parse(reply.body);
  EXPECT_EQ(state["frames"], 1);
  EXPECT_EQ(state["viewers"], 0);
  EXPECT_GE(state["seconds_since_frame"].get<double>(), 0);
  EXPECT_TRUE(state["state"] == "live" || state["state"] == "stale");
}

TEST(HttpSink, BrowsersGetAPageAndOthersTheStream) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  (void)sink->write(uniform(10), {});
  const Reply page =
      ask(port, "/", "Host: localhost:" + std::to_string(port) + "\r\nAccept: text/html,*/*\r\n");
  EXPECT_EQ(page.status, 200);
  EXPECT_THAT(header(page.headers, "Content-Type"), StartsWith("text/html"));
  EXPECT_THAT(page.body, HasSubstr("src=\"stream.mjpg\""));
  EXPECT_THAT(page.body, Not(HasSubstr("<script>")));
  EXPECT_THAT(header(page.headers, "Content-Security-Policy"), HasSubstr("default-src 'none'"));
  EXPECT_THAT(header(page.headers, "Content-Security-Policy"), Not(HasSubstr("unsafe")));
  EXPECT_EQ(header(page.headers, "X-Content-Type-Options"), "nosniff");
  EXPECT_EQ(header(page.headers, "Cache-Control"), "no-store");
  EXPECT_EQ(ask(port, "/viewer.css").status, 200);
  EXPECT_EQ(ask(port, "/viewer.js").status, 200);
  Client client(port);
  const std::string boundary = start_stream(client, "/", "Host: 127.0.0.1\r\nAccept: */*\r\n");
  (void)read_part(client, boundary);
}

TEST(HttpSink, RejectsForeignHostsAndOrigins) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  const std::string own = "127.0.0.1:" + std::to_string(port);
  for (const char* host : {"evil.example", "evil.example:80", "127.0.0.1.evil.example",
                           "localhost.evil", "127.0.0.1:80x", "[::1", "", "192.168.0.1"}) {
    EXPECT_EQ(ask(port, "/healthz", std::string("Host: ") + host + "\r\n").status / 100, 4) << host;
  }
  EXPECT_EQ(ask(port, "/healthz", "Host: evil.example\r\n").status, 421);
  EXPECT_EQ(ask(port, "/healthz", "").status, 400);
  for (const std::string& host :
       {std::string("localhost"), own, std::string("LOCALHOST:1"), std::string("[::1]:80")}) {
    EXPECT_EQ(ask(port, "/healthz", "Host: " + host + "\r\n").status, 200) << host;
  }
  EXPECT_EQ(ask(port, "/healthz", "Host: " + own + "\r\nOrigin: http://" + own + "\r\n").status,
            200);
  for (const char* origin :
       {"http://evil.example", "null", "https://localhost", "http://127.0.0.1:1"}) {
    EXPECT_EQ(ask(port, "/healthz", "Host: " + own + "\r\nOrigin: " + origin + "\r\n").status, 403)
        << origin;
  }
}

TEST(HttpSink, AcceptsOnlyGetAndHeadOfKnownPaths) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  (void)sink->write(uniform(10), {});
  for (const char* path : {"/x", "/../etc/passwd", "/stream.mjpg/", "//", "/%2e%2e/"})
    EXPECT_EQ(ask(port, path).status, 404) << path;
  const Reply post = ask(port, "/healthz", "Host: 127.0.0.1\r\nContent-Length: 5\r\n", "POST");
  EXPECT_EQ(post.status, 405);
  EXPECT_EQ(header(post.headers, "Allow"), "GET, HEAD");
  EXPECT_EQ(ask(port, "/healthz", "Host: 127.0.0.1\r\n", "DELETE").status, 405);
  const Reply head = ask(port, "/snapshot.jpg", "Host: 127.0.0.1\r\n", "HEAD");
  EXPECT_EQ(head.status, 200);
  EXPECT_NE(header(head.headers, "Content-Length"), "0");
  EXPECT_EQ(ask(port, "/stream.mjpg", "Host: 127.0.0.1\r\n", "HEAD").status, 200);
  wait_until([&] { return health(port)["viewers"] == 0; });
}

TEST(HttpSink, IdleConnectionsDoNotBlockOthers) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  std::vector<std::unique_ptr<Client>> idle;  // more than the max number of all viewers
  for (int i = 0; i < 40; ++i) idle.push_back(std::make_unique<Client>(port, false, 2));
  Client other(port, false, 3);
  other.get("/healthz");
  EXPECT_EQ(read_head(other).status, 200);
  // Connections beyond the limit were closed, and the others are closed soon.
  for (const auto& client : idle) {
    bool open = true;
    try {
      while (open) open = client->more();
    } catch (const std::runtime_error& error) {
      FAIL() << error.what();
    }
  }
}

TEST(HttpSink, HandlesInvalidAndOversizedRequests) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  for (const std::string& text :
       {std::string("\0\1\2\3\r\n\r\n", 8), std::string("GET\r\n\r\n"), std::string(200'000, 'A'),
        "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + std::string(100'000, 'x') + "\r\n\r\n",
        std::string("GET /healthz HTTP/9.9\r\nHost: 127.0.0.1\r\n\r\n")}) {
    Client client(port);
    try {
      client.send(text);
    } catch (const std::runtime_error&) {  // closed before all was read
    }
  }
  EXPECT_EQ(ask(port, "/healthz").status, 200);
}

TEST(HttpSink, RequiresTheTokenIfThereIsOne) {
  SinkOptions options;
  options.token = "0123456789abcdef-secret";
  const auto sink = open_local(options);
  const int port = port_of(*sink);
  (void)sink->write(uniform(10), {});
  for (const char* path :
       {"/", "/stream.mjpg", "/snapshot.jpg", "/healthz", "/nothing",
        "/healthz?token=", "/healthz?token=0123456789abcdef-secreT",
        "/healthz?token=0123456789abcdef-secret0", "/healthz?token=0123456789abcdef"}) {
    EXPECT_EQ(ask(port, path).status, 401) << path;
  }
  EXPECT_EQ(ask(port, "/healthz?token=" + options.token).status, 200);
  EXPECT_EQ(
      ask(port, "/healthz", "Host: 127.0.0.1\r\nAuthorization: Bearer " + options.token + "\r\n")
          .status,
      200);
  EXPECT_EQ(
      ask(port, "/healthz", "Host: 127.0.0.1\r\nAuthorization: Basic " + options.token + "\r\n")
          .status,
      401);
  const Reply page =
      ask(port, "/?token=" + options.token, "Host: 127.0.0.1\r\nAccept: text/html\r\n");
  EXPECT_THAT(page.body, HasSubstr("src=\"stream.mjpg?token=" + options.token + "\""));
}

TEST(HttpSink, OtherInterfacesNeedListenAllAndAToken) {
  const auto reason = [](const std::string& url, bool all,
                         const std::string& token) -> std::string {
    SinkOptions options;
    options.listen_all = all;
    options.token = token;
    try {
      return "opened " + open_http_sink(url, options)->description();
    } catch (const UsageError& error) {
      return error.what();
    }
  };
  const std::string token(32, 't');
  EXPECT_THAT(reason("http://0.0.0.0:0/", false, ""), HasSubstr("option 'listen_all'"));
  EXPECT_THAT(reason("http://0.0.0.0:0/", false, token), HasSubstr("option 'listen_all'"));
  EXPECT_THAT(reason("http://0.0.0.0:0/", true, ""), HasSubstr("openssl rand -hex 16"));
  EXPECT_THAT(reason("http://127.0.0.1:0/", true, ""), HasSubstr("openssl rand -hex 16"));
  EXPECT_THAT(reason("http://127.0.0.1:0/", true, "short"), HasSubstr("openssl rand -hex 16"));
  EXPECT_THAT(reason("http://127.0.0.1:0/", false, std::string(20, '"')), HasSubstr("token"));
  EXPECT_THAT(reason("http://127.0.0.1:0/", true, token), HasSubstr("every interface"));
  SinkOptions options;
  options.listen_all = true;
  options.token = token;
  const auto sink = open_http_sink("http://127.0.0.1:0/", options);
  EXPECT_EQ(ask(port_of(*sink), "/healthz?token=" + token, "Host: pi.local:8080\r\n").status, 200)
      << "this machine may have any name";
  EXPECT_EQ(ask(port_of(*sink), "/healthz", "Host: pi.local:8080\r\n").status, 401);
}

TEST(HttpSink, InvalidAddressesAreUsageErrors) {
  for (const char* url :
       {"http://", "http://127.0.0.1:99999/", "http://127.0.0.1:x/", "http://user@127.0.0.1/",
        "http://example.com:8080/", "http://[::1/", "http://[zz]:80/", "http://127.0.0.1:8080/path",
        "http://127.0.0.1:8080/?a", "https://127.0.0.1/", "http://127.1:80/",
        "http://127.0.0.1:-1/", "http://127.0.0.1:/"}) {
    EXPECT_THROW((void)open_http_sink(url, {}), UsageError) << url;
  }
}

TEST(HttpSink, PortInUseIsAnOutputError) {
  const auto sink = open_local();
  const std::string url = "http://127.0.0.1:" + std::to_string(port_of(*sink)) + "/";
  try {
    (void)open_http_sink(url, {});
    FAIL();
  } catch (const OutputError& error) {
    EXPECT_THAT(error.what(), HasSubstr(url + ": the port is taken"));
  }
}

TEST(HttpSink, ViewersBeyondTheLimitAreRefused) {
  SinkOptions options;
  options.max_viewers = 2;
  const auto sink = open_local(options);
  const int port = port_of(*sink);
  (void)sink->write(uniform(10), {});
  Client a(port);
  Client b(port);
  (void)start_stream(a);
  (void)start_stream(b);
  EXPECT_EQ(ask(port, "/stream.mjpg").status, 503);
  EXPECT_EQ(ask(port, "/snapshot.jpg").status, 200);
}

TEST(HttpSink, ListensOnIpv6Loopback) {
  std::unique_ptr<FrameSink> sink;
  try {
    sink = open_http_sink("http://[::1]:0/", {});
  } catch (const OutputError&) {
    GTEST_SKIP() << "no IPv6 here";
  }
  EXPECT_THAT(sink->description(), StartsWith("http://[::1]:"));
  (void)sink->write(uniform(10), {});
  Client client(port_of(*sink), true);
  client.get("/snapshot.jpg", "Host: [::1]:" + std::to_string(port_of(*sink)) + "\r\n");
  EXPECT_EQ(read_head(client).status, 200);
}

TEST(HttpSink, ViewersMayJoinAndLeaveWhileStreaming) {
  const auto sink = open_local();
  const int port = port_of(*sink);
  std::atomic<bool> done = false;
  std::thread producer([&] {
    for (int i = 0; !done; ++i) (void)sink->write(uniform(i % 256, 32 + i % 3, 32), {});
  });
  std::vector<std::thread> viewers;
  std::atomic<int> parts = 0;
  for (int v = 0; v < 4; ++v) {
    viewers.emplace_back([&] {
      for (int round = 0; round < 5; ++round) {
        Client client(port);
        const std::string boundary = start_stream(client);
        for (int i = 0; i < 5; ++i) {
          if (!decoded(read_part(client, boundary)).empty()) ++parts;
        }
        EXPECT_EQ(ask(port, "/healthz").status, 200);
      }
    });
  }
  for (std::thread& viewer : viewers) viewer.join();
  done = true;
  producer.join();
  sink->finish();
  EXPECT_EQ(parts, 100);
}

}  // namespace
}  // namespace tarsier
