// SPDX-License-Identifier: MIT
#include "http_server.h"

#include "tarsier/media/http_listen.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "request_target.h"
#include "testing_stream.h"
#include <arpa/inet.h>
#include <array>
#include <fstream>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

namespace tarsier::web {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

TEST(Target, IsDecodedAndChecked) {
  EXPECT_EQ(parse_target("/")->path, "/");
  EXPECT_EQ(parse_target("/a%20b/c?x=%31")->path, "/a b/c");
  EXPECT_EQ(parse_target("/a%20b/c?x=%31")->query, "x=%31");
  EXPECT_EQ(parse_target("/?x")->query, "x");
  for (const char* text :
       {"", "a", "//", "/a//b", "/a/", "/..", "/a/../b", "/%2e%2e/x", "/.", "/a%2Fb", "/a%5Cb",
        "/a\\b", "/%00", "/%0a", "/%", "/%4", "/%xx", "http://a/", "*"})
    EXPECT_FALSE(parse_target(text)) << text;
  EXPECT_FALSE(parse_target("/" + std::string(9000, 'a')));
}

TEST(Range, ParsesASingleRange) {
  bool unsatisfiable = false;
  const auto range = [&](std::string_view text, std::uint64_t size) {
    const auto found = parse_range(text, size, unsatisfiable);
    return found ? std::pair<std::int64_t, std::int64_t>(found->first, found->last)
                 : std::pair<std::int64_t, std::int64_t>(-1, unsatisfiable ? 416 : -1);
  };
  using P = std::pair<std::int64_t, std::int64_t>;
  EXPECT_EQ(range("bytes=0-0", 10), (P{0, 0}));
  EXPECT_EQ(range("bytes=2-", 10), (P{2, 9}));
  EXPECT_EQ(range("bytes=5-99", 10), (P{5, 9}));
  EXPECT_EQ(range("bytes=-3", 10), (P{7, 9}));
  EXPECT_EQ(range("bytes=-30", 10), (P{0, 9}));
  EXPECT_EQ(range("bytes=10-", 10), (P{-1, 416}));
  EXPECT_EQ(range("bytes=-0", 10), (P{-1, 416}));
  EXPECT_EQ(range("bytes=0-", 0), (P{-1, 416}));
  for (const char* text : {"", "bytes=", "bytes=a-b", "bytes=5-2", "bytes=0-1,3-4", "items=0-1",
                           "bytes=-", "bytes=99999999999999999999-"})
    EXPECT_EQ(range(text, 10), (P{-1, -1})) << text;
}

// A server with a handful of routes; requests are written to its socket as they are.
class HttpServerTest : public FolderTest {
 protected:
  void start(HttpServerOptions options = {}) {
    ListenAddress address = parse_listen_address("http://127.0.0.1:0/");
    options.sockets = {listen_on("http://127.0.0.1:0/", address)};
    options.spool_folder = folder_;
    options.rules.port = port_ = address.port;
    options.rules.hosts = {"localhost"};
    server_ = std::make_unique<HttpServer>(std::move(options), router_, sign_ins_, audit_);
  }
  [[nodiscard]] int connect() const {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in name{};
    name.sin_family = AF_INET;
    name.sin_port = htons(port_);
    name.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd, reinterpret_cast<sockaddr*>(&name), sizeof name), 0);
    timeval timeout{20, 0};
    ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &timeout, sizeof timeout);
    return fd;
  }
  static std::string rest_of(int fd) {
    std::string answer;
    std::array<char, 4096> buffer{};
    ssize_t count = 0;
    while ((count = ::recv(fd, buffer.data(), buffer.size(), 0)) > 0)
      answer.append(buffer.data(), static_cast<std::size_t>(count));
    ::close(fd);
    return answer;
  }
  [[nodiscard]] std::string ask(const std::string& line, const std::string& fields = "",
                                const std::string& body = "") const {
    const int fd = connect();
    const std::string text =
        line + " HTTP/1.1\r\nHost: localhost:" + std::to_string(port_) +
        "\r\nConnection: close\r\n" + fields +
        (body.empty() ? "" : "Content-Length: " + std::to_string(body.size()) + "\r\n") + "\r\n" +
        body;
    EXPECT_EQ(::send(fd, text.data(), text.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(text.size()));
    return rest_of(fd);
  }
  std::string bearer() const {
    std::string token = contents(folder_ + "/.studio/api-token");
    token.pop_back();
    return "Authorization: Bearer " + token + "\r\n";
  }

  Router router_;
  SignIns sign_ins_{folder_ + "/.studio"};
  AuditLog audit_{folder_ + "/audit.log"};
  std::unique_ptr<HttpServer> server_;
  std::uint16_t port_ = 0;
};

