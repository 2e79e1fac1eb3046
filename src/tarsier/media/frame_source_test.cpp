// SPDX-License-Identifier: MIT
#include "tarsier/media/frame_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_log.h"
#include "tarsier/media/cameras.h"
#include "tarsier/media/still_source.h"
#include "tarsier/media/testing_http_server.h"
#include "tarsier/media/video_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

class FrameSourceTest : public ::testing::Test {
 protected:
  FrameSourceTest() {
    folder_ = fs::temp_directory_path() /
              ("tarsier_sources_" + std::to_string(::getpid()) + "_" +
               ::testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  ~FrameSourceTest() override { fs::remove_all(folder_); }

  const ScopedLogLevel log_level_{LogLevel::kOff};
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& bytes) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return path(name);
  }
  std::string image(const std::string& name, int number) const {
    return write(name, test_support::jpeg_of(number));
  }
  std::string video(const std::string& name, int frames, double fps) const {
    cv::VideoWriter writer(path(name), cv::CAP_OPENCV_MJPEG,
                           cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), fps, {64, 48});
    for (int i = 0; i < frames; ++i)
      writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(8.0 * i)));
    return path(name);
  }

  fs::path folder_;
};

struct Read {
  std::vector<std::string> names;
  std::vector<int> numbers;
  std::vector<Frame> frames;
};

Read read_all(FrameSource& source) {
  Read result;
  while (auto frame = source.next(milliseconds(1000), {})) {
    EXPECT_EQ(frame->index, static_cast<std::int64_t>(result.frames.size()));
    result.names.push_back(fs::path(frame->name).filename().string());
    result.numbers.push_back(test_support::number_of(frame->image));
    result.frames.push_back(std::move(*frame));
  }
  EXPECT_TRUE(source.ended());
  EXPECT_EQ(source.status().state, SourceState::kEnded);
  return result;
}

std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "nothing thrown";
}
std::string open_error(const std::string& text) {
  return error_of([&] {
    const auto source = open_source(text);
    while (source->next(milliseconds(1000), {})) {
    }
  });
}

TEST_F(FrameSourceTest, KindsAreClassified) {
  const std::vector<Scheme> schemes = {{"synth", {}}};
  const auto kind = [&](const std::string& text) { return classify_source(text, schemes); };
  EXPECT_EQ(kind("0"), SourceKind::kCamera);
  EXPECT_EQ(kind("/dev/video0"), SourceKind::kCamera);
  EXPECT_EQ(kind("/dev/v4l/by-id/usb-x"), SourceKind::kCamera);
  EXPECT_EQ(kind("picam:"), SourceKind::kPiCamera);
  EXPECT_EQ(kind("picam:1"), SourceKind::kPiCamera);
  EXPECT_EQ(kind("http://h/x"), SourceKind::kHttp);
  EXPECT_EQ(kind("HTTPS://h/x"), SourceKind::kHttp);
  EXPECT_EQ(kind("rtsps://h/x"), SourceKind::kFfmpegUrl);
  EXPECT_EQ(kind("rtsp://h/x"), SourceKind::kFfmpegUrl);
  EXPECT_EQ(kind("synth:scene?fps=3"), SourceKind::kScheme);
  EXPECT_EQ(kind(folder_.string()), SourceKind::kFolder);
  EXPECT_EQ(kind(path("*.jpg")), SourceKind::kGlob);
  EXPECT_EQ(kind("@" + write("list.txt", "x")), SourceKind::kList);
  EXPECT_EQ(kind(image("an image ! [1] pipeline.jpg", 1)), SourceKind::kImage);
  EXPECT_EQ(kind(image("no-ending", 1)), SourceKind::kImage);
  EXPECT_EQ(kind(video("v.avi", 2, 10)), SourceKind::kVideo);
  EXPECT_EQ(kind(write("stream.mjpeg", test_support::jpeg_of(1) + test_support::jpeg_of(2))),
            SourceKind::kVideo);
}

TEST_F(FrameSourceTest, OtherFilesAreRefused) {
  for (const std::string text :
       {"", "nowhere.jpg", "videotestsrc ! appsink", "ftp://h/x", "file:///etc/passwd", "udp://h:1",
        "synth:scene", "gst:videotestsrc", "picam:x", "http://", "@nowhere.txt", "/dev/null",
        "/dev/zero"}) {
    EXPECT_THROW((void)classify_source(text), InputError) << text;
  }
  EXPECT_THROW((void)classify_source(write("notes.txt", "hello")), InputError);
  EXPECT_THROW((void)classify_source(write("empty.bin", "")), InputError);
  ASSERT_EQ(::mkfifo(path("fifo.avi").c_str(), 0600), 0);
  EXPECT_THROW((void)classify_source(path("fifo.avi")),
               InputError);  // opening it would block for ever
  EXPECT_EQ(open_error("nowhere.jpg"), "nowhere.jpg: no such file or folder");
  EXPECT_THAT(open_error("ftp://me:secret@h/x"), HasSubstr("unknown kind of address 'ftp:'"));
  EXPECT_THAT(open_error("ftp://me:secret@h/x"), ::testing::Not(HasSubstr("secret")));
}

TEST_F(FrameSourceTest, AnImageIsOneStillFrame) {
  const std::string name = image("one.jpg", 3);
  const auto source = open_source(name);
  EXPECT_EQ(source->count(), 1);
  EXPECT_FALSE(source->is_live());
  const Read read = read_all(*source);
  EXPECT_THAT(read.numbers, ElementsAre(3));
  EXPECT_TRUE(read.frames[0].still);
  EXPECT_EQ(read.frames[0].name, name);
  EXPECT_EQ(source->fps(), 0);
}

TEST_F(FrameSourceTest, FolderYieldsOnlyImagesInNaturalOrder) {
  image("img10.jpg", 10);
  image("img2.JPG", 2);
  image("img1.jpeg", 1);
  image(".hidden.jpg", 20);
  image("sub/below.jpg", 21);
  write("notes.txt", "x");
  const auto source = open_source(folder_.string());
  EXPECT_EQ(source->count(), 3);
  EXPECT_THAT(read_all(*source).names, ElementsAre("img1.jpeg", "img2.JPG", "img10.jpg"));
}

TEST_F(FrameSourceTest, ASequenceHasTimes) {
  for (int i = 0; i < 3; ++i) image("f" + std::to_string(i) + ".jpg", i);
  SourceOptions options;
  options.sequence = true;
  options.fps = 10;
  const auto source = open_source(folder_.string(), options);
  EXPECT_EQ(source->fps(), 10);
  const Read read = read_all(*source);
  ASSERT_EQ(read.frames.size(), 3U);
  EXPECT_FALSE(read.frames[2].still);
  EXPECT_DOUBLE_EQ(read.frames[2].time, 0.2);
}

TEST_F(FrameSourceTest, ConcatenatesGlobsListsAndInputs) {
  image("a1.jpg", 1);
  image("a2.jpg", 2);
  image("sub/b.jpg", 3);
  video("v.avi", 2, 10);
  const std::string list =
      write("list.txt", "# images\n\n  a2.jpg\r\nsub/b.jpg\nv.avi\n" + path("a1.jpg"));
  EXPECT_THAT(read_all(*open_source(path("a*.jpg"))).numbers, ElementsAre(1, 2));
  EXPECT_THAT(read_all(*open_source("@" + list)).numbers, ElementsAre(2, 3, 0, 1, 1));
  const auto source =
      open_sources({path("a1.jpg"), path("v.avi"), path("sub"), path("v.avi"), path("a2.jpg")});
  const Read read = read_all(*source);
  EXPECT_THAT(read.numbers, ElementsAre(1, 0, 1, 3, 0, 1, 2));
  EXPECT_TRUE(read.frames[3].still);
  EXPECT_FALSE(read.frames[4].still);
  EXPECT_LT(read.frames[2].time, read.frames[4].time);  // the second video comes after the first
  EXPECT_EQ(read.frames[2].start_index, 1);
  EXPECT_EQ(read.frames[2].start_time, 0);
  EXPECT_EQ(read.frames[5].start_index, 4);
  EXPECT_DOUBLE_EQ(read.frames[5].start_time, read.frames[4].time);
}

