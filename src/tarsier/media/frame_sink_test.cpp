// SPDX-License-Identifier: MIT
#include "tarsier/media/frame_sink.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdlib>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <stdexcept>
#include <string>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

using FrameSinkTest = FolderTest;

cv::Mat filled(int width, int height, int value) {
  return {height, width, CV_8UC3, cv::Scalar::all(value)};
}

Frame still(const std::string& name) {
  Frame frame;
  frame.name = name;
  frame.still = true;
  return frame;
}

Frame moment(std::int64_t index) {
  Frame frame;
  frame.index = index;
  frame.name = "video.avi";
  return frame;
}

TEST_F(FrameSinkTest, TextsAreClassified) {
  EXPECT_EQ(classify_sink("none"), SinkKind::kNone);
  EXPECT_EQ(classify_sink("a.PNG"), SinkKind::kImage);
  EXPECT_EQ(classify_sink("a/b.jpeg"), SinkKind::kImage);
  EXPECT_EQ(classify_sink("a.mkv"), SinkKind::kVideo);
  EXPECT_EQ(classify_sink("out"), SinkKind::kFolder);
  EXPECT_EQ(classify_sink("out.v2/"), SinkKind::kFolder);
  EXPECT_EQ(classify_sink(folder_), SinkKind::kFolder);
  EXPECT_EQ(classify_sink("/dev/full"), SinkKind::kImage);
  EXPECT_EQ(classify_sink("http://127.0.0.1:0/"), SinkKind::kHttp);
  fs::create_directory(path("dir.xyz"));
  EXPECT_EQ(classify_sink(path("dir.xyz")), SinkKind::kFolder);
  for (const char* bad : {"", "-", "a.gif", "https://x/", "rtsp://x/"})
    EXPECT_THROW((void)classify_sink(bad), UsageError) << bad;
}

TEST_F(FrameSinkTest, NoneDiscardsEverything) {
  const auto sink = open_sink("none");
  EXPECT_EQ(sink->write(filled(4, 4, 1), moment(0)), "");
  sink->finish();
}

TEST_F(FrameSinkTest, OneImageGoesToAFile) {
  const auto sink = open_sink(path("a.png"));
  EXPECT_EQ(files(), 0U);
  EXPECT_EQ(sink->write(filled(5, 4, 77), still("x.jpg")), path("a.png"));
  sink->finish();
  EXPECT_EQ(read_image(path("a.png")).at<cv::Vec3b>(2, 2), cv::Vec3b(77, 77, 77));
  EXPECT_THROW((void)sink->write(filled(5, 4, 77), still("y.jpg")), UsageError);
  SinkOptions many;
  many.many = true;
  EXPECT_THROW((void)open_sink(path("b.png"), many), UsageError);
}

TEST_F(FrameSinkTest, UnwritableTargetsAreDetectedAtTheStart) {
  EXPECT_THROW((void)open_sink(path("none/a.png")), OutputError);
  EXPECT_THROW((void)open_sink(path("none/a.mp4")), OutputError);
  std::ofstream(path("file")) << "x";
  EXPECT_THROW((void)open_sink(path("file")), OutputError) << "a file where a folder is meant";
  EXPECT_THROW((void)open_sink(path("file/sub/")), OutputError);
  EXPECT_THROW((void)open_sink("/proc/tarsier/"), OutputError);
}

TEST_F(FrameSinkTest, AFullDeviceIsAnOutputError) {
  const auto sink = open_sink("/dev/full");
  EXPECT_THROW((void)sink->write(filled(5, 4, 77), still("x.jpg")), OutputError);
}

TEST_F(FrameSinkTest, FolderKeepsNamesAndExtensions) {
  const auto sink = open_sink(path("new/out"));
  EXPECT_EQ(sink->write(filled(4, 4, 1), still("/a/cat.jpg")), path("new/out/cat.jpg"));
  EXPECT_EQ(sink->write(filled(4, 4, 2), still("/b/cat.jpg")), path("new/out/cat-2.jpg"));
  EXPECT_EQ(sink->write(filled(4, 4, 3), still("/c/cat.jpg")), path("new/out/cat-3.jpg"));
  EXPECT_EQ(sink->write(filled(4, 4, 3), still("cat-2.jpg")), path("new/out/cat-2-2.jpg"));
  EXPECT_EQ(sink->write(filled(4, 4, 3), still("dog.tiff")), path("new/out/dog.png"));
  EXPECT_EQ(sink->write(filled(4, 4, 3), moment(17)), path("new/out/frame_000017.png"));
  EXPECT_EQ(sink->write(cv::Mat(4, 4, CV_8UC1, cv::Scalar(9)), moment(1234567)),
            path("new/out/frame_1234567.png"));
  sink->finish();
  EXPECT_NEAR(read_image(path("new/out/cat-2.jpg")).at<cv::Vec3b>(1, 1)[0], 2, 1);
}

