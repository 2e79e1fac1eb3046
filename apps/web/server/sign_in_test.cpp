// SPDX-License-Identifier: MIT
#include "sign_in.h"

#include "tarsier/media/http_service.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "router.h"
#include "secrets.h"
#include "sign_ins_api.h"
#include "testing_stream.h"
#include <filesystem>
#include <fstream>
#include <sys/stat.h>

namespace tarsier::web {
namespace {

using std::chrono::hours;
using std::chrono::milliseconds;
using std::chrono::seconds;

class SignInTest : public testing::Test {
 protected:
  SignIns make() {
    return SignIns(folder_, [this] { return now_; });
  }
  TemporaryFolder temporary_;
  std::string folder_ = temporary_.path() + "/.studio";
  WallClock::time_point now_ = WallClock::now();
};

TEST_F(SignInTest, ALinkSignsInOnce) {
  SignIns sign_ins = make();
  const std::string token = make_link_token(folder_);
  EXPECT_TRUE(looks_like_secret(token));
  const auto cookie = sign_ins.exchange(token);
  ASSERT_TRUE(cookie);
  EXPECT_TRUE(sign_ins.is_signed_in(*cookie));
  EXPECT_EQ(sign_ins.exchange(token), std::nullopt);
  EXPECT_FALSE(sign_ins.is_signed_in(token));
  EXPECT_FALSE(sign_ins.is_signed_in(""));
  EXPECT_FALSE(sign_ins.is_signed_in(*cookie + "0"));
}

TEST_F(SignInTest, OtherTokensAreRefused) {
  SignIns sign_ins = make();
  for (const std::string& token : {std::string(), std::string("../api-token"), std::string(64, 'A'),
                                   std::string(64, '0'), std::string("a\0b", 3)})
    EXPECT_EQ(sign_ins.exchange(token), std::nullopt) << token;
}

TEST_F(SignInTest, ALinkExpiresAfterADay) {
  SignIns sign_ins = make();
  const std::string token = make_link_token(folder_);
  now_ += SignIns::kLinkLife + seconds(2);
  EXPECT_EQ(sign_ins.exchange(token), std::nullopt);
  now_ -= SignIns::kLinkLife;
  EXPECT_EQ(sign_ins.exchange(token), std::nullopt);  // it was used up
}

TEST_F(SignInTest, SignInsSurviveRestartsForThirtyDays) {
  std::string cookie;
  {
    SignIns sign_ins = make();
    cookie = sign_ins.exchange(make_link_token(folder_)).value();
  }
  {
    SignIns sign_ins = make();
    EXPECT_TRUE(sign_ins.is_signed_in(cookie));
    now_ += SignIns::kCookieLife + seconds(2);
    EXPECT_FALSE(sign_ins.is_signed_in(cookie));
  }
  now_ -= hours(24);
  EXPECT_FALSE(make().is_signed_in(cookie));
}

TEST_F(SignInTest, SigningOutSurvivesARestart) {
  SignIns sign_ins = make();
  const std::string first = sign_ins.exchange(make_link_token(folder_)).value();
  const std::string second = sign_ins.exchange(make_link_token(folder_)).value();
  sign_ins.sign_out(first);
  EXPECT_FALSE(sign_ins.is_signed_in(first));
  EXPECT_TRUE(sign_ins.is_signed_in(second));
  EXPECT_FALSE(make().is_signed_in(first));
}

TEST_F(SignInTest, AreListedAndRevoked) {
  std::string first;
  std::string second;
  std::string third;
  {
    SignIns sign_ins = make();
    first = sign_ins.exchange(make_link_token(folder_), "192.0.2.7", "Mozilla/5.0\n(x)").value();
    now_ += seconds(5);
    second = sign_ins.exchange(make_link_token(folder_)).value();
    third = sign_ins.exchange(make_link_token(folder_)).value();
    const auto began = now_;
    now_ += seconds(60);
    EXPECT_TRUE(sign_ins.is_signed_in(first, "192.0.2.8"));
    const auto list = sign_ins.list();
    ASSERT_EQ(list.size(), 3U);
    EXPECT_EQ(list[0].id, SignIns::id_of(first));  // used last
    EXPECT_EQ(list[0].address, "192.0.2.7");
    EXPECT_EQ(list[0].used_from, "192.0.2.8");
    EXPECT_EQ(list[0].agent, "Mozilla/5.0?(x)");
    EXPECT_EQ(list[0].used, now_);
    EXPECT_EQ(list[0].began, began - seconds(5));
    EXPECT_EQ(list[1].used, began);
  }
  SignIns sign_ins = make();  // another address was worth a write, so that it is known
  EXPECT_EQ(sign_ins.list()[0].used_from, "192.0.2.8");
  EXPECT_TRUE(sign_ins.revoke(SignIns::id_of(first)));
  EXPECT_FALSE(sign_ins.revoke(SignIns::id_of(first)));
  EXPECT_FALSE(sign_ins.revoke(""));
  EXPECT_FALSE(sign_ins.is_signed_in(first));
  EXPECT_FALSE(make().is_signed_in(first));
  const std::string link = make_link_token(folder_);
  EXPECT_EQ(sign_ins.revoke_others(second), 1U);
  EXPECT_TRUE(sign_ins.is_signed_in(second));
  EXPECT_FALSE(sign_ins.is_signed_in(third));
  EXPECT_EQ(sign_ins.exchange(link), std::nullopt);
  EXPECT_EQ(make().list().size(), 1U);
}

TEST_F(SignInTest, ReadsSignInsOfEarlierVersions) {
  const std::string cookie = make().exchange(make_link_token(folder_)).value();
  for (const auto& entry : std::filesystem::directory_iterator(folder_ + "/sign-ins")) {
    std::string time;
    std::ifstream file(entry.path());
    std::getline(file, time);
    file.close();
    std::ofstream(entry.path()) << time << '\n';
  }
  SignIns sign_ins = make();
  EXPECT_TRUE(sign_ins.is_signed_in(cookie));
  EXPECT_EQ(sign_ins.list().at(0).address, "");
}

TEST_F(SignInTest, ANewApiTokenEndsTheOldOne) {
  SignIns sign_ins = make();
  std::string old;
  std::ifstream file(folder_ + "/api-token");
  std::getline(file, old);
  const std::string token = sign_ins.renew_api_token();
  EXPECT_NE(token, old);
  EXPECT_TRUE(sign_ins.is_api_token(token));
  EXPECT_FALSE(sign_ins.is_api_token(old));
  EXPECT_TRUE(make().is_api_token(token));
}

TEST(Agents, AreShortened) {
  EXPECT_EQ(short_agent("Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0"),
            "Firefox on Linux");
  EXPECT_EQ(short_agent("Mozilla/5.0 (Linux; Android 14; Pixel 8) AppleWebKit/537.36 (KHTML, like "
                        "Gecko) Chrome/130.0.0.0 Mobile Safari/537.36"),
            "Chrome on Android");
  EXPECT_EQ(short_agent("Mozilla/5.0 (iPhone; CPU iPhone OS 18_0 like Mac OS X) AppleWebKit/605 "
                        "(KHTML, like Gecko) Version/18.0 Mobile Safari/604.1"),
            "Safari on iPhone");
  EXPECT_EQ(short_agent("curl/8.1"), "curl");
  EXPECT_EQ(short_agent(""), "");
}

TEST_F(SignInTest, AStreamEndsWithItsSignIn) {
  SignIns sign_ins = make();
  const std::string cookie = sign_ins.exchange(make_link_token(folder_)).value();
  Request request;
  request.headers = {{"cookie", "tarsier_session=" + cookie}};
  const auto stream =
      while_signed_in(std::make_unique<Endless>(), sign_ins, request, milliseconds(0));
  char byte = 0;
  EXPECT_EQ(stream->read({&byte, 1}, -1), 1);
  sign_ins.sign_out(cookie);
  EXPECT_EQ(stream->read({&byte, 1}, -1), -1);
}

TEST_F(SignInTest, TheOldestEndsWhenThereAreTooMany) {
  constexpr std::size_t kMaxSignIns = 4;
  SignIns sign_ins(
      folder_, [this] { return now_; }, kMaxSignIns);
  std::string first;
  for (std::size_t i = 0; i <= kMaxSignIns; ++i) {
    const std::string cookie = sign_ins.exchange(make_link_token(folder_)).value();
    if (i == 0) first = cookie;
    now_ += seconds(1);
  }
  EXPECT_EQ(sign_ins.list().size(), kMaxSignIns);
  EXPECT_FALSE(sign_ins.is_signed_in(first));
}

TEST_F(SignInTest, FilesArePrivateAndHoldNoSecrets) {
  SignIns sign_ins = make();
  const std::string token = make_link_token(folder_);
  const std::string unused = make_link_token(folder_);
  const std::string cookie = sign_ins.exchange(token).value();
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_)) {
    struct stat state {};
    ASSERT_EQ(::stat(entry.path().c_str(), &state), 0);
    EXPECT_EQ(state.st_mode & 077U, 0U) << entry.path();
    for (const std::string& secret : {token, unused, cookie})
      EXPECT_EQ(entry.path().string().find(secret), std::string::npos);
    if (!entry.is_regular_file() || entry.path().filename() == "api-token") continue;
    std::ifstream file(entry.path());
    const std::string text((std::istreambuf_iterator<char>(file)),
                           std::istreambuf_iterator<char>());
    for (const std::string& secret : {token, unused, cookie})
      EXPECT_EQ(text.find(secret), std::string::npos) << entry.path();
  }
}

TEST_F(SignInTest, TheApiTokenSurvivesARestartAndIsPrivate) {
  std::string token;
  {
    SignIns sign_ins = make();
    std::ifstream file(folder_ + "/api-token");
    std::getline(file, token);
    EXPECT_TRUE(sign_ins.is_api_token(token));
    EXPECT_FALSE(sign_ins.is_api_token(token.substr(1)));
    EXPECT_FALSE(sign_ins.is_api_token(""));
  }
  ASSERT_EQ(::chmod((folder_ + "/api-token").c_str(), 0644), 0);
  EXPECT_TRUE(make().is_api_token(token));
  struct stat state {};
  ASSERT_EQ(::stat((folder_ + "/api-token").c_str(), &state), 0);
  EXPECT_EQ(state.st_mode & 0777U, 0600U);
  // What is no token is replaced: an empty one would let everybody in.
  std::ofstream(folder_ + "/api-token") << "\n";
  SignIns sign_ins = make();
  EXPECT_FALSE(sign_ins.is_api_token(""));
}

TEST(Csrf, IsDerivedFromTheCookie) {
  EXPECT_EQ(SignIns::csrf_of("a"), SignIns::csrf_of("a"));
  EXPECT_NE(SignIns::csrf_of("a"), SignIns::csrf_of("b"));
}