TEST_F(FrameSourceTest, ABatchKeepsItsNumbersAndReportsWhatItSkips) {
  image("1.jpg", 1);
  write("2.jpg", "this is no image");
  std::vector<std::int64_t> skipped;
  const auto on_skip = [&](std::int64_t number, const std::string& reason) {
    EXPECT_THAT(reason, HasSubstr(path("2.jpg") + ": "));
    skipped.push_back(number);
  };
  const auto source = make_batch_source({{70, path("2.jpg")}, {30, path("1.jpg")}}, on_skip);
  EXPECT_EQ(source->count(), 2);
  const auto frame = source->next(std::chrono::milliseconds(0), {});
  ASSERT_TRUE(frame.has_value());
  EXPECT_EQ(frame->index, 30);
  EXPECT_TRUE(frame->still);
  EXPECT_EQ(skipped, std::vector<std::int64_t>{70});
  EXPECT_TRUE(source->ended());
  // An unreadable file is no error here, and there may be no file.
  const auto broken = make_batch_source({{5, path("2.jpg")}}, on_skip);
  EXPECT_FALSE(broken->next(std::chrono::milliseconds(0), {}).has_value());
  EXPECT_EQ(skipped.back(), 5);
  EXPECT_TRUE(make_batch_source({}, on_skip)->ended());
}

TEST_F(FrameSourceTest, UnreadableImagesAmongSeveralAreSkippedAndReported) {
  image("1.jpg", 1);
  write("2.jpg", "this is no image");
  image("3.jpg", 3);
  write("4.png", test_support::jpeg_of(4).substr(0, 200));
  const auto source = open_source(folder_.string());
  EXPECT_THAT(read_all(*source).numbers, ElementsAre(1, 3));
  ASSERT_EQ(source->skipped().size(), 2U);
  EXPECT_THAT(source->skipped()[0], HasSubstr(path("2.jpg") + ": "));
  const auto chain = open_sources({path("1.jpg"), path("2.jpg"), path("3.jpg")});
  EXPECT_THAT(read_all(*chain).numbers, ElementsAre(1, 3));
  EXPECT_EQ(chain->skipped().size(), 1U);
  const auto mixed = open_sources({video("v.avi", 1, 10), path("2.jpg"), path("3.jpg")});
  EXPECT_THAT(read_all(*mixed).numbers, ElementsAre(0, 3));
  EXPECT_EQ(mixed->skipped().size(), 1U);
  // A list may contain files that no longer exist.
  const auto list = open_source("@" + write("list.txt", "gone.jpg\n1.jpg\n"));
  EXPECT_THAT(read_all(*list).numbers, ElementsAre(1));
  EXPECT_EQ(list->skipped().size(), 1U);
}

TEST_F(FrameSourceTest, NoReadableImageIsAnError) {
  write("1.jpg", "no");
  EXPECT_THAT(open_error(path("1.jpg")), HasSubstr("1.jpg: "));
  write("2.jpg", "no");
  EXPECT_THAT(open_error(folder_.string()), HasSubstr("none of the 2 images could be read"));
  EXPECT_THAT(open_error(path("*.jpg")), HasSubstr("none of the 2 images"));
  EXPECT_THAT(error_of([&] {
                const auto source = open_sources(
                    {path("1.jpg"), write("v.avi", "RIFF0000AVI broken"), path("2.jpg")});
                while (source->next(milliseconds(0), {})) {
                }
              }),
              HasSubstr("none of the inputs could be read"));
  fs::create_directories(folder_ / "empty");
  EXPECT_THAT(open_error(path("empty")), HasSubstr("no images"));
  EXPECT_THAT(open_error(path("x*.jpg")), HasSubstr("no file matches"));
  EXPECT_THAT(open_error("@" + write("list.txt", "# nothing\n")), HasSubstr("lists no images"));
  EXPECT_THROW((void)open_sources({path("1.jpg"), path("mistyped.jpg")}), InputError);
}

TEST_F(FrameSourceTest, AVideoHasTimesAndEnds) {
  const auto source = open_source(video("v.avi", 5, 10));
  EXPECT_NEAR(source->fps(), 10, 0.01);
  EXPECT_EQ(source->count(), 5);
  const Read read = read_all(*source);
  EXPECT_THAT(read.numbers, ElementsAre(0, 1, 2, 3, 4));
  for (std::size_t i = 0; i < 5; ++i)
    EXPECT_NEAR(read.frames[i].time, 0.1 * static_cast<double>(i), 1e-3);
  EXPECT_FALSE(read.frames[0].still);
}