TEST_F(HttpServerTest, RepeatedFieldsAreRefused) {
  int handled = 0;
  router_.add(
      "POST", "/x",
      [&](const Request&) {
        ++handled;
        return no_content();
      },
      Access::kPublic);
  start();
  const std::string type = "Content-Type: application/json\r\n";
  EXPECT_THAT(ask("POST /x", type, "{}"), StartsWith("HTTP/1.1 204"));
  for (const char* fields : {"Content-Length: 0\r\n", "content-length: 2\r\n",
                             "Host: localhost\r\n", "Authorization: a\r\nAuthorization: b\r\n",
                             "Transfer-Encoding: chunked\r\nTransfer-Encoding: identity\r\n"}) {
    const std::string answer = ask("POST /x", type + fields, "{}");
    EXPECT_THAT(answer, StartsWith("HTTP/1.1 400")) << fields;
    EXPECT_THAT(answer, HasSubstr("Connection: close")) << fields;
  }
  EXPECT_EQ(handled, 1);
}

TEST_F(HttpServerTest, ErrorsOfHandlersBecomeResponses) {
  router_.add(
      "GET", "/http", [](const Request&) -> Response { throw HttpError(418, "no coffee"); },
      Access::kPublic);
  router_.add(
      "GET", "/other", [](const Request&) -> Response { throw std::runtime_error("secret path"); },
      Access::kPublic);
  start();
  EXPECT_THAT(ask("GET /http"),
              AllOf(StartsWith("HTTP/1.1 418"), HasSubstr("{\"error\":\"no coffee\"}")));
  EXPECT_THAT(ask("GET /other"), AllOf(StartsWith("HTTP/1.1 500"), Not(HasSubstr("secret path"))));
}

TEST_F(HttpServerTest, SlowHandlersAreNotClosed) {
  router_.add(
      "GET", "/slow",
      [](const Request&) {
        std::this_thread::sleep_for(std::chrono::milliseconds(2200));
        return json_response({{"done", true}});
      },
      Access::kPublic);
  HttpServerOptions options;
  options.stall_s = 1;
  options.head_s = 1;
  options.idle_s = 1;
  start(std::move(options));
  EXPECT_THAT(ask("GET /slow"), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("{\"done\":true}")));
}

TEST_F(HttpServerTest, BodiesOfFilesAreSpooledAndRemoved) {
  std::string seen;
  std::string where;
  router_.add("PUT", "/file",
              [&](const Request& request) {
                where = request.body_file;
                seen = contents(request.body_file);
                return no_content();
              },
              Access::kSignedIn, {.max_body = 1000, .spool = true, .types = {}});
  start();
  EXPECT_THAT(ask("PUT /file", bearer(), "some bytes"), StartsWith("HTTP/1.1 204"));
  EXPECT_EQ(seen, "some bytes");
  EXPECT_THAT(where, StartsWith(folder_));
  server_.reset();  // every request is over
  EXPECT_FALSE(std::filesystem::exists(where));
}