TEST_F(FrameSinkTest, FolderAcceptsAnExtension) {
  SinkOptions options;
  options.folder_extension = ".webp";
  const auto sink = open_sink(path("out/"), options);
  EXPECT_EQ(sink->write(filled(4, 4, 1), still("a.jpg")), path("out/a.webp"));
  options.folder_extension = ".exe";
  EXPECT_THROW((void)open_sink(path("out/"), options), std::invalid_argument);
  options.folder_extension = "/../x.png";
  EXPECT_THROW((void)open_sink(path("out/"), options), std::invalid_argument);
}

// a/x.png and b/x.png are written as x.png and x-2.png; in b, x.png would replace an input.
TEST_F(FrameSinkTest, FolderKeepsAllInputs) {
  for (const char* folder : {"a", "b"}) fs::create_directory(path(folder));
  for (const char* input : {"a/x.png", "b/x.png", "b/x-2.png"})
    write_image(path(input), filled(4, 4, 1));
  const auto open = [&](const char* folder, const std::vector<std::string>& inputs) {
    SinkOptions options;
    options.inputs = std::make_shared<const InputFiles>(inputs);
    return open_sink(path(folder), options);
  };
  EXPECT_THROW((void)open("b", {path("a/x.png"), path("b/x.png")}), UsageError);
  EXPECT_THROW((void)open("b", {path("b")}), UsageError);
  const auto elsewhere = open("out", {path("a/x.png"), path("b")});
  EXPECT_EQ(elsewhere->write(filled(4, 4, 2), still(path("a/x.png"))), path("out/x.png"));
  fs::remove(path("b/x.png"));
  fs::rename(path("b/x-2.png"), path("y.png"));
  fs::create_symlink(path("y.png"), path("b/x-2.png"));
  const auto linked = open("b", {path("y.png")});
  EXPECT_EQ(linked->write(filled(4, 4, 2), still(path("a/x.png"))), path("b/x.png"));
  EXPECT_THROW((void)linked->write(filled(4, 4, 2), still(path("a/x.png"))), UsageError)
      << "x-2.png is another name of an input";
}

TEST_F(FrameSinkTest, DoesNotOverwriteSources) {
  write_image(path("a.png"), filled(4, 4, 200));
  const auto sink = open_sink(folder_);
  EXPECT_THROW((void)sink->write(filled(4, 4, 1), still(path("a.png"))), UsageError);
  EXPECT_EQ(read_image(path("a.png")).at<cv::Vec3b>(0, 0)[0], 200);
}

class VideoSinkTest : public FrameSinkTest, public testing::WithParamInterface<const char*> {};

TEST_P(VideoSinkTest, AllFramesRoundTrip) {
  const std::string file = path(std::string("v:1") + GetParam());
  SinkOptions options;
  options.fps = 12.5;
  options.many = true;
  testing::internal::CaptureStderr();
  const auto sink = open_sink(file, options);
  for (int i = 0; i < 20; ++i) EXPECT_EQ(sink->write(filled(65, 49, 10 * i + 20), moment(i)), "");
  EXPECT_FALSE(fs::exists(file)) << "the name comes at the end";
  sink->finish();
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_EQ(files(), 1U);
  cv::VideoCapture video(file, cv::CAP_FFMPEG);
  ASSERT_TRUE(video.isOpened());
  EXPECT_NEAR(video.get(cv::CAP_PROP_FPS), 12.5, 0.01);
  cv::Mat frame;
  int count = 0;
  while (video.read(frame)) {
    EXPECT_EQ(frame.size(), cv::Size(66, 50)) << "odd sides are made even";
    EXPECT_NEAR(cv::mean(frame)[1], 10 * count + 20, 4);
    ++count;
  }
  EXPECT_EQ(count, 20);
  EXPECT_THROW((void)sink->write(filled(65, 49, 0), moment(20)), std::invalid_argument);
}

TEST_P(VideoSinkTest, FitsFramesOfAnotherSize) {
  const std::string file = path(std::string("v") + GetParam());
  const auto sink = open_sink(file);
  (void)sink->write(filled(64, 48, 255), moment(0));
  (void)sink->write(filled(200, 20, 255), moment(1));
  (void)sink->write(cv::Mat(10, 10, CV_8UC1, cv::Scalar(255)), moment(2));
  sink->finish();
  cv::VideoCapture video(file, cv::CAP_FFMPEG);
  cv::Mat frame;
  ASSERT_TRUE(video.read(frame));
  ASSERT_TRUE(video.read(frame));
  EXPECT_EQ(frame.size(), cv::Size(64, 48));
  EXPECT_LT(frame.at<cv::Vec3b>(4, 32)[1], 60) << "bars above and below";
  EXPECT_GT(frame.at<cv::Vec3b>(24, 32)[1], 200);
  ASSERT_TRUE(video.read(frame));
  EXPECT_LT(frame.at<cv::Vec3b>(24, 2)[1], 60) << "bars at the sides";
  EXPECT_GT(frame.at<cv::Vec3b>(24, 32)[1], 200);
}

TEST_P(VideoSinkTest, AnUnfinishedVideoLeavesNoFile) {
  const std::string file = path(std::string("v") + GetParam());
  std::ofstream(file) << "old";
  {
    const auto sink = open_sink(file);
    (void)sink->write(filled(64, 48, 255), moment(0));
  }
  EXPECT_EQ(read_file(file, 10), "old");
  EXPECT_EQ(files(), 1U);
  const auto empty = open_sink(path(std::string("empty") + GetParam()));
  empty->finish();
  EXPECT_EQ(files(), 1U);
}

TEST_P(VideoSinkTest, AFullDiskIsReportedAndKeepsTheOldFile) {
  const std::string file = path(std::string("v") + GetParam());
  std::ofstream(file) << "old";
  struct ::rlimit before {};
  ASSERT_EQ(::getrlimit(RLIMIT_FSIZE, &before), 0);
  const auto handler = std::signal(SIGXFSZ, SIG_IGN);
  struct ::rlimit small = before;
  small.rlim_cur = 50'000;
  bool refused = false;
  {
    const auto sink = open_sink(file);
    ASSERT_EQ(::setrlimit(RLIMIT_FSIZE, &small), 0);
    cv::RNG rng(1);
    try {
      for (int i = 0; i < 30; ++i) {
        cv::Mat noise(120, 160, CV_8UC3);
        rng.fill(noise, cv::RNG::UNIFORM, 0, 256);
        (void)sink->write(noise, moment(i));
      }
      sink->finish();
    } catch (const OutputError& error) {
      refused = true;
      EXPECT_THAT(error.what(), HasSubstr(file));
    }
  }
  ::setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, handler);
  EXPECT_TRUE(refused);
  EXPECT_EQ(read_file(file, 10), "old");
  EXPECT_EQ(files(), 1U);
}

INSTANTIATE_TEST_SUITE_P(Containers, VideoSinkTest, testing::Values(".mp4", ".avi", ".mkv"),
                         [](const auto& suite) { return std::string(suite.param + 1); });

// --- recordings ---

// Frames with one grey level each, which the codec preserves.
cv::Mat numbered(int number) { return filled(64, 48, 8 * (number % 30) + 8); }

// The number of frames that can be read in order from the first.
int frames_in(const std::string& file) {
  cv::VideoCapture video(file, cv::CAP_FFMPEG);
  cv::Mat frame;
  int count = 0;
  while (video.read(frame) && std::abs(cv::mean(frame)[1] - cv::mean(numbered(count))[1]) < 4) {
    ++count;
  }
  return count;
}

constexpr char kTaken = '\a';  // printed by nothing else

// No test: this program is started and killed by another test. It reports each frame that was
// taken.
TEST(Recording, DISABLED_Writer) {
  const char* file = std::getenv("TARSIER_TEST_RECORDING");
  if (file == nullptr) GTEST_SKIP() << "started by another test";
  SinkOptions options;
  options.fps = 25;
  options.recording = true;
  const auto sink = open_sink(file, options);
  for (int i = 0; i < 100'000; ++i) {
    (void)sink->write(numbered(i), moment(i));
    if (::write(STDOUT_FILENO, &kTaken, 1) != 1) break;
  }
}

// Starts the writer above, kills it after `frames` reports, and returns the number of reports.
int record_and_kill(const std::string& file, int frames) {
  int output[2];
  if (::pipe2(output, O_CLOEXEC) != 0) throw std::runtime_error("pipe");
  const pid_t child = ::fork();
  if (child == 0) {
    ::dup2(output[1], STDOUT_FILENO);
    ::setenv("TARSIER_TEST_RECORDING", file.c_str(), 1);
    ::execl("/proc/self/exe", "writer", "--gtest_also_run_disabled_tests", "--gtest_brief=1",
            "--gtest_filter=Recording.DISABLED_Writer", nullptr);
    ::_exit(127);
  }
  ::close(output[1]);
  int written = 0;
  const auto take = [&] {
    char text[256];
    const ssize_t count = ::read(output[0], text, sizeof text);
    written += count > 0 ? static_cast<int>(std::count(text, text + count, kTaken)) : 0;
    return count > 0;
  };
  while (written < frames && take()) {
  }
  ::kill(child, SIGKILL);
  while (take()) {
  }
  ::close(output[0]);
  ::waitpid(child, nullptr, 0);
  return written;
}

