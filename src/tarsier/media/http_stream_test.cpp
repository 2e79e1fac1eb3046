// SPDX-License-Identifier: MIT
#include "tarsier/media/http_stream.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/http_protocol.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_http_server.h"

#include <gtest/gtest.h>

#include <string>

namespace tarsier {
namespace {

using std::chrono::milliseconds;
using test_support::bytes_of;
using test_support::HttpServer;

TEST(Url, IsParsed) {
  const HttpUrl url = parse_url("HTTP://me:p%40ss:w@[::1]:8081/a/b?c=d#e", "http", 80);
  EXPECT_EQ(url.host, "::1");
  EXPECT_EQ(url.port, 8081);
  EXPECT_EQ(url.target, "/a/b?c=d");
  EXPECT_EQ(url.user, "me");
  EXPECT_EQ(url.password, "p@ss:w");
  EXPECT_EQ(url.host_header(), "[::1]:8081");
  const HttpUrl plain = parse_url("http://camera.local?x", "http", 80);
  EXPECT_EQ(plain.host, "camera.local");
  EXPECT_EQ(plain.port, 80);
  EXPECT_EQ(plain.target, "/?x");
  EXPECT_EQ(plain.host_header(), "camera.local");
}

TEST(Url, InvalidUrlsAreRefusedWithoutTheirPassword) {
  for (const char* text :
       {"http://", "http:///x", "http://h:0/", "http://h:99999/", "http://h:x/", "http://h/a b",
        "http://[::1/", "http://h/\r\nX: y", "ftp://h/", "http:/h"}) {
    EXPECT_THROW((void)parse_url(text, "http", 80), InputError) << text;
  }
  try {
    (void)parse_url("http://me:secret@h:0/", "http", 80);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()).find("secret"), std::string::npos);
  }
}

struct Parsed {
  HttpResponseParser parser;
  std::string body;
};

Parsed parse(const std::string& text, std::size_t piece) {
  Parsed result;
  std::vector<std::uint8_t> body;
  for (std::size_t at = 0; at < text.size(); at += piece) {
    result.parser.feed(bytes_of(std::string_view(text).substr(at, piece)), body);
  }
  result.body.assign(body.begin(), body.end());
  return result;
}

TEST(HttpResponse, BodyIsDecodedForEveryCodingAndSplit) {
  using State = HttpResponseParser::State;
  for (const std::size_t piece :
       {std::size_t{1}, std::size_t{2}, std::size_t{7}, std::size_t{1000}}) {
    const Parsed plain =
        parse("HTTP/1.0 200 OK\r\nContent-type: image/jpeg\r\n\r\nabc\r\n\r\ndef", piece);
    EXPECT_EQ(plain.body, "abc\r\n\r\ndef");
    EXPECT_EQ(plain.parser.content_type(), "image/jpeg");
    EXPECT_EQ(plain.parser.state(), State::kBody);
    const Parsed length = parse("HTTP/1.1 200 OK\r\nCONTENT-LENGTH: 3\r\n\r\nabcdef", piece);
    EXPECT_EQ(length.body, "abc");
    EXPECT_EQ(length.parser.state(), State::kDone);
    const Parsed chunked = parse(
        "HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n"
        "3;x=y\r\nabc\r\nA\r\n0123456789\r\n0\r\nTrailer: x\r\n\r\nmore",
        piece);
    EXPECT_EQ(chunked.body, "abc0123456789");
    EXPECT_EQ(chunked.parser.state(), State::kDone);
    const Parsed bare = parse("HTTP/1.1 404 Not Found\nX: y\n\nabc", piece);
    EXPECT_EQ(bare.parser.status(), 404);
    EXPECT_EQ(bare.parser.status_text(), "Not Found");
    EXPECT_EQ(bare.body, "abc");
  }
}