TEST_F(HttpServerTest, LargeBodiesAreRefusedBeforeTheyAreRead) {
  router_.add("PUT", "/file", [](const Request&) { return no_content(); }, Access::kSignedIn,
              {.max_body = 1000, .spool = true, .types = {}});
  start();
  const int fd = connect();
  const std::string text = "PUT /file HTTP/1.1\r\nHost: localhost:" + std::to_string(port_) +
                           "\r\n" + bearer() + "Content-Length: 100000000000\r\n\r\n";
  ASSERT_EQ(::send(fd, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  EXPECT_THAT(rest_of(fd), StartsWith("HTTP/1.1 413"));
}

TEST_F(HttpServerTest, SendsRangesOfFiles) {
  std::ofstream(folder_ + "/x.bin") << "0123456789";
  router_.add(
      "GET", "/x",
      [&](const Request&) {
        Response response;
        response.file = folder_ + "/x.bin";
        return response;
      },
      Access::kPublic);
  start();
  EXPECT_THAT(ask("GET /x"), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("Accept-Ranges: bytes"),
                                   HasSubstr("sandbox"), testing::EndsWith("\r\n\r\n0123456789")));
  EXPECT_THAT(ask("GET /x", "Range: bytes=2-4\r\n"),
              AllOf(StartsWith("HTTP/1.1 206"), HasSubstr("Content-Range: bytes 2-4/10"),
                    testing::EndsWith("\r\n\r\n234")));
  EXPECT_THAT(ask("GET /x", "Range: bytes=20-\r\n"),
              AllOf(StartsWith("HTTP/1.1 416"), HasSubstr("bytes */10")));
  EXPECT_THAT(ask("HEAD /x"), AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("Content-Length: 10"),
                                    testing::EndsWith("\r\n\r\n")));
  std::filesystem::remove(folder_ + "/x.bin");
  std::filesystem::create_symlink("/etc/passwd", folder_ + "/x.bin");
  EXPECT_THAT(ask("GET /x"), StartsWith("HTTP/1.1 404"));
}

TEST_F(HttpServerTest, StopEndsStreamsAndIdleConnections) {
  router_.add(
      "GET", "/stream",
      [](const Request&) {
        Response response;
        response.stream = std::make_unique<Endless>();
        return response;
      },
      Access::kPublic);
  start();
  const int idle = connect();
  const int streaming = connect();
  const std::string text =
      "GET /stream HTTP/1.1\r\nHost: localhost:" + std::to_string(port_) + "\r\n\r\n";
  ASSERT_EQ(::send(streaming, text.data(), text.size(), 0), static_cast<ssize_t>(text.size()));
  std::array<char, 100> some{};
  ASSERT_GT(::recv(streaming, some.data(), some.size(), 0), 0);
  server_->stop();
  EXPECT_EQ(rest_of(idle), "");
  (void)rest_of(streaming);  // comes to an end
  server_->stop();           // a second time does nothing
}

TEST_F(HttpServerTest, HeadsThatTakeTooLongAreClosed) {
  HttpServerOptions options;
  options.head_s = 0.2;
  start(std::move(options));
  const int fd = connect();
  ASSERT_EQ(::send(fd, "GET / HT", 8, 0), 8);
  EXPECT_EQ(rest_of(fd), "");
  EXPECT_EQ(server_->counters().evicted, 1U);
}

TEST_F(HttpServerTest, TheOldestConnectionIsEvicted) {
  HttpServerOptions options;
  options.max_per_address = 3;
  router_.add(
      "GET", "/",
      [](const Request&) {
        return json_response({{"here", true}});
      },
      Access::kPublic);
  start(std::move(options));
  std::array<int, 4> clients{};
  for (int& client : clients) client = connect();
  EXPECT_EQ(rest_of(clients[0]), "");
  EXPECT_THAT(ask("GET /"), StartsWith("HTTP/1.1 200"));
  for (std::size_t i = 1; i < clients.size(); ++i) ::close(clients[i]);
}

TEST_F(HttpServerTest, AuditLogIsReadBack) {
  audit_.write("sign-in", "192.0.2.1", {{"browser", std::string(1000, 'x')}, {"count", 2}});
  audit_.write("export", "", {});
  const auto lines = audit_.last(10);
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_EQ(lines[0]["event"], "sign-in");
  EXPECT_EQ(lines[0]["browser"].get<std::string>().size(), 300U);
  EXPECT_EQ(lines[1].contains("address"), false);
  EXPECT_EQ(audit_.last(1)[0]["event"], "export");
  std::ofstream(folder_ + "/audit.log", std::ios::app) << "half a li";
  EXPECT_EQ(audit_.last(10).size(), 2U);
}

}  // namespace
}  // namespace tarsier::web