class RecordingTest : public FrameSinkTest, public testing::WithParamInterface<const char*> {};

TEST_P(RecordingTest, IsPlayableAfterKill) {
  int last = 0;
  for (const int frames : {80, 131, 457}) {
    const std::string file = path(std::to_string(frames) + GetParam());
    const int written = record_and_kill(file, frames);
    ASSERT_GE(written, frames);
    EXPECT_FALSE(fs::exists(file));
    const std::string part = path(std::to_string(frames) + ".part" + GetParam());
    const int recovered = frames_in(part);
    EXPECT_GE(recovered, written - 2 * 25)
        << "of " << written << ": more than two seconds are missing";
    EXPECT_LE(recovered, written + 1);
    last = recovered;
  }
  EXPECT_GT(last, 400);
}

TEST_P(RecordingTest, IsRenamedAtTheEndAndPlaysCompletely) {
  const std::string file = path(std::string("v") + GetParam());
  SinkOptions options;
  options.recording = true;
  const auto sink = open_sink(file, options);
  for (int i = 0; i < 60; ++i) (void)sink->write(numbered(i), moment(i));
  EXPECT_EQ(files(), 1U);
  EXPECT_TRUE(fs::exists(path(std::string("v.part") + GetParam())));
  sink->finish();
  EXPECT_EQ(files(), 1U);
  EXPECT_EQ(frames_in(file), 60);
}

TEST_P(RecordingTest, IsKeptIfFinishFails) {
  const std::string part = path(std::string("v.part") + GetParam());
  testing::internal::CaptureStderr();
  {
    SinkOptions options;
    options.recording = true;
    const auto sink = open_sink(path(std::string("v") + GetParam()), options);
    for (int i = 0; i < 60; ++i) (void)sink->write(numbered(i), moment(i));
  }
  EXPECT_THAT(testing::internal::GetCapturedStderr(),
              HasSubstr("what was recorded is kept in " + part));
  EXPECT_EQ(frames_in(part), 60);
}

INSTANTIATE_TEST_SUITE_P(Containers, RecordingTest, testing::Values(".mp4", ".avi", ".mkv"),
                         [](const auto& suite) { return std::string(suite.param + 1); });

TEST_F(FrameSinkTest, SegmentsAreSeparateFilesWithContinuousNumbers) {
  SinkOptions options;
  options.fps = 10;
  options.segment_s = 2;
  for (const bool recording : {true, false}) {
    options.recording = recording;
    const auto sink = open_sink(path("v.mkv"), options);
    for (int i = 0; i < 45; ++i) {
      (void)sink->write(numbered(i % 20), moment(i));
      if (i == 20) {
        EXPECT_TRUE(fs::exists(path(recording ? "v-0001.mkv" : "v-0004.mkv")));
      }
    }
    sink->finish();
  }
  EXPECT_EQ(files(), 6U);
  for (int i = 1; i <= 6; ++i) {
    EXPECT_EQ(frames_in(path("v-000" + std::to_string(i) + ".mkv")), i % 3 == 0 ? 5 : 20) << i;
  }
  // An incomplete recording also uses a number.
  std::ofstream(path("v-0007.part.mkv")) << "x";
  options.recording = true;
  testing::internal::CaptureStderr();
  const auto sink = open_sink(path("v.mkv"), options);
  (void)sink->write(numbered(0), moment(0));
  sink->finish();
  (void)testing::internal::GetCapturedStderr();
  EXPECT_TRUE(fs::exists(path("v-0008.mkv")));
  EXPECT_THROW((void)open_sink(path("a.png"), options), UsageError);
}

TEST_F(FrameSinkTest, AVideoNeedsARegularFile) {
  ASSERT_EQ(::mkfifo(path("pipe.mp4").c_str(), 0600), 0);
  EXPECT_THROW((void)open_sink(path("pipe.mp4")), OutputError);
}

TEST_F(FrameSinkTest, OptionsAndImagesAreChecked) {
  SinkOptions options;
  options.fps = 0;
  EXPECT_THROW((void)open_sink("none", options), std::invalid_argument);
  options = {};
  options.jpeg_quality = 101;
  EXPECT_THROW((void)open_sink("none", options), std::invalid_argument);
  const auto sink = open_sink("none");
  EXPECT_THROW((void)sink->write(cv::Mat(), moment(0)), std::invalid_argument);
  EXPECT_THROW((void)sink->write(cv::Mat(2, 2, CV_32FC3), moment(0)), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier
