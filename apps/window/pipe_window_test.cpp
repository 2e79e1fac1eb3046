// SPDX-License-Identifier: MIT
#include "pipe_window.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_log.h"
#include "tarsier/media/image_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include "ui/window_lines.h"
#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <fcntl.h>
#include <memory>
#include <nlohmann/json.hpp>
#include <poll.h>
#include <stdexcept>
#include <string>
#include <sys/socket.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace tarsier::window {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using Clock = std::chrono::steady_clock;

struct Record {
  char kind = 0;
  std::string payload;
  [[nodiscard]] json parsed() const { return json::parse(payload); }
  [[nodiscard]] std::uint32_t number(std::size_t at) const {
    std::uint32_t value = 0;
    for (std::size_t i = at; i < at + 4; ++i)
      value = value << 8U | static_cast<std::uint8_t>(payload.at(i));
    return value;
  }
  [[nodiscard]] cv::Mat image() const {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(payload.data());
    return decode_image({bytes + 8, payload.size() - 8}, "the window's image");
  }
};

// The other side of a pipe window.
class PipeWindowTest : public ::testing::Test {
 protected:
  PipeWindowTest() {
    std::signal(SIGPIPE, SIG_IGN);  // as the program does
  }
  ~PipeWindowTest() override {
    window_.reset();
    close_fd(to_window_);
    close_fd(from_window_);
  }

  const ScopedLogLevel log_level_{LogLevel::kOff};

  void open(WindowOptions options = {}) {
    std::array<int, 2> in{};
    std::array<int, 2> out{};
    ASSERT_EQ(::pipe(in.data()), 0);
    ASSERT_EQ(::pipe(out.data()), 0);
    to_window_ = in[1];
    from_window_ = out[0];
    ::fcntl(from_window_, F_SETFL, O_NONBLOCK);
    if (options.title.empty()) options.title = "Tarsier test";
    window_ = make_pipe_window({in[0], out[1]}, options);
  }
  static void close_fd(int& fd) {
    if (fd >= 0) ::close(std::exchange(fd, -1));
  }

  void send(const std::string& lines) const {
    ASSERT_EQ(::write(to_window_, lines.data(), lines.size()), static_cast<ssize_t>(lines.size()));
  }
  std::vector<Event> events() { return window_->poll(milliseconds(0)); }

  // What has come by now.
  std::vector<Record> records() {
    std::array<char, 65536> buffer{};
    ssize_t count = 0;
    while ((count = ::read(from_window_, buffer.data(), buffer.size())) > 0)
      bytes_.append(buffer.data(), static_cast<std::size_t>(count));
    std::vector<Record> result;
    while (bytes_.size() >= 4) {
      std::uint32_t length = 0;
      for (int i = 0; i < 4; ++i)
        length = length << 8U | static_cast<std::uint8_t>(bytes_[static_cast<std::size_t>(i)]);
      if (bytes_.size() < 4 + length) break;
      result.push_back({bytes_.at(4), bytes_.substr(5, length - 1)});
      bytes_.erase(0, 4 + length);
    }
    return result;
  }
  static std::string kinds(const std::vector<Record>& records) {
    std::string text;
    for (const Record& record : records) text += record.kind;
    return text;
  }

  static View view(int value, cv::Size size = {64, 48}) {
    View result;
    result.image = cv::Mat(size, CV_8UC3, cv::Scalar::all(value));
    result.status = "value " + std::to_string(value);
    result.state = {{"value", value}};
    return result;
  }
  static FrameInfo frame(std::int64_t index) {
    FrameInfo result;
    result.index = index;
    result.time = 0.5;
    result.name = "video";
    result.source = "file";
    return result;
  }
  static int value_of(const cv::Mat& image) { return image.at<cv::Vec3b>(5, 5)[1]; }

  int to_window_ = -1;
  int from_window_ = -1;
  std::string bytes_;
  std::unique_ptr<Window> window_;
};

TEST_F(PipeWindowTest, StartsWithActionsAndSliders) {
  open({"Tarsier test", false, {{"threshold", 0, 255, 1, 60}}, {{"sketch", "pencil", 's'}}});
  const std::vector<Record> first = records();
  ASSERT_EQ(kinds(first), "H");
  EXPECT_EQ(first[0].parsed(), json::parse(R"({"title":"Tarsier test",
      "actions":[{"name":"sketch","help":"pencil","key":115}],
      "sliders":[{"name":"threshold","low":0,"high":255,"step":1,"value":60}],"stages":false})"));
  // Values alone come with the state; other names and limits are another hello.
  window_->set_controls({{"sketch", "pencil", 's'}}, {{"threshold", 0, 255, 1, 61}});
  EXPECT_EQ(kinds(records()), "");
  window_->set_controls({{"sketch", "pencil", 's'}, {"paint", "", 'p'}},
                        {{"threshold", 0, 9, 1, 5}});
  const std::vector<Record> second = records();
  ASSERT_EQ(kinds(second), "H");
  EXPECT_EQ(second[0].parsed()["actions"].size(), 2U);
  EXPECT_EQ(second[0].parsed()["sliders"][0]["high"], 9);
}

TEST_F(PipeWindowTest, SendsAStateWithEachView) {
  open({"", false, {{"threshold", 0, 255, 1, 60}}, {}});
  const FrameInfo info = frame(7);
  window_->show(view(10), &info);
  std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "HS");
  EXPECT_EQ(got[1].parsed(), json::parse(R"({"status":"value 10","state":{"value":10},
      "frame":{"index":7,"time":0.5,"name":"video","age_ms":0,"source":"file","detail":""},
      "sliders":{"threshold":60.0},"finished":false,"fullscreen":false,"width":64,"height":48,
      "events":0})"));
  window_->set_fullscreen(true);
  View last = view(11);
  last.finished = true;
  last.status = "caf\xe9";  // names of files are of any bytes
  window_->show(last, nullptr);
  got = records();
  ASSERT_EQ(kinds(got), "S");
  EXPECT_TRUE(got[0].parsed()["frame"].is_null());
  EXPECT_EQ(got[0].parsed()["finished"], true);
  EXPECT_EQ(got[0].parsed()["fullscreen"], true);
  window_->show(View(), nullptr);  // nothing to show yet
  EXPECT_EQ(kinds(records()), "S");
}

TEST_F(PipeWindowTest, StateCountsHandledEvents) {
  open({"", false, {}, {{"sketch", "", 's'}}});
  window_->show(view(10), nullptr);
  (void)records();
  send(
      "{\"key\":115}\n{\"action\":\"sketch\"}\n{\"action\":\"unknown\"}\n{\"want\":0}\n{\"key\":-1}"
      "\n");
  EXPECT_EQ(window_->poll(milliseconds(1000)).size(), 2U);
  EXPECT_EQ(kinds(records()), "") << "the session has not handled them yet";
  window_->show(view(11), nullptr);
  const std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "S");
  EXPECT_EQ(got[0].parsed()["events"], 4) << "what is passed over counts, too";
}

TEST_F(PipeWindowTest, SendsOneNewImagePerRequest) {
  open();
  const FrameInfo first = frame(1);
  window_->show(view(10), &first);
  EXPECT_EQ(kinds(records()), "HS") << "nobody wants an image";
  send("{\"want\":1}\n{\"want\":1}\n{\"want\":5}\n");
  EXPECT_THAT(events(), IsEmpty());
  std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "J") << "at once, the newest";
  EXPECT_EQ(got[0].number(0), 1U);
  EXPECT_EQ(got[0].number(4), 0U);
  EXPECT_NEAR(value_of(got[0].image()), 10, 2);
  const FrameInfo second = frame(2);
  window_->show(view(20), &second);
  EXPECT_EQ(kinds(records()), "S") << "what is wanted does not add up";
  const FrameInfo third = frame(3);
  window_->show(view(30), &third);
  send("{\"want\":1}\n");
  EXPECT_THAT(events(), IsEmpty());
  got = records();
  ASSERT_EQ(kinds(got), "SJ");
  EXPECT_EQ(got[1].number(0), 3U) << "the newest";
  EXPECT_NEAR(value_of(got[1].image()), 30, 2);
  send("{\"want\":1}\n");
  EXPECT_THAT(events(), IsEmpty());
  EXPECT_EQ(kinds(records()), "") << "none is newer";
  window_->show(View(), nullptr);
  EXPECT_EQ(kinds(records()), "S") << "a view without an image is none";
  window_->show(view(40), &third);
  EXPECT_EQ(kinds(records()), "SJ") << "wanted before it was there";
  send("{\"want\":1}\n{\"want\":0}\n");
  EXPECT_THAT(events(), IsEmpty());
  window_->show(view(50), &third);
  EXPECT_EQ(kinds(records()), "S") << "wanted no more";
}

TEST_F(PipeWindowTest, SendsTheAgeOfTheFrame) {
  open();
  FrameInfo info = frame(1);
  info.captured = Clock::now() - milliseconds(1500);
  info.source = "live";
  window_->show(view(10), &info);
  send("{\"want\":1}\n");
  (void)events();
  const std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "HSJ");
  EXPECT_GE(got[1].parsed()["frame"]["age_ms"], 1500);
  EXPECT_GE(got[2].number(4), 1500U);
}

TEST_F(PipeWindowTest, SlowReaderDoesNotBlockAndGetsTheNewestImage) {
  open();
  send("{\"want\":1}\n");
  (void)events();
  // Of noise, so that a JPEG is larger than any pipe.
  View large = view(0, {2400, 1600});
  cv::randu(large.image, 0, 255);
  const FrameInfo first = frame(0);
  window_->show(large, &first);
  for (int i = 1; i <= 300; ++i) {
    const FrameInfo info = frame(i);
    View next = view(i % 200);
    next.state["filling"] = std::string(10'000, 'x');
    window_->show(next, &info);
    if (i % 50 == 0) send("{\"want\":1}\n");
    EXPECT_THAT(events(), IsEmpty());
    EXPECT_FALSE(window_->closed());
  }
  // Hello, the first state, the image that was on its way; then the newest of both.
  std::vector<Record> got;
  for (int i = 0; i < 1000 && kinds(got) != "HSJSJ"; ++i) {
    for (Record& record : records()) got.push_back(std::move(record));
    (void)events();
  }
  ASSERT_EQ(kinds(got), "HSJSJ");
  EXPECT_EQ(got[1].parsed()["frame"]["index"], 0);
  EXPECT_EQ(got[2].image().size(), cv::Size(2400, 1600));
  EXPECT_EQ(got[3].parsed()["frame"]["index"], 300);
  EXPECT_EQ(got[4].number(0), 300U);
}

TEST_F(PipeWindowTest, KeepsTheOrderOfEventsAndMergesMouseMoves) {
  open({"", false, {{"threshold", 0, 255, 1, 60}}, {{"sketch", "", 's'}}});
  window_->show(view(10), nullptr);
  send("{\"want\":1}\n");
  (void)events();
  send(
      "{\"key\":115,\"shift\":true}\n{\"mouse\":\"move\",\"x\":1,\"y\":2}\n"
      "{\"mouse\":\"move\",\"x\":3,\"y\":4}\n{\"mouse\":\"left-down\",\"x\":3,\"y\":4}\n"
      "{\"mouse\":\"move\",\"x\":5,\"y\":6}\n{\"action\":\"sketch\"}\n"
      "{\"slider\":\"threshold\",\"value\":999}\n");
  const std::vector<Event> got = events();
  ASSERT_EQ(got.size(), 6U);
  EXPECT_EQ(got[0].key, 's');
  EXPECT_TRUE(got[0].shift);
  EXPECT_EQ(got[1].x, 3) << "only where the mouse is now";
  EXPECT_EQ(got[2].mouse, Event::Mouse::kLeftDown);
  EXPECT_EQ(got[3].y, 6);
  EXPECT_EQ(got[4].name, "sketch");
  EXPECT_EQ(got[5].value, 255) << "held within its limits";
}

TEST_F(PipeWindowTest, ScalesMousePositionsFromTheLastSentImage) {
  open();
  send("{\"mouse\":\"left-down\",\"x\":1,\"y\":2}\n");
  EXPECT_THAT(events(), IsEmpty()) << "there is no image to point at";
  window_->show(view(10, {800, 600}), nullptr);
  // A program may know the state's size alone, and never ask for an image.
  send("{\"max_width\":400}\n{\"mouse\":\"left-down\",\"x\":0,\"y\":299}\n");
  const std::vector<Event> unseen = events();
  ASSERT_EQ(unseen.size(), 1U);
  EXPECT_DOUBLE_EQ(unseen[0].x, 0.5);
  EXPECT_DOUBLE_EQ(unseen[0].y, 598.5);
  send("{\"max_width\":200,\"want\":1}\n");
  (void)events();
  const std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "HSJ");
  EXPECT_EQ(got[2].image().size(), cv::Size(200, 150));
  send("{\"mouse\":\"left-down\",\"x\":0,\"y\":0}\n{\"mouse\":\"left-up\",\"x\":199,\"y\":149}\n");
  std::vector<Event> mouse = events();
  ASSERT_EQ(mouse.size(), 2U);
  EXPECT_DOUBLE_EQ(mouse[0].x, 1.5) << "the middle of four pixels";
  EXPECT_DOUBLE_EQ(mouse[0].y, 1.5);
  EXPECT_DOUBLE_EQ(mouse[1].x, 797.5);
  EXPECT_DOUBLE_EQ(mouse[1].y, 597.5);
  // Until another image is sent, positions are of the old one.
  send("{\"max_width\":0}\n{\"mouse\":\"left-down\",\"x\":199,\"y\":149}\n");
  mouse = events();
  ASSERT_EQ(mouse.size(), 1U);
  EXPECT_DOUBLE_EQ(mouse[0].x, 797.5);
  send("{\"want\":1}\n");
  (void)events();
  const std::vector<Record> whole = records();
  ASSERT_EQ(kinds(whole), "J") << "the same image in another size is another image";
  EXPECT_EQ(whole[0].image().size(), cv::Size(800, 600));
  send("{\"mouse\":\"left-down\",\"x\":199,\"y\":149}\n");
  mouse = events();
  ASSERT_EQ(mouse.size(), 1U);
  EXPECT_DOUBLE_EQ(mouse[0].x, 199);
}

TEST_F(PipeWindowTest, ScalesMousePositionsFromTheGivenWidth) {
  open();
  window_->show(view(10, {800, 600}), nullptr);
  send("{\"max_width\":200,\"want\":1}\n");
  (void)events();
  // An image of 400 px was clicked on while one of 200 px was on its way.
  send("{\"mouse\":\"left-down\",\"x\":399,\"y\":299,\"width\":400}\n");
  const std::vector<Event> mouse = events();
  ASSERT_EQ(mouse.size(), 1U);
  EXPECT_DOUBLE_EQ(mouse[0].x, 798.5);
  EXPECT_DOUBLE_EQ(mouse[0].y, 598.5);
}

TEST_F(PipeWindowTest, SendsStagesOnRequest) {
  WindowOptions options;
  options.stages = true;
  open(options);
  EXPECT_EQ(records().at(0).parsed()["stages"], true);
  EXPECT_FALSE(window_->wants_stages());
  send("{\"stages\":1}\n{\"stages\":1}\n");
  (void)events();
  EXPECT_TRUE(window_->wants_stages());
  EXPECT_EQ(kinds(records()), "") << "the next frame has them";
  const FrameInfo info = frame(7);
  window_->show(view(10), &info);
  const cv::Mat wide(300, 1200, CV_8UC3, cv::Scalar::all(90));
  const cv::Mat gray(20, 30, CV_8UC1, cv::Scalar::all(200));
  window_->show_stages({{"edges", wide}, {"nothing", cv::Mat()}, {"mask", gray}});
  const std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "SD");
  EXPECT_EQ(got[1].number(0), 7U);
  const std::size_t length = got[1].number(4);
  const json list = json::parse(got[1].payload.substr(8, length));
  ASSERT_EQ(list.size(), 2U);
  EXPECT_EQ(list[0]["name"], "edges");
  EXPECT_EQ(list[0]["width"], 480) << "reduced";
  EXPECT_EQ(list[0]["height"], 120);
  EXPECT_EQ(list[1]["name"], "mask");
  const std::size_t first = list[0]["bytes"];
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(got[1].payload.data()) + 8 + length;
  const cv::Mat mask = decode_image({bytes + first, list[1]["bytes"].get<std::size_t>()}, "mask");
  EXPECT_EQ(mask.size(), cv::Size(30, 20));
  EXPECT_NEAR(value_of(mask), 200, 2);
  EXPECT_FALSE(window_->wants_stages()) << "they do not add up";
  window_->show_stages({{"edges", wide}});
  EXPECT_EQ(kinds(records()), "") << "nobody wants them";
  send("{\"stages\":1}\n");  // those of a still that stays
  (void)events();
  EXPECT_EQ(kinds(records()), "D");
}

TEST_F(PipeWindowTest, IgnoresStageRequestsWithoutStages) {
  open();
  send("{\"stages\":1}\n");
  (void)events();
  EXPECT_FALSE(window_->wants_stages());
}

TEST_F(PipeWindowTest, ImageRequestedWithAnEventShowsItsResult) {
  open();
  window_->show(view(10), nullptr);
  send("{\"key\":97}\n{\"want\":1}\n");
  EXPECT_EQ(events().size(), 1U);
  EXPECT_EQ(kinds(records()), "HS");
  window_->show(view(20), nullptr);
  const std::vector<Record> got = records();
  ASSERT_EQ(kinds(got), "SJ");
  EXPECT_NEAR(value_of(got[1].image()), 20, 2);
}

TEST_F(PipeWindowTest, QualitySetsTheJpegQuality) {
  open();
  View noise = view(0, {320, 240});
  cv::randu(noise.image, 0, 255);
  const auto size_at = [&](int quality) {
    window_->show(noise, nullptr);
    send("{\"quality\":" + std::to_string(quality) + ",\"want\":1}\n");
    (void)events();
    return records().back().payload.size();
  };
  EXPECT_LT(2 * size_at(20), size_at(95));
}

TEST_F(PipeWindowTest, SkipsInvalidLines) {
  open({"", false, {}, {{"sketch", "", 's'}}});
  send("nonsense\n{\"key\":\"s\"}\n{\"action\":\"other\"}\n{\"slider\":\"none\",\"value\":1}\n\n" +
       std::string(1, '\0') + "\n{\"action\":\"sketch\"}\n");
  const std::vector<Event> got = events();
  ASSERT_EQ(got.size(), 1U);
  EXPECT_EQ(got[0].name, "sketch");
  send(std::string(60'000, '{'));
  EXPECT_THAT(events(), IsEmpty());
  send(std::string(10'000, '{') + "\n{\"key\":97}\n");
  EXPECT_EQ(events().size(), 1U);
  EXPECT_FALSE(window_->closed());
}

TEST_F(PipeWindowTest, WarnsAtMostOnceASecond) {
  open();
  const ScopedLogLevel warnings(LogLevel::kWarning);
  ::testing::internal::CaptureStderr();
  for (int i = 0; i < 200; ++i) {
    send("nonsense\n");
    (void)events();
  }
  const std::string log = ::testing::internal::GetCapturedStderr();
  EXPECT_THAT(log, HasSubstr("window: a line is ignored"));
  EXPECT_LE(std::count(log.begin(), log.end(), '\n'), 5) << log;
}

TEST_F(PipeWindowTest, ClosesOnRequestAndWhenEitherEndCloses) {
  for (const int how : {0, 1, 2}) {
    open();
    window_->show(view(10), nullptr);
    EXPECT_FALSE(window_->closed());
    if (how == 0) send("{\"close\":true}\n");
    if (how == 1) close_fd(to_window_);
    if (how == 2) close_fd(from_window_);
    EXPECT_THAT(window_->poll(milliseconds(2000)), IsEmpty()) << how;
    EXPECT_TRUE(window_->closed()) << how;
    window_->show(view(20), nullptr);
    EXPECT_THAT(window_->poll(milliseconds(0)), IsEmpty());
    window_.reset();
    close_fd(to_window_);
    close_fd(from_window_);
    bytes_.clear();
  }
}

TEST_F(PipeWindowTest, ClosesWhenTheReaderIsGone) {
  open();
  close_fd(from_window_);
  window_->show(view(10), nullptr);
  EXPECT_TRUE(window_->closed());
}

TEST_F(PipeWindowTest, PollWaitsForInput) {
  open();
  const auto begin = Clock::now();
  EXPECT_THAT(window_->poll(milliseconds(30)), IsEmpty());
  EXPECT_GE(Clock::now() - begin, milliseconds(30));
  send("{\"key\":97}\n");
  EXPECT_EQ(window_->poll(std::chrono::minutes(5)).size(), 1U);
}

TEST_F(PipeWindowTest, SendsPendingRecordsAtTheEnd) {
  open();
  View large = view(0, {2400, 1600});
  cv::randu(large.image, 0, 255);
  send("{\"want\":1}\n");
  (void)events();
  window_->show(large, nullptr);
  View last = view(3);
  last.finished = true;
  window_->show(last, nullptr);
  std::string kinds_so_far;
  std::vector<Record> got = records();  // makes room for what is left
  kinds_so_far = kinds(got);
  while (kinds_so_far.find('J') == std::string::npos) {
    (void)events();
    got = records();
    kinds_so_far += kinds(got);
  }
  window_.reset();
  kinds_so_far += kinds(records());
  EXPECT_EQ(kinds_so_far, "HSJS");
}

TEST_F(PipeWindowTest, AcceptsOneSocketForBothEnds) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()), 0);
  window_ = make_pipe_window({ends[0], ends[0]}, {"Tarsier test", false, {}, {}});
  to_window_ = ends[1];
  from_window_ = ::dup(ends[1]);
  ::fcntl(from_window_, F_SETFL, O_NONBLOCK);
  window_->show(view(10), nullptr);
  send("{\"want\":1}\n{\"key\":97}\n");
  EXPECT_EQ(window_->poll(std::chrono::minutes(5)).size(), 1U);
  EXPECT_THAT(events(), IsEmpty());
  EXPECT_EQ(kinds(records()), "HSJ");
  EXPECT_EQ(::fcntl(ends[0], F_GETFD), FD_CLOEXEC) << "programs that are started do not get it";
}

TEST(PipeEnds, RefusesInvalidOrClosedDescriptors) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe(ends.data()), 0);
  const std::string good = "pipe:" + std::to_string(ends[0]) + ":" + std::to_string(ends[1]);
  EXPECT_EQ(parse_pipe_ends(good).in, ends[0]);
  EXPECT_EQ(parse_pipe_ends(good).out, ends[1]);
  ::close(ends[0]);
  ::close(ends[1]);
  EXPECT_THROW((void)parse_pipe_ends(good), Error) << "not open";
  for (const char* bad : {"", "pipe", "pipe:", "pipe:3", "pipe:0:1", "pipe:3:", "pipe:a:b",
                          "pipe:-3:4", "pipe:3:4:5", "x11:3:4", "pipe:99999:99999"})
    EXPECT_THROW((void)parse_pipe_ends(bad), Error) << bad;
}

}  // namespace
}  // namespace tarsier::window
