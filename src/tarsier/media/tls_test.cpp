// SPDX-License-Identifier: MIT
#include "tarsier/media/tls.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/child_capture.h"
#include "tarsier/media/http_stream.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/media/testing_http_server.h"
#include "tarsier/media/testing_tls_server.h"
#include "tarsier/media/tls_tunnel.h"
#include "tarsier/media/video_encoder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <ctime>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {
namespace {

using std::chrono::milliseconds;
using test_support::Certificate;
using test_support::HttpServer;
using test_support::TlsServer;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;

SourceOptions options_of(const StreamSecurity& security) {
  SourceOptions options;
  options.security = security;
  return options;
}

std::string video() {
  std::string reply =
      "HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n";
  for (int i = 1; i <= 20; ++i) reply += test_support::part_of(test_support::jpeg_of(i));
  return reply;
}

std::string redirect_to(const std::string& place) {
  return "HTTP/1.1 302 Found\r\nLocation: " + place + "\r\nContent-Length: 0\r\n\r\n";
}

// The result: a first frame, or the reason why there is none.
struct FirstFrame {
  cv::Mat image;
  std::string detail;
  LiveFailure failure;
};

FirstFrame open_and_read(LiveBackend& backend) {
  FirstFrame outcome;
  const std::stop_token never;
  if (auto failure = backend.open(milliseconds(5000), never)) {
    outcome.failure = *failure;
    return outcome;
  }
  for (int i = 0; i < 600; ++i) {
    LiveRead read = backend.read(milliseconds(100), never);
    if (read.kind == LiveRead::Kind::kEnded) {
      outcome.failure = read.failure;
      return outcome;
    }
    if (read.kind == LiveRead::Kind::kNothing) continue;
    outcome.image =
        read.image.encoded.empty() ? read.image.image : decode_image(read.image.encoded, "frame");
    outcome.detail = backend.detail();
    return outcome;
  }
  outcome.failure.reason = "nothing came";
  return outcome;
}

class TlsTest : public FolderTest {
 protected:
  TlsTest() { std::ofstream(options_.security.ca_file) << authority_.pem(); }

  [[nodiscard]] FirstFrame read_http(const std::string& url) const {
    return read_http(url, options_);
  }
  [[nodiscard]] static FirstFrame read_http(const std::string& url, const SourceOptions& options) {
    const auto backend = make_http_backend(url, options);
    return open_and_read(*backend);
  }
  // Through FFmpeg in the capture program.
  [[nodiscard]] FirstFrame read_child(const std::string& url, SourceOptions options) const {
    options.capture_program = capture_program_;
    const auto backend = make_child_backend(ffmpeg_command(url, options));
    return open_and_read(*backend);
  }

  const std::string capture_program_ =
      (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "tarsier-capture").string();
  const Certificate authority_{"Test authority"};
  const Certificate good_{"127.0.0.1", &authority_};
  SourceOptions options_ = options_of({.ca_file = path("ca.pem")});
};

TEST_F(TlsTest, AcceptsServerWithCertificateOfCaFile) {
  const TlsServer server(good_, [](const std::string&) { return video(); });
  const FirstFrame outcome = read_http(server.url("/cam", "me:secret@"));
  EXPECT_EQ(outcome.image.size(), cv::Size(64, 48)) << outcome.failure.reason;
  EXPECT_EQ(outcome.detail, "64x48 MJPEG over HTTPS");
  ASSERT_THAT(server.requests(), SizeIs(1));
  EXPECT_THAT(server.requests()[0],
              AllOf(StartsWith("GET /cam HTTP/1.1\r\n"),
                    HasSubstr("Host: 127.0.0.1:" + std::to_string(server.port()) + "\r\n"),
                    HasSubstr("Authorization: Basic bWU6c2VjcmV0\r\n")));
  const Certificate named("localhost", &authority_);
  const TlsServer other(named, [](const std::string&) { return video(); });
  EXPECT_FALSE(read_http("https://localhost:" + std::to_string(other.port()) + "/").image.empty());
}

// Neither the request nor the password is sent to a server with a wrong certificate.
TEST_F(TlsTest, RejectsUntrustedServersBeforeSending) {
  const Certificate wrong_name("camera.example", &authority_);
  const Certificate expired("127.0.0.1", &authority_, std::time(nullptr) - 3600);
  const Certificate untrusted("127.0.0.1");
  struct Case {
    const Certificate& certificate;
    const char* expected;
  };
  for (const Case& one :
       {Case{wrong_name, "its certificate is not for '127.0.0.1'"}, Case{expired, "has expired"},
        Case{untrusted, "its certificate is not trusted (signed by an unknown authority)"}}) {
    const TlsServer server(one.certificate, [](const std::string&) { return video(); });
    const FirstFrame outcome = read_http(server.url("/", "me:secret@"));
    EXPECT_TRUE(outcome.image.empty());
    EXPECT_TRUE(outcome.failure.permanent);
    EXPECT_THAT(outcome.failure.reason,
                AllOf(HasSubstr(one.expected), HasSubstr("option 'insecure'")));
    EXPECT_THAT(server.requests(), IsEmpty());
    EXPECT_FALSE(
        read_http(server.url(), options_of({.ca_file = "", .insecure = true})).image.empty());
  }
  // Not signed by the system's authorities.
  const TlsServer server(good_, [](const std::string&) { return video(); });
  const FirstFrame outcome = read_http(server.url(), SourceOptions{});
  EXPECT_THAT(outcome.failure.reason, HasSubstr("option 'ca_file'"));
  EXPECT_THAT(server.requests(), IsEmpty());
}

TEST_F(TlsTest, ACaFileWithoutCertificatesIsAnError) {
  for (const std::string& file : {path("none.pem"), path("empty.pem")}) {
    if (file == path("empty.pem")) std::ofstream(file) << "";
    try {
      (void)make_http_backend("https://127.0.0.1/", options_of({.ca_file = file}));
      FAIL();
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(file));
    }
  }
}

TEST_F(TlsTest, RedirectsStayEncryptedAndDoNotForwardThePassword) {
  HttpServer plain;
  const TlsServer redirecting(good_, [&](const std::string&) { return redirect_to(plain.url()); });
  const FirstFrame outcome = read_http(redirecting.url("/", "me:secret@"));
  EXPECT_TRUE(outcome.failure.permanent);
  EXPECT_THAT(outcome.failure.reason, HasSubstr("only https is followed"));
  EXPECT_EQ(plain.connections(), 0);

  const TlsServer other(good_, [](const std::string&) { return video(); });
  const TlsServer moved(good_, [&](const std::string&) { return redirect_to(other.url("/x")); });
  EXPECT_FALSE(read_http(moved.url("/", "me:secret@")).image.empty());
  ASSERT_THAT(other.requests(), SizeIs(1));
  EXPECT_THAT(other.requests()[0], Not(HasSubstr("Authorization")));

  HttpServer upgrades([&](const std::string&) {
    return HttpServer::Reply{redirect_to(other.url("/y")), false, false};
  });
  EXPECT_FALSE(read_http(upgrades.url()).image.empty());
}

TEST_F(TlsTest, EachSnapshotUsesASeparateConnection) {
  const TlsServer server(good_, [](const std::string&) {
    const std::string jpeg = test_support::jpeg_of(3);
    return "HTTP/1.1 200 OK\r\nContent-Type: image/jpeg\r\nContent-Length: " +
           std::to_string(jpeg.size()) + "\r\n\r\n" + jpeg;
  });
  SourceOptions options = options_;
  options.fps = 50;
  const auto backend = make_http_backend(server.url(), options);
  EXPECT_FALSE(open_and_read(*backend).image.empty());
  for (int i = 0; i < 600 && server.requests().size() < 3; ++i) {
    ASSERT_NE(backend->read(milliseconds(100), {}).kind, LiveRead::Kind::kEnded);
  }
  EXPECT_GE(server.requests().size(), 3U);
}

// FFmpeg does not check the URLs inside a playlist.
TEST_F(TlsTest, PlaylistsAreRefusedUnlessInsecure) {
  const TlsServer server(good_, [](const std::string&) {
    return std::string(
        "HTTP/1.1 200 OK\r\nContent-Type: application/vnd.apple.mpegurl\r\n\r\n#EXTM3U\n");
  });
  const FirstFrame outcome = read_http(server.url());
  EXPECT_TRUE(outcome.failure.permanent);
  EXPECT_THAT(outcome.failure.reason, AllOf(HasSubstr("playlist"), HasSubstr("option 'insecure'")));
}

TEST_F(TlsTest, FfmpegReadsOtherVideosWithVerification) {
  {
    VideoEncoder encoder(path("v.avi"), "v.avi", {64, 48}, {.extension = ".avi"});
    for (int i = 0; i < 50; ++i) encoder.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(120)));
    encoder.finish();
  }
  const std::string reply =
      "HTTP/1.1 200 OK\r\nContent-Type: video/x-msvideo\r\n\r\n" + contents(path("v.avi"));
  const TlsServer server(good_, [&](const std::string&) { return reply; });
  SourceOptions options = options_;
  options.capture_program = capture_program_;
  const FirstFrame outcome = read_http(server.url("/v.avi", "me:secret@"), options);
  ASSERT_FALSE(outcome.image.empty()) << outcome.failure.reason;
  EXPECT_NEAR(cv::mean(outcome.image)[1], 120, 4);
  ASSERT_GE(server.requests().size(), 2U);
  EXPECT_THAT(server.requests()[1],
              AllOf(StartsWith("GET /v.avi HTTP/1.1\r\n"),
                    HasSubstr("Host: 127.0.0.1:" + std::to_string(server.port()) + "\r\n")));
}

// The same with the capture program, where FFmpeg's own options do not apply.
TEST_F(TlsTest, CaptureProgramRejectsUntrustedServersAndRedirects) {
  const TlsServer server(good_, [](const std::string&) { return video(); });
  EXPECT_FALSE(read_child(server.url(), options_).image.empty());
  FirstFrame outcome = read_child(server.url("/", "me:secret@"), SourceOptions{});
  EXPECT_THAT(outcome.failure.reason, HasSubstr("option 'ca_file'"));
  EXPECT_THAT(server.requests(), SizeIs(1)) << "the first, with the CA file";
  EXPECT_FALSE(
      read_child(server.url(), options_of({.ca_file = "", .insecure = true})).image.empty());

  HttpServer plain;
  const TlsServer redirecting(good_, [&](const std::string&) { return redirect_to(plain.url()); });
  outcome = read_child(redirecting.url(), options_);
  EXPECT_THAT(outcome.failure.reason, HasSubstr("redirects"));
  EXPECT_EQ(plain.connections(), 0);

  // rtsps: FFmpeg 5.1 accepts any certificate.
  const Certificate untrusted("127.0.0.1");
  const TlsServer camera(untrusted, [](const std::string&) { return std::string(); });
  outcome = read_child(camera.url("/", "me:secret@", "rtsps"), options_);
  EXPECT_THAT(outcome.failure.reason, HasSubstr("its certificate is not trusted"));
  EXPECT_THAT(camera.requests(), IsEmpty());
}

TEST_F(TlsTest, TheTunnelForwardsOtherAnswers) {
  const std::string answer = "RTSP/1.0 200 OK\r\nCSeq: 1\r\n\r\n" + std::string(300'000, 'x');
  std::string reply = answer;
  const TlsServer server(good_, [&](const std::string&) { return reply; });
  const TlsTunnel tunnel("127.0.0.1", server.port(), options_.security);
  const auto ask = [&] {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(tunnel.port());
    EXPECT_EQ(::connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    const std::string request = "OPTIONS * RTSP/1.0\r\nCSeq: 1\r\n\r\n";
    EXPECT_EQ(::send(fd, request.data(), request.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(request.size()));
    std::string got;
    std::array<char, 65536> buffer;
    for (ssize_t count = 0; (count = ::recv(fd, buffer.data(), buffer.size(), 0)) > 0;)
      got.append(buffer.data(), static_cast<std::size_t>(count));
    ::close(fd);
    return got;
  };
  EXPECT_EQ(ask(), answer);
  EXPECT_EQ(tunnel.error_message(), "");
  reply = "RTSP/1.0 302 Moved\r\nLocation: rtsp://127.0.0.1/\r\n\r\n";
  EXPECT_EQ(ask(), "");
  EXPECT_THAT(tunnel.error_message(), HasSubstr("redirects"));
}

}  // namespace
}  // namespace tarsier
