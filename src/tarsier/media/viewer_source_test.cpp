// SPDX-License-Identifier: MIT
#include "tarsier/media/viewer_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_log.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_timeout.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <fcntl.h>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

using std::chrono::milliseconds;
using test_support::kTimeout;
using ::testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;
using Clock = std::chrono::steady_clock;

Bytes jpeg(int value, cv::Size size = {64, 48}) {
  return encode_image(".jpg", cv::Mat(size, CV_8UC3, cv::Scalar::all(value)), "test", 90);
}

Bytes length(std::size_t value) {
  return {static_cast<std::uint8_t>(value >> 24U), static_cast<std::uint8_t>(value >> 16U),
          static_cast<std::uint8_t>(value >> 8U), static_cast<std::uint8_t>(value)};
}

Bytes record(const Bytes& bytes) {
  Bytes result = length(bytes.size());
  result.insert(result.end(), bytes.begin(), bytes.end());
  return result;
}

TEST(ViewerParser, NewestRecordIsIndependentOfSplits) {
  Bytes stream = record(jpeg(10));
  const Bytes second = record({1, 2, 3});
  stream.insert(stream.end(), second.begin(), second.end());
  for (const std::size_t size : {std::size_t{1}, std::size_t{7}, stream.size()}) {
    ViewerParser parser;
    std::int64_t count = 0;
    for (std::size_t at = 0; at < stream.size(); at += size)
      count += parser.feed(
          std::span<const std::uint8_t>(stream).subspan(at, std::min(size, stream.size() - at)));
    EXPECT_EQ(count, 2);
    EXPECT_TRUE(parser.has_image());
    EXPECT_EQ(parser.take(), (Bytes{1, 2, 3}));
    EXPECT_FALSE(parser.has_image());
    EXPECT_FALSE(parser.is_broken());
  }
}

TEST(ViewerParser, ZeroAndExcessiveLengthsEndIt) {
  for (const std::size_t bad :
       {std::size_t{0}, ViewerParser::kMaxBytes + 1, std::size_t{0xffffffff}}) {
    ViewerParser parser;
    EXPECT_EQ(parser.feed(record({1})), 1);
    EXPECT_EQ(parser.feed(length(bad)), 0);
    EXPECT_TRUE(parser.is_broken());
    EXPECT_EQ(parser.feed(record({1})), 0);
    EXPECT_EQ(parser.take(), Bytes{1}) << "what came before is kept";
  }
  ViewerParser parser;
  EXPECT_EQ(parser.feed(length(ViewerParser::kMaxBytes)), 0);
  EXPECT_FALSE(parser.is_broken());
  EXPECT_LE(parser.held_bytes(), 4096U) << "a length alone takes no memory";
}

TEST(ViewerImage, OnlyCompleteJpegsAreAccepted) {
  const Bytes good = jpeg(80);
  EXPECT_EQ(viewer_image_error(good), "");
  EXPECT_NE(viewer_image_error(Bytes(good.begin(), good.begin() + 100)), "");
  EXPECT_NE(viewer_image_error(Bytes(good.begin(), good.end() - 40)), "");
  EXPECT_NE(viewer_image_error(Bytes{'h', 'e', 'l', 'l', 'o'}), "");
  EXPECT_NE(viewer_image_error({}), "");
  const Bytes png = encode_image(".png", cv::Mat(8, 8, CV_8UC3, cv::Scalar(0)), "test");
  EXPECT_EQ(viewer_image_error(png), "is PNG, not JPEG");
}

class ViewerSourceTest : public ::testing::Test {
 protected:
  ViewerSourceTest() {
    int ends[2];
    if (::pipe(ends) != 0) throw std::runtime_error("no pipe");
    to_ = ends[1];
    SourceOptions options;
    options.stall_s = 0.2;
    options.give_up_s = 0;
    const int fd = ends[0];
    source_ = make_live_source(
        "viewer:me", "viewer:me", [fd] { return make_viewer_backend(fd, "viewer:me"); }, options);
  }
  ~ViewerSourceTest() override {
    source_.reset();
    hang_up();
  }
  const ScopedLogLevel log_level_{LogLevel::kOff};
  void send(const Bytes& bytes) const {
    ASSERT_EQ(::write(to_, bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  void hang_up() {
    if (to_ >= 0) ::close(std::exchange(to_, -1));
  }
  int value_of_next() {
    const auto frame = source_->next(kTimeout, {});
    return frame ? frame->image.at<cv::Vec3b>(5, 5)[1] : -1;
  }
  static bool eventually(const std::function<bool()>& condition) {
    const auto end = Clock::now() + kTimeout;
    while (Clock::now() < end) {
      if (condition()) return true;
      std::this_thread::sleep_for(milliseconds(2));
    }
    return false;
  }
  bool reaches(SourceState state) {
    return eventually([&] { return source_->status().state == state; });
  }

  int to_ = -1;
  std::unique_ptr<FrameSource> source_;
};

TEST_F(ViewerSourceTest, ReturnsTheNewestImageAndTurnsStaleInSilence) {
  EXPECT_TRUE(source_->is_live());
  send(record(jpeg(40)));
  EXPECT_NEAR(value_of_next(), 40, 2);
  for (const int value : {60, 80, 100}) send(record(jpeg(value)));
  int last = 0;
  while (last < 98) last = value_of_next();
  EXPECT_NEAR(last, 100, 2);
  ASSERT_TRUE(reaches(SourceState::kStale));
  EXPECT_GE(source_->status().age_s, 0.2);
  send(record(jpeg(120)));
  EXPECT_NEAR(value_of_next(), 120, 2);
  ASSERT_TRUE(reaches(SourceState::kLive));
  EXPECT_EQ(source_->status().reopened, 0) << "there is nothing to open again";
}

TEST_F(ViewerSourceTest, InvalidRecordsAreSkipped) {
  const Bytes good = jpeg(50);
  send(record({'n', 'o'}));
  send(record(Bytes(good.begin(), good.end() - 60)));
  send(record(good));
  EXPECT_NEAR(value_of_next(), 50, 2);
  // All segments are present, but a code table is invalid. The decoder finds this.
  Bytes broken = jpeg(90);
  const Bytes table{0xff, 0xc4};
  const auto at = std::search(broken.begin(), broken.end(), table.begin(), table.end());
  ASSERT_GT(broken.end() - at, 21);
  std::fill(at + 5, at + 21, std::uint8_t{0xff});
  ASSERT_EQ(viewer_image_error(broken), "");
  const ScopedLogLevel warnings(LogLevel::kWarning);
  ::testing::internal::CaptureStderr();
  for (int i = 0; i < 20; ++i) {
    const std::int64_t before = source_->status().received;
    send(record(broken));
    ASSERT_TRUE(eventually([&] { return source_->status().received > before; }));
    EXPECT_FALSE(source_->next(milliseconds(0), {}));
  }
  send(record(good));
  EXPECT_NEAR(value_of_next(), 50, 2);
  const std::string log_output = ::testing::internal::GetCapturedStderr();
  EXPECT_THAT(log_output, HasSubstr("it is skipped"));
  EXPECT_LE(std::count(log_output.begin(), log_output.end(), '\n'), 3) << log_output;
}

TEST_F(ViewerSourceTest, EndOfInputEndsTheSource) {
  send(record(jpeg(50)));
  EXPECT_NEAR(value_of_next(), 50, 2);
  hang_up();
  EXPECT_THROW(value_of_next(), SourceLostError);
  EXPECT_EQ(source_->status().state, SourceState::kLost);
  EXPECT_TRUE(source_->ended());
}

TEST_F(ViewerSourceTest, InvalidLengthEndsSource) {
  send(record(jpeg(50)));
  EXPECT_NEAR(value_of_next(), 50, 2);
  send(length(ViewerParser::kMaxBytes + 1));
  try {
    value_of_next();
    FAIL() << "it goes on";
  } catch (const SourceLostError& error) {
    EXPECT_THAT(error.what(), HasSubstr("16 MB"));
  }
}

TEST_F(ViewerSourceTest, EndBeforeFirstImageIsInputError) {
  hang_up();
  EXPECT_THROW(value_of_next(), InputError);
}

TEST_F(ViewerSourceTest, AStopWakesTheReader) {
  std::stop_source stop;
  std::thread other([&] {
    std::this_thread::sleep_for(milliseconds(20));
    stop.request_stop();
  });
  const auto begin = Clock::now();
  EXPECT_FALSE(source_->next(kTimeout, stop.get_token()));
  EXPECT_LT(Clock::now() - begin, kTimeout / 2);
  other.join();
}

TEST(ViewerScheme, NamesAndTheEnvironmentAreChecked) {
  const std::vector<Scheme> schemes{viewer_scheme()};
  EXPECT_EQ(classify_source("viewer:ab12", schemes), SourceKind::kScheme);
  const auto error_of = [&](const std::string& text) {
    try {
      (void)open_source(text, {}, schemes);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  ::unsetenv("TARSIER_VIEWER");
  EXPECT_THAT(error_of("viewer:ab12"), HasSubstr("TARSIER_VIEWER is not set"));
  for (const char* bad : {"viewer:", "viewer:a/b", "viewer:a b", "viewer:../x"})
    EXPECT_THAT(error_of(bad), HasSubstr("expected viewer:NAME")) << bad;
  EXPECT_THAT(error_of("viewer:" + std::string(65, 'a')), HasSubstr("expected viewer:NAME"));
  for (const char* bad : {"2", "-1", "x", "3x", "60000"}) {
    ::setenv("TARSIER_VIEWER", bad, 1);
    EXPECT_THAT(error_of("viewer:ab12"), HasSubstr("no open file descriptor")) << bad;
  }
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  ::setenv("TARSIER_VIEWER", std::to_string(ends[0]).c_str(), 1);
  {
    const auto source = open_source("viewer:ab12", {}, schemes);
    EXPECT_TRUE(source->is_live());
    EXPECT_THAT(error_of("viewer:cd34"), HasSubstr("is open already"));
  }
  EXPECT_LT(::fcntl(ends[0], F_GETFD), 0) << "it is closed with the source";
  ::close(ends[1]);
  ::unsetenv("TARSIER_VIEWER");
}

}  // namespace
}  // namespace tarsier
