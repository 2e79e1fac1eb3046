// SPDX-License-Identifier: MIT
#include "tarsier/media/crop_server.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/sha256.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <arpa/inet.h>
#include <array>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

namespace tarsier {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

class CropServerTest : public FolderTest {
 protected:
  CropServerTest() {
    options_.url = "http://127.0.0.1:0/";
    options_.folder = path("crops");
  }
  static cv::Mat image(int gray) { return {24, 60, CV_8UC3, cv::Scalar::all(gray)}; }

  // The complete response to a request for `url`.
  static std::string get(const std::string& url, const std::string& more = {}) {
    const std::size_t slash = url.find('/', 7);
    const std::size_t colon = url.rfind(':', slash);
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    ::sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(std::stoi(url.substr(colon + 1))));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd, reinterpret_cast<::sockaddr*>(&address), sizeof address), 0);
    const std::string request = "GET " + url.substr(slash) + " HTTP/1.1\r\nHost: 127.0.0.1\r\n" +
                                more + "Connection: close\r\n\r\n";
    EXPECT_EQ(::send(fd, request.data(), request.size(), 0), static_cast<ssize_t>(request.size()));
    std::string answer;
    std::array<char, 4096> bytes{};
    for (ssize_t got = 0; (got = ::recv(fd, bytes.data(), bytes.size(), 0)) > 0;)
      answer.append(bytes.data(), static_cast<std::size_t>(got));
    ::close(fd);
    return answer;
  }
  static std::string body(const std::string& answer) {
    return answer.substr(answer.find("\r\n\r\n") + 4);
  }

  CropServerOptions options_;
};

TEST_F(CropServerTest, ServesAnImageByItsHash) {
  CropServer server(options_);
  const std::string hash = server.add(image(90));
  EXPECT_EQ(server.add(image(90)), hash);
  const std::string answer = get(server.url_of(hash));
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("Content-Type: image/jpeg"));
  Sha256 sum;
  sum.add(body(answer));
  EXPECT_EQ(sum.hex(), hash);
}

TEST_F(CropServerTest, ServesNothingElse) {
  CropServer server(options_);
  const std::string url = server.url_of(server.add(image(90)));
  const std::string base = url.substr(0, url.find("/crop/"));
  for (const std::string& path :
       {std::string("/"), std::string("/crop/"), std::string("/crop/../../etc/passwd.jpg"),
        "/crop/" + std::string(64, 'A') + ".jpg", "/crop/" + std::string(64, 'a') + ".jpg"}) {
    EXPECT_THAT(get(base + path), StartsWith("HTTP/1.1 404")) << path;
  }
  EXPECT_THAT(get(url, "Origin: http://evil.example\r\n"), StartsWith("HTTP/1.1 403"));
}

TEST_F(CropServerTest, RequiresTheToken) {
  options_.access.token = "0123456789abcdef";
  CropServer server(options_);
  const std::string url = server.url_of(server.add(image(90)));
  EXPECT_THAT(get(url), StartsWith("HTTP/1.1 401"));
  EXPECT_THAT(get(url, "Authorization: Bearer 0123456789abcdef\r\n"), StartsWith("HTTP/1.1 200"));
}

TEST_F(CropServerTest, RemoteAccessRequiresToken) {
  options_.url = "http://0.0.0.0:0/";
  EXPECT_THROW(CropServer{options_}, UsageError);
  options_.access.listen_all = true;
  EXPECT_THROW(CropServer{options_}, UsageError);
}

TEST_F(CropServerTest, KeepsALimitedNumberOverARestart) {
  options_.max_crops = 2;
  {
    CropServer server(options_);
    (void)server.add(image(10));
    (void)server.add(image(20));
  }
  CropServer server(options_);
  const std::string last = server.add(image(30));
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(options_.folder),
                          std::filesystem::directory_iterator()),
            2);
  EXPECT_THAT(get(server.url_of(last)), StartsWith("HTTP/1.1 200"));
}

}  // namespace
}  // namespace tarsier
