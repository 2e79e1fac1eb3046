// SPDX-License-Identifier: MIT
#include "tarsier/media/mjpeg_parser.h"

#include "tarsier/core/rng.h"
#include "tarsier/media/testing_http_server.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <string>

namespace tarsier {
namespace {

using test_support::bytes_of;

std::string text_of(const std::vector<std::uint8_t>& bytes) { return {bytes.begin(), bytes.end()}; }

// Images with rich content, so that their coded data contains FF 00.
std::string textured_jpeg(int number) {
  cv::Mat image(48, 64, CV_8UC3);
  cv::RNG rng(static_cast<std::uint64_t>(number) + 1);
  rng.fill(image, cv::RNG::UNIFORM, 0, 256);
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", image, bytes,
               {cv::IMWRITE_JPEG_QUALITY, 95, cv::IMWRITE_JPEG_RST_INTERVAL, 2});
  return text_of(bytes);
}

// Feeds pieces of random size and returns every image.
std::vector<std::string> images_in(std::string_view stream, std::uint64_t seed, int largest) {
  MjpegParser parser;
  Rng rng(seed);
  std::vector<std::string> images;
  std::size_t at = 0;
  while (at < stream.size()) {
    const auto size = std::min<std::size_t>(static_cast<std::size_t>(rng.integer(1, largest)),
                                            stream.size() - at);
    const int completed = parser.feed(bytes_of(stream.substr(at, size)));
    at += size;
    EXPECT_LE(completed, largest);
    if (parser.has_frame()) images.push_back(text_of(parser.take()));
  }
  return images;
}

TEST(MjpegParser, FindsEachImageForEveryFramingAndSplit) {
  std::vector<std::string> sent;
  for (int i = 0; i < 4; ++i) sent.push_back(textured_jpeg(i));
  std::string bare;
  std::string with_length;
  std::string without_length = "\r\n";
  std::string wrong_length;
  for (const std::string& jpeg : sent) {
    bare += jpeg;
    with_length += test_support::part_of(jpeg);
    without_length += "----=_\"x y\"\r\ncontent-type:image/jpeg\r\n\r\n" + jpeg + "\r\n";
    wrong_length += "--b\nContent-Length: 7\n\n" + jpeg + std::string(5, '\0');
  }
  for (const std::string& stream : {bare, with_length, without_length, wrong_length}) {
    for (std::uint64_t seed = 0; seed < 20; ++seed) {
      EXPECT_EQ(images_in(stream, seed, 300), sent);
    }
    EXPECT_EQ(images_in(stream, 1, 1), sent);
  }
}

TEST(MjpegParser, KeepsOnlyTheNewestImage) {
  MjpegParser parser;
  const std::string newest = test_support::jpeg_of(3);
  EXPECT_EQ(parser.feed(bytes_of(test_support::jpeg_of(1) + test_support::jpeg_of(2) + newest)), 3);
  EXPECT_EQ(text_of(parser.take()), newest);
  EXPECT_FALSE(parser.has_frame());
}

TEST(MjpegParser, IgnoresEmbeddedThumbnails) {
  const std::string jpeg = test_support::jpeg_of(5);
  const std::string thumbnail = test_support::jpeg_of(6, {16, 16});
  const std::size_t length = thumbnail.size() + 2;
  const std::string with_thumbnail = jpeg.substr(0, 2) + "\xff\xe1" +
                                     static_cast<char>(length >> 8U) +
                                     static_cast<char>(length & 0xffU) + thumbnail + jpeg.substr(2);
  MjpegParser parser;
  EXPECT_EQ(parser.feed(bytes_of(with_thumbnail)), 1);
  EXPECT_EQ(text_of(parser.take()), with_thumbnail);
}

TEST(MjpegParser, ImagesMayHaveManySegments) {
  const std::string jpeg = test_support::jpeg_of(5);
  std::string comments;
  for (int i = 0; i < 20; ++i)
    comments += std::string(
        "\xff\xfe\x00\x05"
        "abc",
        7);
  const std::string image = jpeg.substr(0, 2) + comments + jpeg.substr(2);
  MjpegParser parser;
  EXPECT_EQ(parser.feed(bytes_of(image + jpeg)), 2);
  EXPECT_EQ(text_of(parser.take()), jpeg);
  EXPECT_EQ(parser.feed(bytes_of(image)), 1);
  EXPECT_EQ(text_of(parser.take()), image);
}

TEST(MjpegParser, ResumesAfterGarbageAndTruncatedImages) {
  const std::string jpeg = textured_jpeg(1);
  Rng rng(7);
  for (int round = 0; round < 100; ++round) {
    std::string garbage;
    for (int i = rng.integer(0, 3000); i > 0; --i)
      garbage += static_cast<char>(rng.integer(0, 255));
    const std::string cut =
        jpeg.substr(0, static_cast<std::size_t>(rng.integer(0, static_cast<int>(jpeg.size()) - 1)));
    MjpegParser parser;
    parser.feed(bytes_of(garbage));
    parser.feed(bytes_of(cut));
    // A false start may swallow one segment (at most 64 kB) before it is detected.
    int completed = 0;
    for (int i = 0; i < 40; ++i) completed += parser.feed(bytes_of(test_support::part_of(jpeg)));
    EXPECT_GE(completed, 20) << "round " << round;
    EXPECT_EQ(text_of(parser.take()), jpeg) << "round " << round;
  }
}

TEST(MjpegParser, MemoryIsBounded) {
  constexpr std::size_t kLimit = 100'000;
  MjpegParser parser(kLimit);
  // An image with endless coded data, then a valid one.
  std::string endless = test_support::jpeg_of(1);
  endless.resize(endless.size() - 2);
  parser.feed(bytes_of(endless));
  const std::string filling(10'000, 'x');
  for (int i = 0; i < 1000; ++i) {
    parser.feed(bytes_of(filling));
    ASSERT_LE(parser.held_bytes(), 8 * kLimit);
  }
  EXPECT_FALSE(parser.has_frame());
  EXPECT_EQ(parser.feed(bytes_of(test_support::jpeg_of(2))), 1);
  EXPECT_GT(parser.skipped_bytes(), 9'900'000U);
}

// The data behind an oversized image is parsed, however much of it arrives in one piece.
TEST(MjpegParser, OversizedImagesAreIndependentOfSplits) {
  constexpr std::size_t kLimit = 2048;
  const std::string good = test_support::jpeg_of(2);
  ASSERT_LT(good.size(), kLimit);
  // A segment with a stated length of 60 000 bytes.
  const std::string endless = "\xff\xd8\xff\xe0\xea\x60" + std::string(3000, 'x');
  const std::string stream = endless + good + endless + good;
  for (const std::size_t size : {std::size_t{1}, std::size_t{7}, kLimit - 1, kLimit, kLimit + 1,
                                 std::size_t{5000}, stream.size()}) {
    MjpegParser parser(kLimit);
    int found = 0;
    for (std::size_t at = 0; at < stream.size(); at += size)
      found += parser.feed(bytes_of(stream.substr(at, size)));
    EXPECT_EQ(found, 2) << size;
    EXPECT_EQ(parser.skipped_bytes(), 2 * endless.size()) << size;
  }
}

// The worst streams that a server can send, each in pieces of several sizes. The test counts work
// instead of time.
TEST(MjpegParser, CostPerByteIsBoundedForAnyStream) {
  using std::string_literals::operator""s;
  constexpr std::size_t kSize = 1'000'000;
  const auto repeated = [](const std::string& unit) {
    std::string text;
    while (text.size() < kSize) text += unit;
    return text;
  };
  // Many starts that lead into the same chain of segments, which is broken at its end.
  std::string chain;
  for (int i = 0; i < 200; ++i) chain += "\xff\xe0\x00\x02"s;
  chain += "xx";
  std::string funnel;
  for (std::size_t left = 9000; left > 0; left -= 6) {
    const std::size_t length = left - 6 + 2;  // from the first byte of the length to the chain
    funnel +=
        "\xff\xd8\xff\xe0"s + static_cast<char>(length >> 8U) + static_cast<char>(length & 0xffU);
  }
  const std::vector<std::pair<const char*, std::string>> streams{
      {"starts", repeated("\xff\xd8\xff\xe0\x00\x02"s)},
      {"segments", "\xff\xd8"s + repeated("\xff\xe0\x00\x02"s)},
      {"false starts", repeated("\xff\xd8\xff\xe0\xff\xff"s)},
      {"bare starts", repeated("\xff\xd8\xff"s)},
      {"filling", "\xff\xd8"s + repeated("\xff"s)},
      {"funnels", repeated(funnel + chain)},
      {"coded data", "\xff\xd8\xff\xc0\x00\x02\xff\xda\x00\x02"s + repeated("\xff\x00"s)},
  };
  for (const auto& [name, stream] : streams) {
    std::uint64_t skipped = 0;
    for (const std::size_t piece : {std::size_t{1}, std::size_t{1000}, kSize * 2}) {
      MjpegParser parser;
      int found = 0;
      for (std::size_t at = 0; at < stream.size(); at += piece)
        found += parser.feed(bytes_of(std::string_view(stream).substr(at, piece)));
      EXPECT_EQ(found, 0) << name;
      EXPECT_LE(parser.work(), 16 * stream.size()) << name << " in pieces of " << piece;
      parser.reset();
      EXPECT_EQ(parser.skipped_bytes(), stream.size()) << name;
      if (piece == 1) skipped = parser.skipped_bytes();
      EXPECT_EQ(parser.skipped_bytes(), skipped) << name;
      EXPECT_EQ(parser.feed(bytes_of(test_support::jpeg_of(2))), 1) << name;
    }
  }
}

TEST(MjpegParser, HandlesArbitraryBytes) {
  Rng rng(3);
  const std::string jpeg = textured_jpeg(2);
  for (int round = 0; round < 300; ++round) {
    std::string bytes = jpeg + jpeg;
    for (int i = 0; i < 40; ++i) {
      bytes[static_cast<std::size_t>(rng.integer(0, static_cast<int>(bytes.size()) - 1))] =
          static_cast<char>(rng.integer(0, 3) == 0 ? 0xff : rng.integer(0, 255));
    }
    MjpegParser parser(2048);
    parser.feed(bytes_of(bytes));
    const auto image = parser.take();
    if (!image.empty()) {
      EXPECT_EQ(image[1], 0xd8);
      EXPECT_EQ(image.back(), 0xd9);
    }
  }
}

}  // namespace
}  // namespace tarsier