TEST(RateLimit, AllowsTenTriesPerMinuteAndAddress) {
  RateLimit limit(10, seconds(60));
  const RateLimit::Clock::time_point begin{};
  for (int i = 0; i < 10; ++i)
    EXPECT_EQ(limit.refused("192.0.2.1", begin + seconds(i)), std::nullopt) << i;
  EXPECT_EQ(limit.refused("192.0.2.1", begin + seconds(10)), 50);
  EXPECT_EQ(limit.refused("192.0.2.1", begin + seconds(59)), 1);
  EXPECT_EQ(limit.refused("192.0.2.2", begin + seconds(10)), std::nullopt);
  EXPECT_EQ(limit.refused("192.0.2.1", begin + seconds(60)), std::nullopt);
}

TEST(RateLimit, CountsIPv6ByNetwork) {
  RateLimit limit(1, seconds(60));
  const RateLimit::Clock::time_point begin{};
  EXPECT_EQ(limit.refused("2001:db8::1", begin), std::nullopt);
  EXPECT_NE(limit.refused("2001:db8::2", begin), std::nullopt);
  EXPECT_EQ(limit.refused("2001:db8:0:1::1", begin), std::nullopt);
}

TEST(RateLimit, KeepsItsCountsUnderManyAddresses) {
  RateLimit limit(1, seconds(60));
  const RateLimit::Clock::time_point begin{};
  for (int i = 0; i < 4096; ++i)
    (void)limit.refused("10.0." + std::to_string(i / 256) + "." + std::to_string(i % 256), begin);
  EXPECT_NE(limit.refused("10.0.0.0", begin), std::nullopt);
  EXPECT_NE(limit.refused("192.0.2.1", begin), std::nullopt);
  EXPECT_EQ(limit.refused("192.0.2.1", begin + seconds(60)), std::nullopt);
}

TEST(Cookie, IsFoundByItsName) {
  EXPECT_EQ(cookie_value("a=1; tarsier_session=xyz; b=2", "tarsier_session"), "xyz");
  EXPECT_EQ(cookie_value("xtarsier_session=1", "tarsier_session"), std::nullopt);
  EXPECT_EQ(cookie_value("tarsier_session", "tarsier_session"), std::nullopt);
  EXPECT_EQ(cookie_value("", "a"), std::nullopt);
}

TEST(Secrets, AreComparedWhole) {
  EXPECT_TRUE(equals_in_constant_time("abc", "abc"));
  EXPECT_FALSE(equals_in_constant_time("ab", "abc"));
  EXPECT_FALSE(equals_in_constant_time("abcd", "abc"));
  EXPECT_FALSE(equals_in_constant_time("abd", "abc"));
  EXPECT_NE(new_secret(), new_secret());
  EXPECT_TRUE(looks_like_secret(new_secret()));
}

}  // namespace
}  // namespace tarsier::web