// FFmpeg would take the start of this name for a protocol.
TEST_F(FrameSourceTest, AVideoMayHaveAColonInItsName) {
  video("12:30.avi", 2, 10);
  const fs::path before = fs::current_path();
  fs::current_path(folder_);
  EXPECT_NO_THROW(EXPECT_EQ(read_all(*open_source("12:30.avi")).numbers.size(), 2U));
  fs::current_path(before);
}

TEST_F(FrameSourceTest, FilesThatAreNoVideosAreRefusedBeforeFfmpegOpensThem) {
  EXPECT_THAT(open_error(write("text.avi", "just some text")),
              HasSubstr("text.avi: is not a video"));
  EXPECT_THAT(open_error(write("list.mp4", "#EXTM3U\nfile:///etc/passwd\n")),
              HasSubstr("is not a video"));
  EXPECT_THAT(open_error(write("empty.mkv", "")), HasSubstr("is empty"));
  EXPECT_THAT(open_error(write("broken.avi",
                               "RIFF\x10\x01\x02\x03"
                               "AVI LIST" +
                                   std::string(500, 'x'))),
              HasSubstr("no frame"));
}

TEST_F(FrameSourceTest, StopTokenEndsReading) {
  image("a.jpg", 1);
  image("b.jpg", 2);
  const auto source = open_source(folder_.string());
  std::stop_source stopper;
  EXPECT_TRUE(source->next(milliseconds(0), stopper.get_token()).has_value());
  stopper.request_stop();
  EXPECT_FALSE(source->next(milliseconds(0), stopper.get_token()).has_value());
  EXPECT_FALSE(source->ended());
}

TEST(Cameras, ErrorsNameTheMissingDevice) {
  const SourceOptions options;
  EXPECT_EQ(error_of([&] { (void)open_source("99", options); }),
            "camera 99: no such device (/dev/video99); `tarsier doctor` lists cameras");
  EXPECT_THAT(error_of([&] { (void)open_source("/dev/v4l/by-id/none", options); }),
              HasSubstr("no such device"));
  for (const CameraInfo& camera : list_cameras()) EXPECT_THAT(camera.path, HasSubstr("/dev/video"));
}

TEST(Cameras, ErrorsOfThePiCameraNameWhatToInstall) {
  if (!find_program_on_path("rpicam-vid").empty() ||
      !find_program_on_path("libcamera-vid").empty()) {
    GTEST_SKIP() << "this is a Raspberry Pi";
  }
  EXPECT_THAT(error_of([] { (void)open_source("picam:"); }),
              HasSubstr("sudo apt install rpicam-apps"));
  EXPECT_EQ(find_program_on_path("sh").substr(0, 1), "/");
  EXPECT_EQ(find_program_on_path("no-such-program"), "");
}

TEST(NaturalOrder, ComparesNumbersByTheirValue) {
  EXPECT_TRUE(natural_less("img2", "img10"));
  EXPECT_FALSE(natural_less("img10", "img2"));
  EXPECT_TRUE(natural_less("a", "B"));
  EXPECT_TRUE(natural_less("x1y2", "x1y10"));
  EXPECT_TRUE(natural_less("a1", "a01") != natural_less("a01", "a1"));
  EXPECT_FALSE(natural_less("a", "a"));
  EXPECT_TRUE(natural_less("99999999999999999998", "99999999999999999999"));
}

TEST(Masked, HidesNamesAndPasswords) {
  EXPECT_EQ(masked("http://me:pw@host:80/x"), "http://***@host:80/x");
  EXPECT_EQ(masked("rtsp://me@host/x@y"), "rtsp://***@host/x@y");
  EXPECT_EQ(masked("http://host/x"), "http://host/x");
  EXPECT_EQ(masked("http://host/x?user=me&pwd=secret&size=3"),
            "http://host/x?user=***&pwd=***&size=3");
  EXPECT_EQ(masked("http://host:80/me@home"), "http://host:80/me@home");
  EXPECT_THAT(masked("http://me:p/w@host/x"), ::testing::Not(HasSubstr("p/w")));
  EXPECT_EQ(masked("image.jpg"), "image.jpg");
}

TEST(SourceOptionsTest, AreChecked) {
  SourceOptions options;
  EXPECT_NO_THROW(options.check());
  options.stall_s = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.fps = -1;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier
