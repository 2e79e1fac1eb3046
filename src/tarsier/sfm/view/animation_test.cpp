// SPDX-License-Identifier: MIT
#include "animation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

std::string scratch(const std::string& name) {
  return (std::filesystem::path(testing::TempDir()) / ("sfm_view_" + name)).string();
}

// An independent reader that follows the standard directly.
struct Gif {
  std::vector<cv::Mat> frames;
  std::vector<int> delays;  // 1/100 s
  bool repeats = false;
};

class GifReader {
 public:
  explicit GifReader(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    bytes_.assign(std::istreambuf_iterator<char>(file), {});
  }

  Gif read() {
    Gif gif;
    if (text(6) != "GIF89a") throw std::runtime_error("head");
    const int width = word();
    const int height = word();
    const int flags = byte();
    skip(2);
    std::vector<cv::Vec3b> palette(std::size_t{2} << (flags & 7));
    for (auto& color : palette)
      for (int k = 2; k >= 0; --k) color[k] = static_cast<std::uint8_t>(byte());
    cv::Mat canvas(height, width, CV_8UC3, cv::Scalar::all(0));
    int clear = -1;
    for (;;) {
      const int kind = byte();
      if (kind == 0x3b) break;
      if (kind == 0x21) {
        const int label = byte();
        const std::string data = blocks();
        if (label == 0xff) gif.repeats = data == std::string("NETSCAPE2.0\x01\0\0", 14);
        if (label == 0xf9) {
          gif.delays.push_back(static_cast<std::uint8_t>(data[1]) |
                               static_cast<std::uint8_t>(data[2]) << 8);
          clear = data[0] & 1 ? static_cast<std::uint8_t>(data[3]) : -1;
        }
        continue;
      }
      if (kind != 0x2c) throw std::runtime_error("block");
      const int left = word();
      const int top = word();
      const int w = word();
      const int h = word();
      if (byte() != 0) throw std::runtime_error("flags");
      const int bits = byte();
      const std::vector<int> pixels = unpacked(blocks(), bits);
      if (pixels.size() != static_cast<std::size_t>(w) * static_cast<std::size_t>(h))
        throw std::runtime_error("number of pixels");
      for (int y = 0; y < h; ++y) {
        for (int x = 0; x < w; ++x) {
          const int index = pixels[static_cast<std::size_t>(y * w + x)];
          if (index != clear)
            canvas.at<cv::Vec3b>(top + y, left + x) = palette.at(static_cast<std::size_t>(index));
        }
      }
      gif.frames.push_back(canvas.clone());
    }
    if (at_ != bytes_.size()) throw std::runtime_error("bytes after the end");
    return gif;
  }

 private:
  static std::vector<int> unpacked(const std::string& data, int pixel_bits) {
    const int clear = 1 << pixel_bits;
    std::vector<int> result;
    std::vector<std::vector<int>> table;
    std::vector<int> last;
    int bits = pixel_bits + 1;
    const auto reset = [&] {
      table.clear();
      for (int i = 0; i < clear + 2; ++i) table.push_back({i});
      bits = pixel_bits + 1;
      last.clear();
    };
    std::size_t at = 0;
    for (;;) {
      int code = 0;
      for (int i = 0; i < bits; ++i, ++at) {
        if (at / 8 >= data.size()) throw std::runtime_error("no end code");
        code |= (static_cast<std::uint8_t>(data[at / 8]) >> (at % 8) & 1) << i;
      }
      if (code == clear) {
        reset();
        continue;
      }
      if (code == clear + 1) break;
      std::vector<int> now;
      if (static_cast<std::size_t>(code) < table.size()) {
        now = table[static_cast<std::size_t>(code)];
      } else {
        if (last.empty() || static_cast<std::size_t>(code) != table.size())
          throw std::runtime_error("code");
        now = last;
        now.push_back(last[0]);
      }
      if (!last.empty() && table.size() < 4096) {
        std::vector<int> longer = last;
        longer.push_back(now[0]);
        table.push_back(longer);
        if (table.size() == std::size_t{1} << bits && bits < 12) ++bits;
      }
      result.insert(result.end(), now.begin(), now.end());
      last = now;
    }
    return result;
  }

  int byte() { return static_cast<std::uint8_t>(bytes_.at(at_++)); }
  int word() {
    const int low = byte();
    return low | byte() << 8;
  }
  void skip(std::size_t count) { at_ += count; }
  std::string text(std::size_t count) {
    at_ += count;
    return bytes_.substr(at_ - count, count);
  }
  std::string blocks() {
    std::string result;
    while (const int size = byte()) result += text(static_cast<std::size_t>(size));
    return result;
  }

  std::string bytes_;
  std::size_t at_ = 0;
};

TEST(Gif, FewColorsRoundTripExactly) {
  std::vector<cv::Mat> frames;
  for (int i = 0; i < 4; ++i) {
    cv::Mat frame(61, 83, CV_8UC3, cv::Scalar(250, 248, 246));
    frame(cv::Rect(5 + 12 * i, 10, 20, 30)).setTo(cv::Scalar(20, 60 + 40 * i, 200));
    frames.push_back(frame);
  }
  const std::string path = scratch("few.gif");
  write_gif(path, frames, 8);
  const Gif gif = GifReader(path).read();
  EXPECT_TRUE(gif.repeats);
  ASSERT_EQ(gif.frames.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_EQ(cv::norm(gif.frames[i], frames[i], cv::NORM_INF), 0) << i;
  // 12.5 hundredths each, 50 in all.
  EXPECT_EQ(gif.delays, (std::vector<int>{13, 12, 13, 12}));
}

TEST(Gif, ManyColorsAreApproximated) {
  std::vector<cv::Mat> frames;
  for (int i = 0; i < 3; ++i) {
    cv::Mat frame(200, 256, CV_8UC3);
    for (int y = 0; y < frame.rows; ++y)
      for (int x = 0; x < frame.cols; ++x)
        frame.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(x), static_cast<std::uint8_t>(y),
                                     static_cast<std::uint8_t>(60 * i)};
    frames.push_back(frame);
  }
  const std::string path = scratch("many.gif");
  write_gif(path, frames, 10);
  const Gif gif = GifReader(path).read();
  ASSERT_EQ(gif.frames.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    const double mean = cv::norm(gif.frames[i], frames[i], cv::NORM_L1) /
                        static_cast<double>(3 * frames[i].total());
    EXPECT_LT(mean, 7) << i;
    EXPECT_LT(cv::norm(gif.frames[i], frames[i], cv::NORM_INF), 48) << i;
  }
}

// The noise fills the code table many times.
TEST(Gif, NoiseOfAnySizeRoundTrips) {
  Rng random(3);
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(2, 1), cv::Size(17, 15), cv::Size(255, 1),
                              cv::Size(23, 11), cv::Size(64, 61), cv::Size(300, 200)}) {
    cv::Mat frame(size, CV_8UC3);
    for (int y = 0; y < size.height; ++y)
      for (int x = 0; x < size.width; ++x)
        frame.at<cv::Vec3b>(y, x) =
            cv::Vec3b::all(static_cast<std::uint8_t>(random.integer(0, 200 - 1)));
    const std::string path = scratch("noise.gif");
    write_gif(path, {frame}, 1);
    const Gif gif = GifReader(path).read();
    ASSERT_EQ(gif.frames.size(), 1U);
    EXPECT_EQ(cv::norm(gif.frames[0], frame, cv::NORM_INF), 0) << size;
  }
}

// All lengths up to two increases of the code length: the end code has the right length.
TEST(Gif, NoiseOfEveryLengthRoundTrips) {
  Rng random(4);
  cv::Mat all(1, 1100, CV_8UC3);
  for (int x = 0; x < all.cols; ++x)
    all.at<cv::Vec3b>(0, x) = cv::Vec3b::all(static_cast<std::uint8_t>(random.integer(0, 250 - 1)));
  const std::string path = scratch("length.gif");
  for (int length = 240; length <= all.cols; length += length > 270 && length < 740 ? 13 : 1) {
    const cv::Mat frame = all.colRange(0, length).clone();
    write_gif(path, {frame}, 1);
    EXPECT_EQ(cv::norm(GifReader(path).read().frames.at(0), frame, cv::NORM_INF), 0) << length;
  }
}

TEST(Gif, LargeBackgroundLeavesColorsForTheRest) {
  cv::Mat frame(300, 300, CV_8UC3, cv::Scalar(250, 248, 246));
  for (int y = 0; y < 60; ++y)
    for (int x = 0; x < 60; ++x)
      frame.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(4 * x),
                                   static_cast<std::uint8_t>(4 * y), 90};
  const std::string path = scratch("background.gif");
  write_gif(path, {frame}, 5);
  const cv::Mat back = GifReader(path).read().frames.at(0);
  EXPECT_EQ(back.at<cv::Vec3b>(200, 200), cv::Vec3b(250, 248, 246));
  EXPECT_LT(cv::norm(back(cv::Rect(0, 0, 60, 60)), frame(cv::Rect(0, 0, 60, 60)), cv::NORM_L1) /
                (60 * 60 * 3),
            6);
}

TEST(Gif, RefusesInvalidFrames) {
  const cv::Mat frame(4, 4, CV_8UC3, cv::Scalar::all(9));
  EXPECT_THROW(write_gif("/nowhere/at/all.gif", {frame}, 5), OutputError);
  EXPECT_THROW(write_gif(scratch("x.gif"), {}, 5), std::invalid_argument);
  EXPECT_THROW(write_gif(scratch("x.gif"), {frame}, 0), std::invalid_argument);
  EXPECT_THROW(write_gif(scratch("x.gif"), {frame, cv::Mat(4, 5, CV_8UC3)}, 5),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
