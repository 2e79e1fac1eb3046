// SPDX-License-Identifier: MIT
#include "tarsier/media/live_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_log.h"
#include "tarsier/media/capture_protocol.h"
#include "tarsier/media/child_capture.h"
#include "tarsier/media/http_stream.h"
#include "tarsier/media/testing_http_server.h"
#include "tarsier/media/testing_timeout.h"

#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::seconds;
using test_support::HttpServer;
using test_support::kTimeout;
using Clock = std::chrono::steady_clock;

SourceOptions quick_options() {
  SourceOptions options;
  options.stall_s = 0.4;
  options.connect_timeout_s = 20;
  options.give_up_s = 0;
  return options;
}

LiveTiming quick_timing() {
  LiveTiming timing;
  timing.backoff_s = 0.1;
  timing.backoff_max_s = 30;
  timing.max_wait_when_answering_s = 0.4;
  timing.probe_s = 0.1;
  return timing;
}

std::unique_ptr<FrameSource> http_source(const HttpServer& server,
                                         const SourceOptions& options = quick_options(),
                                         const LiveTiming& timing = quick_timing()) {
  const std::string url = server.url();
  return make_live_source(
      url, url, [url, options] { return make_http_backend(url, options); }, options, timing);
}

Frame next_frame(FrameSource& source) {
  auto frame = source.next(kTimeout, {});
  if (!frame) throw std::runtime_error("no frame in time: " + source.status().detail);
  return *frame;
}

// Waits for a condition and takes no frames.
bool eventually(const std::function<bool()>& condition) {
  const auto end = Clock::now() + kTimeout;
  while (Clock::now() < end) {
    if (condition()) return true;
    std::this_thread::sleep_for(milliseconds(5));
  }
  return false;
}

bool reaches(FrameSource& source, SourceState state) {
  return eventually([&] { return source.status().state == state; });
}

int open_descriptors() {
  int count = 0;
  for ([[maybe_unused]] const auto& entry : fs::directory_iterator("/proc/self/fd")) ++count;
  return count;
}

bool has_children() { return ::waitpid(-1, nullptr, WNOHANG) == 0 || errno != ECHILD; }

// Whether a process of this group still runs. A process that ended but was not reaped counts as
// gone. Its new parent may reap it late or, in a container, never, and kill() finds it until then.
bool group_runs(int group) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator("/proc", ignored)) {
    std::ifstream file(entry.path() / "stat");
    std::string line;
    if (!std::getline(file, line)) continue;
    const std::size_t name_end = line.rfind(')');  // the name may hold any character
    if (name_end == std::string::npos) continue;
    std::istringstream fields(line.substr(name_end + 1));
    char state = 'Z';
    int parent = 0;
    int its_group = 0;
    if (fields >> state >> parent >> its_group && its_group == group && state != 'Z' &&
        state != 'X')
      return true;
  }
  return false;
}

class LiveSourceTest : public ::testing::Test {
 protected:
  LiveSourceTest() {
    folder_ = fs::temp_directory_path() /
              ("tarsier_live_" + std::to_string(::getpid()) + "_" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::create_directories(folder_);
  }
  ~LiveSourceTest() override { fs::remove_all(folder_); }

  const ScopedLogLevel log_level_{LogLevel::kOff};

  std::string write(const std::string& name, const std::string& bytes) {
    const fs::path path = folder_ / name;
    std::ofstream(path, std::ios::binary) << bytes;
    return path.string();
  }

  fs::path folder_;
};

TEST_F(LiveSourceTest, ReturnsNewestFrameAndCountsDropped) {
  HttpServer server;
  server.period_ms = 5;
  const auto source = http_source(server);
  const Frame first = next_frame(*source);
  // The frame that opened the source, or a later one if this thread was late.
  EXPECT_GE(first.index, 0);
  EXPECT_GE(first.time, 0);
  EXPECT_FALSE(first.still);
  EXPECT_EQ(first.name, server.url());
  ASSERT_TRUE(eventually([&] { return source->status().received >= first.index + 20; }));
  const std::int64_t before = source->status().received;
  const Frame later = next_frame(*source);
  EXPECT_GE(later.index, before - 1);  // skipped frames are not delivered later
  EXPECT_EQ(test_support::number_of(later.image),
            (test_support::number_of(first.image) + later.index - first.index) % 32);
  EXPECT_GT(later.time, first.time);
  EXPECT_LE(later.captured, Clock::now());
  const SourceStatus status = source->status();
  EXPECT_EQ(status.state, SourceState::kLive);
  EXPECT_GE(status.dropped, 15);
  EXPECT_LE(status.dropped + 2, status.received);
  EXPECT_EQ(status.detail, "64x48 MJPEG over HTTP");
  EXPECT_GT(next_frame(*source).index, later.index);
}

TEST_F(LiveSourceTest, FrozenServerAgesAndResumesOnSameConnection) {
  HttpServer server;
  const auto source = http_source(server);
  next_frame(*source);
  ASSERT_TRUE(reaches(*source, SourceState::kLive));
  server.mode = HttpServer::Mode::kFreeze;
  ASSERT_TRUE(reaches(*source, SourceState::kStale));
  EXPECT_GE(source->status().age_s, 0.4);
  server.mode = HttpServer::Mode::kServe;
  ASSERT_TRUE(reaches(*source, SourceState::kLive));
  next_frame(*source);
}

TEST_F(LiveSourceTest, SingleClientServerRecoversFromLongFreeze) {
  HttpServer server;
  server.one_client = true;
  const auto source = http_source(server);
  next_frame(*source);
  server.mode = HttpServer::Mode::kFreeze;
  ASSERT_TRUE(reaches(*source, SourceState::kLost));  // a second connection was tried, and refused
  while (source->next(milliseconds(0), {})) {
  }
  server.mode = HttpServer::Mode::kServe;
  next_frame(*source);
  ASSERT_TRUE(reaches(*source, SourceState::kLive));
  EXPECT_EQ(server.connections(), 1);
}

TEST_F(LiveSourceTest, ReconnectsToAReturningServerDespiteALongBackOff) {
  HttpServer server;
  LiveTiming timing = quick_timing();
  timing.backoff_s = 3600;  // only the probe can end this wait
  timing.backoff_max_s = 3600;
  const auto source = http_source(server, quick_options(), timing);
  next_frame(*source);
  server.stop();
  ASSERT_TRUE(reaches(*source, SourceState::kLost));
  // After "the server ended the stream" the first retry comes soon, because the server had
  // answered. Then nothing listens.
  ASSERT_TRUE(eventually([&] {
    return source->status().detail.find("refused") != std::string::npos &&
           source->status().state == SourceState::kLost;
  }));
  while (source->next(milliseconds(0), {})) {
  }
  server.start();
  next_frame(*source);
  ASSERT_TRUE(reaches(*source, SourceState::kLive));
  EXPECT_GE(source->status().reopened, 1);
}

TEST_F(LiveSourceTest, RecoversFromGarbage) {
  HttpServer server;
  const auto source = http_source(server);
  next_frame(*source);
  server.mode = HttpServer::Mode::kGarbage;
  ASSERT_TRUE(reaches(*source, SourceState::kStale));
  while (source->next(milliseconds(0), {})) {
  }
  server.mode = HttpServer::Mode::kServe;
  next_frame(*source);
  ASSERT_TRUE(reaches(*source, SourceState::kLive));
}

TEST_F(LiveSourceTest, AClosedConnectionIsReopenedAtOnce) {
  HttpServer server;
  const int before = open_descriptors();
  {
    const auto source = http_source(server);
    for (int round = 1; round <= 3; ++round) {
      next_frame(*source);
      ASSERT_TRUE(reaches(*source, SourceState::kLive));
      server.hang_up = true;
      ASSERT_TRUE(eventually([&] { return source->status().reopened >= round; }));
    }
    next_frame(*source);
  }
  EXPECT_TRUE(eventually([&] { return open_descriptors() == before; }));
}

TEST_F(LiveSourceTest, TheFrameSizeMayChange) {
  HttpServer server;
  const auto source = http_source(server);
  EXPECT_EQ(next_frame(*source).image.cols, 64);
  server.width = 128;
  while (next_frame(*source).image.cols != 128) {
  }
}

TEST_F(LiveSourceTest, WithoutServerNextThrowsAtOnceUnlessWaitingIsRequested) {
  HttpServer server;
  server.stop();
  {
    const auto source = http_source(server);
    EXPECT_THROW((void)source->next(kTimeout, {}), InputError);
    EXPECT_THROW((void)source->next(kTimeout, {}), InputError);
  }
  SourceOptions options = quick_options();
  options.wait = true;
  options.connect_timeout_s = 0.1;
  const auto source = http_source(server, options);
  EXPECT_FALSE(source->next(milliseconds(300), {}).has_value());
  server.start();
  next_frame(*source);
}

TEST_F(LiveSourceTest, SilentServerFailsAfterConnectTimeout) {
  HttpServer server;
  server.mode = HttpServer::Mode::kFreeze;
  SourceOptions options = quick_options();
  options.connect_timeout_s = 0.3;
  const auto source = http_source(server, options);
  try {
    (void)source->next(kTimeout, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("no image within 0.3 s"), std::string::npos)
        << error.what();
  }
}

TEST_F(LiveSourceTest, ALostSourceIsReportedAfterGiveUp) {
  HttpServer server;
  SourceOptions options = quick_options();
  options.give_up_s = 0.7;
  const auto source = http_source(server, options);
  next_frame(*source);
  server.stop();
  EXPECT_THROW(
      {
        while (true) (void)source->next(kTimeout, {});
      },
      SourceLostError);
  EXPECT_TRUE(source->ended());
  EXPECT_EQ(source->status().state, SourceState::kLost);
}

TEST_F(LiveSourceTest, StoppingAndDestroyingDoNotWait) {
  HttpServer server;
  server.mode = HttpServer::Mode::kFreeze;
  const auto source = http_source(server);
  std::stop_source stopper;
  std::jthread later([&] {
    std::this_thread::sleep_for(milliseconds(50));
    stopper.request_stop();
  });
  EXPECT_FALSE(source->next(seconds(1000), stopper.get_token()).has_value());
}

// --- child processes ---

std::string capture_program() {
  return (fs::read_symlink("/proc/self/exe").parent_path() / "tarsier-capture").string();
}

ChildCommand shell(const std::string& script, ChildCommand::Format format) {
  ChildCommand command;
  command.arguments = {"/bin/sh", "-c", script};
  command.format = format;
  command.detail = "a script";
  command.startup_s = 20;
  return command;
}

std::unique_ptr<FrameSource> child_source(const ChildCommand& command,
                                          const SourceOptions& options = quick_options()) {
  return make_live_source(
      "child", "child", [command] { return make_child_backend(command); }, options, quick_timing());
}

std::string record_of(const cv::Mat& image, std::uint32_t frames = 1) {
  CaptureRecord record;
  record.width = image.cols;
  record.height = image.rows;
  record.type = image.type();
  record.frames = frames;
  record.time_ns =
      std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
  record.length = image.total() * image.elemSize();
  std::string bytes(reinterpret_cast<const char*>(&record), sizeof record);
  return bytes.append(reinterpret_cast<const char*>(image.data), record.length);
}

std::string text_record(CaptureRecord::Kind kind, const std::string& text) {
  CaptureRecord record;
  record.kind = kind;
  record.fps = 30;
  record.length = text.size();
  return std::string(reinterpret_cast<const char*>(&record), sizeof record) + text;
}

TEST_F(LiveSourceTest, AFrozenChildIsRestarted) {
  const std::string frames =
      write("frames", text_record(CaptureRecord::Kind::kInfo, "64x48 TEST 30 fps") +
                          record_of(cv::Mat(48, 64, CV_8UC3, cv::Scalar(8, 16, 24)), 3));
  const int before = open_descriptors();
  {
    // Starts a child process, which must end together with it.
    const auto source = child_source(
        shell("echo $$ >> '" + (folder_ / "pids").string() + "'; cat '" + frames + "'; sleep 1000",
              ChildCommand::Format::kRecords));
    for (int round = 0; round < 3; ++round) {
      const Frame frame = next_frame(*source);
      EXPECT_EQ(frame.image.at<cv::Vec3b>(0, 0), cv::Vec3b(8, 16, 24));
      EXPECT_EQ(frame.index, 3 * round + 2);
    }
    EXPECT_GE(source->status().reopened, 2);
    EXPECT_EQ(source->fps(), 30);
  }
  EXPECT_TRUE(eventually([] { return !has_children(); }));
  EXPECT_TRUE(eventually([&] { return open_descriptors() == before; }));
  std::ifstream pids(folder_ / "pids");
  int pid = 0;
  while (pids >> pid) {
    EXPECT_TRUE(eventually([pid] { return !group_runs(pid); })) << "process group " << pid;
  }
}

TEST_F(LiveSourceTest, ChildMaySendJpegs) {
  const std::string jpegs = write("jpegs", test_support::jpeg_of(4) + test_support::jpeg_of(9));
  const auto source =
      child_source(shell("cat '" + jpegs + "'; sleep 1000", ChildCommand::Format::kMjpeg));
  EXPECT_EQ(test_support::number_of(next_frame(*source).image), 9);
}

TEST_F(LiveSourceTest, ErrorsOfAChildAreReported) {
  const std::string error =
      write("error", text_record(CaptureRecord::Kind::kError, "cannot be opened, sorry"));
  const auto reason = [&](const std::string& script, ChildCommand::Format format) -> std::string {
    const auto source = child_source(shell(script, format));
    try {
      (void)source->next(kTimeout, {});
    } catch (const InputError& failure) {
      return failure.what();
    }
    return "nothing thrown";
  };
  EXPECT_EQ(reason("cat '" + error + "'", ChildCommand::Format::kRecords),
            "child: cannot be opened, sorry");
  EXPECT_EQ(reason("echo first >&2; echo 'no cameras available' >&2; exit 7",
                   ChildCommand::Format::kMjpeg),
            "child: sh ended with status 7: no cameras available");
  EXPECT_NE(reason("head -c 100000 /dev/zero; sleep 1000", ChildCommand::Format::kRecords)
                .find("not an image"),
            std::string::npos);
  ChildCommand missing;
  missing.arguments = {"/nowhere/program"};
  EXPECT_THROW((void)child_source(missing)->next(kTimeout, {}), InputError);
}

TEST_F(LiveSourceTest, LongOutputOfAChildOnStderrDoesNotBlock) {
  const std::string jpeg = write("jpeg", test_support::jpeg_of(4));
  const auto source =
      child_source(shell("head -c 3000000 /dev/zero >&2; cat '" + jpeg + "'; sleep 1000",
                         ChildCommand::Format::kMjpeg));
  next_frame(*source);
}

TEST_F(LiveSourceTest, ChildrenInheritNoDescriptorsSignalsOrInput) {
  sigset_t all;
  sigset_t before;
  sigfillset(&all);
  ::pthread_sigmask(SIG_BLOCK, &all,
                    &before);  // as in the program, whose main() blocks SIGINT and SIGTERM
  const std::string seen = (folder_ / "seen").string();
  const std::string jpeg = write("jpeg", test_support::jpeg_of(4));
  const auto source =
      child_source(shell("{ ls /proc/$$/fd; grep SigBlk /proc/self/status; readlink "
                         "/proc/$$/fd/0; } > '" +
                             seen + "'; cat '" + jpeg + "'; sleep 1000",
                         ChildCommand::Format::kMjpeg));
  ::pthread_sigmask(SIG_SETMASK, &before, nullptr);
  next_frame(*source);
  std::ifstream file(seen);
  std::string descriptors;
  std::string mask;
  std::string input;
  std::getline(file, descriptors, 'S');
  std::getline(file, mask);
  std::getline(file, input);
#ifndef __SANITIZE_THREAD__  // its posix_spawn() keeps the mask
  EXPECT_EQ(mask, "igBlk:\t0000000000000000");
#endif
  EXPECT_EQ(input, "/dev/null");
  EXPECT_TRUE(descriptors == "0\n1\n2\n" || descriptors == "0\n1\n10\n2\n")
      << descriptors;  // sh may keep its own
}

TEST(CaptureParserTest, RefusesInvalidRecords) {
  const std::string good = record_of(cv::Mat(3, 2, CV_8UC3, cv::Scalar(1, 2, 3)));
  const auto feed = [](const std::string& bytes, std::size_t piece) {
    CaptureParser parser;
    for (std::size_t at = 0; at < bytes.size(); at += piece) {
      const std::string part = bytes.substr(at, piece);
      parser.feed({reinterpret_cast<const std::uint8_t*>(part.data()), part.size()});
    }
    return parser;
  };
  for (const std::size_t piece : {std::size_t{1}, std::size_t{5}, std::size_t{1000}}) {
    CaptureParser parser = feed(good + good, piece);
    EXPECT_FALSE(parser.is_broken());
    EXPECT_EQ(parser.take().at<cv::Vec3b>(2, 1), cv::Vec3b(1, 2, 3));
  }
  const auto with = [&good](const std::function<void(CaptureRecord&)>& change) {
    CaptureRecord record;
    std::memcpy(&record, good.data(), sizeof record);
    change(record);
    std::string bytes = good;
    std::memcpy(bytes.data(), &record, sizeof record);
    return bytes;
  };
  EXPECT_TRUE(feed(with([](auto& r) { r.magic = 1; }), 7).is_broken());
  EXPECT_TRUE(feed(with([](auto& r) {
                     r.width = -2;
                     r.height = -3;
                   }),
                   7)
                  .is_broken());
  EXPECT_TRUE(feed(with([](auto& r) {
                     r.width = 2'000'000'000;
                     r.height = 2'000'000'000;
                   }),
                   7)
                  .is_broken());
  EXPECT_TRUE(feed(with([](auto& r) { r.length = 1; }), 7).is_broken());
  EXPECT_TRUE(feed(with([](auto& r) { r.type = CV_64FC4; }), 7).is_broken());
  EXPECT_TRUE(
      feed(with([](auto& r) { r.kind = static_cast<CaptureRecord::Kind>(9); }), 7).is_broken());
  EXPECT_TRUE(feed(with([](auto& r) {
                     r.kind = CaptureRecord::Kind::kError;
                     r.length = ~0ULL;
                   }),
                   7)
                  .is_broken());
}

TEST_F(LiveSourceTest, CaptureProgramReadsNetworkStream) {
  HttpServer server;
  SourceOptions options = quick_options();
  options.capture_program = capture_program();
  options.stall_s = 20;
  const auto source = child_source(ffmpeg_command(server.url("/cam.mjpg"), options), options);
  const Frame frame = next_frame(*source);
  EXPECT_EQ(frame.image.size(), cv::Size(64, 48));
  // The frame may arrive a moment before the supervising thread changes the state.
  ASSERT_TRUE(reaches(*source, SourceState::kLive));
  EXPECT_EQ(source->status().detail.substr(0, 5), "64x48");
}

TEST_F(LiveSourceTest, TheCaptureProgramReportsErrors) {
  SourceOptions options = quick_options();
  options.capture_program = capture_program();
  options.stall_s = 20;  // also covers the start of the program, which is slow in an emulator
  HttpServer server;
  server.stop();
  EXPECT_THROW(
      (void)child_source(ffmpeg_command(server.url(), options), options)->next(kTimeout, {}),
      InputError);
  try {
    (void)child_source(camera_command("/dev/video99", "camera 99", options), options)
        ->next(kTimeout, {});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("no such device (/dev/video99)"), std::string::npos);
  }
  // After exec, the program still ends when its parent dies.
  ChildCommand command;
  command.arguments = {capture_program(), "exec", "/bin/cat",
                       write("jpeg", test_support::jpeg_of(7))};
  command.format = ChildCommand::Format::kMjpeg;
  EXPECT_EQ(test_support::number_of(next_frame(*child_source(command, options)).image), 7);
}

}  // namespace
}  // namespace tarsier