TEST(HttpResponse, InvalidAnswersAreBrokenAndBounded) {
  using State = HttpResponseParser::State;
  EXPECT_EQ(parse("SSH-2.0-OpenSSH_9.2\r\n", 5).parser.state(), State::kBroken);
  EXPECT_EQ(parse("HTTP/1.1 abc\r\n\r\n", 5).parser.state(), State::kBroken);
  EXPECT_EQ(parse("HTTP/1.1 200 OK\r\n" + std::string(100'000, 'x'), 1000).parser.state(),
            State::kBroken);
  EXPECT_EQ(parse("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n", 5).parser.state(),
            State::kBroken);
  EXPECT_EQ(
      parse("HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n" + std::string(9000, '1'), 100)
          .parser.state(),
      State::kBroken);
  Rng rng(1);
  for (int round = 0; round < 200; ++round) {
    std::string text = "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n0\r\n\r\n";
    for (int i = 0; i < 4; ++i) {
      text[static_cast<std::size_t>(rng.integer(0, static_cast<int>(text.size()) - 1))] =
          static_cast<char>(rng.integer(0, 255));
    }
    EXPECT_LE(parse(text, 3).body.size(), text.size());
  }
}

// A few such responses are waited out. A server that sends nothing else is given up.
TEST(HttpResponse, LimitsInterimResponses) {
  using State = HttpResponseParser::State;
  const std::string interim = "HTTP/1.1 100 \n\n";
  const std::string real = "HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc";
  std::string few;
  for (int i = 0; i < HttpResponseParser::kMaxInterim; ++i) {
    few += i % 2 == 0 ? interim : "HTTP/1.1 103 Early Hints\r\nLink: x\r\n\r\n";
  }
  std::string many;  // as many as fit into one read of 256 KiB
  for (int i = 0; i < 18'700; ++i) many += interim;
  for (const std::size_t piece : {std::size_t{1}, std::size_t{5}, std::size_t{1} << 20}) {
    const Parsed good = parse(few + real, piece);
    EXPECT_EQ(good.parser.state(), State::kDone) << piece;
    EXPECT_EQ(good.parser.status(), 200) << piece;
    EXPECT_EQ(good.body, "abc") << piece;
    const Parsed bad = parse(many + real, piece);
    EXPECT_EQ(bad.parser.state(), State::kBroken) << piece;
    EXPECT_EQ(bad.parser.error_message(), "sends interim answers without end");
    EXPECT_EQ(bad.body, "") << piece;
  }
}

// Reads until `count` frames arrived or another event happened.
struct Outcome {
  std::vector<int> numbers;
  LiveFailure failure;
  bool ended = false;
};
Outcome read_frames(LiveBackend& backend, std::size_t count) {
  Outcome outcome;
  const std::stop_token never;
  if (auto failure = backend.open(milliseconds(5000), never)) {
    outcome.failure = *failure;
    outcome.ended = true;
    return outcome;
  }
  for (int i = 0; i < 200 && outcome.numbers.size() < count && !outcome.ended; ++i) {
    LiveRead read = backend.read(milliseconds(100), never);
    if (read.kind == LiveRead::Kind::kFrame) {
      outcome.numbers.push_back(test_support::number_of(decode_image(read.image.encoded, "frame")));
    } else if (read.kind == LiveRead::Kind::kEnded) {
      outcome.failure = read.failure;
      outcome.ended = true;
    }
  }
  return outcome;
}
Outcome read_frames(const std::string& url, std::size_t count, const SourceOptions& options = {}) {
  const auto backend = make_http_backend(url, options);
  return read_frames(*backend, count);
}

TEST(HttpStream, ReadsMultipartPlainAndChunked) {
  for (const bool chunked : {false, true}) {
    HttpServer server([chunked](const std::string&) {
      HttpServer::Reply reply = HttpServer::mjpeg();
      reply.chunked = chunked;
      if (chunked)
        reply.bytes =
            "HTTP/1.1 200 OK\r\nContent-Type: application/octet-stream\r\n"
            "Transfer-Encoding: chunked\r\n\r\n";
      return reply;
    });
    const auto backend = make_http_backend(server.url(), {});
    const Outcome outcome = read_frames(*backend, 5);
    ASSERT_EQ(outcome.numbers.size(), 5U) << outcome.failure.reason;
    for (std::size_t i = 1; i < 5; ++i) EXPECT_GT(outcome.numbers[i], outcome.numbers[i - 1]);
    EXPECT_EQ(backend->detail(), "64x48 MJPEG over HTTP");
  }
}

TEST(HttpStream, PasswordIsSentOnlyToItsHost) {
  HttpServer other;
  HttpServer server([&other](const std::string& request) {
    if (request.starts_with("GET /moved")) return HttpServer::mjpeg();
    return HttpServer::Reply{
        "HTTP/1.1 302 Found\r\nLocation: " + other.url("/elsewhere") + "\r\n\r\n", false, false};
  });
  const std::string url = "http://me:secret@127.0.0.1:" + std::to_string(server.port()) + "/cam";
  const Outcome outcome = read_frames(url, 2);
  EXPECT_EQ(outcome.numbers.size(), 2U) << outcome.failure.reason;
  EXPECT_NE(server.requests().at(0).find("Authorization: Basic bWU6c2VjcmV0\r\n"),
            std::string::npos);
  EXPECT_EQ(other.requests().at(0).find("Authorization"), std::string::npos);
  EXPECT_TRUE(other.requests().at(0).starts_with("GET /elsewhere HTTP/1.1\r\n"));
}

TEST(HttpStream, LimitsRedirects) {
  HttpServer circle([](const std::string&) {
    return HttpServer::Reply{"HTTP/1.1 302 Found\r\nLocation: /again\r\n\r\n", false, false};
  });
  Outcome outcome = read_frames(circle.url(), 1);
  EXPECT_TRUE(outcome.ended && outcome.failure.permanent);
  EXPECT_EQ(circle.connections(), 4);
  for (const char* target : {"https://127.0.0.1/", "file:///etc/passwd", "//evil/", "gopher://x"}) {
    HttpServer server([target](const std::string&) {
      return HttpServer::Reply{
          std::string("HTTP/1.1 301 Moved\r\nLocation: ") + target + "\r\n\r\n", false, false};
    });
    outcome = read_frames(server.url(), 1);
    EXPECT_TRUE(outcome.ended && outcome.failure.permanent) << target;
  }
}

TEST(HttpStream, ErrorsNameWhyAServerIsNoCamera) {
  const auto reason = [](const std::string& answer) {
    HttpServer server([answer](const std::string&) {
      return HttpServer::Reply{answer, false, false};
    });
    const Outcome outcome = read_frames(server.url(), 1);
    EXPECT_TRUE(outcome.ended);
    return outcome.failure.reason;
  };
  EXPECT_EQ(reason("HTTP/1.1 404 Not Found\r\n\r\n"), "the server answers 404 Not Found");
  EXPECT_NE(reason("HTTP/1.1 401 Unauthorized\r\n\r\n").find("name and password"),
            std::string::npos);
  EXPECT_NE(reason("HTTP/1.1 200 OK\r\nContent-Type: text/html\r\n\r\n<html>").find("text/html"),
            std::string::npos);
  EXPECT_EQ(reason("SSH-2.0-OpenSSH\r\n"), "the server does not speak HTTP");
  EXPECT_EQ(reason("HTTP/1.1 200 OK\r\nContent-Length: 4\r\n\r\nabcd"),
            "the server ended the stream");
}

TEST(HttpStream, AMissingServerIsAPermanentFailure) {
  std::uint16_t port = 0;
  {
    const HttpServer gone;
    port = gone.port();
  }
  const Outcome outcome = read_frames("http://127.0.0.1:" + std::to_string(port) + "/", 1);
  EXPECT_TRUE(outcome.failure.permanent);
  EXPECT_TRUE(outcome.failure.unreachable);
  EXPECT_NE(outcome.failure.reason.find("connection refused"), std::string::npos);
}

TEST(HttpStream, SnapshotsArePolled) {
  std::atomic<int> number{1};
  HttpServer server([&number](const std::string&) {
    const std::string jpeg = test_support::jpeg_of(number++);
    return HttpServer::Reply{"HTTP/1.1 200 OK\r\nContent-Type: image/jpeg\r\nContent-Length: " +
                                 std::to_string(jpeg.size()) + "\r\n\r\n" + jpeg,
                             false, false};
  });
  SourceOptions options;
  options.fps = 50;
  const Outcome outcome = read_frames(server.url(), 4, options);
  EXPECT_EQ(outcome.numbers, (std::vector<int>{1, 2, 3, 4})) << outcome.failure.reason;
}

TEST(HttpStream, ProbeKeepsConnectionOfSingleClientServer) {
  HttpServer server;
  server.one_client = true;
  const auto backend = make_http_backend(server.url(), {});
  EXPECT_TRUE(backend->reachable(milliseconds(1000), {}));
  EXPECT_EQ(read_frames(*backend, 2).numbers.size(), 2U);
  EXPECT_EQ(server.connections(), 1);
}

}  // namespace
}  // namespace tarsier
