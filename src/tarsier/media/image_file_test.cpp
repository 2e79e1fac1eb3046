// SPDX-License-Identifier: MIT
#include "tarsier/media/image_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

using ::testing::HasSubstr;
using Data = std::vector<std::uint8_t>;

// Smooth, so that lossy formats are close, and different at every corner.
cv::Mat test_image(int width = 64, int height = 48) {
  cv::Mat image(height, width, CV_8UC3);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.at<cv::Vec3b>(y, x) = {static_cast<std::uint8_t>(255 * x / width),
                                   static_cast<std::uint8_t>(255 * y / height),
                                   static_cast<std::uint8_t>(255 - 255 * x / width)};
    }
  }
  return image;
}

Data encoded(const std::string& extension, const cv::Mat& image,
             const std::vector<int>& parameters = {}) {
  Data bytes;
  cv::imencode(extension, image, bytes, parameters);
  return bytes;
}

std::string refusal(const Data& bytes, const ImageLimits& limits = {}) {
  try {
    (void)decode_image(bytes, "name.jpg", limits);
  } catch (const InputError& error) {
    EXPECT_EQ(error.path(), "name.jpg");
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
    return error.what();
  }
  return "accepted";
}

void put_big(Data& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    bytes.at(at + i) = static_cast<std::uint8_t>(value >> (24 - 8 * i));
}
void put_little(Data& bytes, std::size_t at, std::uint32_t value) {
  for (std::size_t i = 0; i < 4; ++i)
    bytes.at(at + i) = static_cast<std::uint8_t>(value >> (8 * i));
}

std::uint32_t crc(const std::uint8_t* bytes, std::size_t count) {
  std::uint32_t c = 0xFFFFFFFFU;
  for (std::size_t i = 0; i < count; ++i) {
    c ^= bytes[i];
    for (int k = 0; k < 8; ++k) c = (c & 1U) != 0 ? c >> 1U ^ 0xEDB88320U : c >> 1U;
  }
  return ~c;
}

// The checksum is right; only the size is wrong.
Data png_of_claimed_size(std::uint32_t width, std::uint32_t height) {
  Data bytes = encoded(".png", test_image());
  put_big(bytes, 16, width);
  put_big(bytes, 20, height);
  put_big(bytes, 29, crc(&bytes[12], 17));
  return bytes;
}

struct Format {
  std::string extension;
  std::vector<int> parameters;
  ImageFormat format;
  double error;  // max mean difference, grey levels
};

const std::vector<Format>& formats() {
  static const std::vector<Format> kFormats{
      {".jpg", {cv::IMWRITE_JPEG_QUALITY, 95}, ImageFormat::kJpeg, 3},
      {".jpg",
       {cv::IMWRITE_JPEG_QUALITY, 95, cv::IMWRITE_JPEG_PROGRESSIVE, 1},
       ImageFormat::kJpeg,
       3},
      {".jpg",
       {cv::IMWRITE_JPEG_QUALITY, 95, cv::IMWRITE_JPEG_RST_INTERVAL, 2},
       ImageFormat::kJpeg,
       3},
      {".png", {}, ImageFormat::kPng, 0},
      {".webp", {cv::IMWRITE_WEBP_QUALITY, 90}, ImageFormat::kWebp, 4},
      {".webp", {cv::IMWRITE_WEBP_QUALITY, 101}, ImageFormat::kWebp, 0},
      {".bmp", {}, ImageFormat::kBmp, 0},
      {".ppm", {}, ImageFormat::kPnm, 0},
      {".ppm", {cv::IMWRITE_PXM_BINARY, 0}, ImageFormat::kPnm, 0}};
  return kFormats;
}

TEST(ImageFile, EveryFormatRoundTrips) {
  for (const Format& f : formats()) {
    const Data bytes = encoded(f.extension, test_image(), f.parameters);
    const auto header = probe_image(bytes);
    ASSERT_TRUE(header) << f.extension;
    EXPECT_EQ(header->format, f.format);
    EXPECT_EQ(header->width, 64);
    EXPECT_EQ(header->height, 48);
    const cv::Mat image = decode_image(bytes, "x");
    ASSERT_EQ(image.type(), CV_8UC3);
    EXPECT_LE(cv::norm(image, test_image(), cv::NORM_L1) / (64 * 48 * 3), f.error) << f.extension;
  }
}

TEST(ImageFile, TruncatedFilesAreRefused) {
  for (const Format& f : formats()) {
    const Data whole = encoded(f.extension, test_image(), f.parameters);
    // A WebP file may have one byte of padding, and an ASCII image a last line break.
    for (std::size_t size = 0; size + 2 < whole.size(); size += size < 64 ? 1 : 37) {
      const Data cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_NE(refusal(cut), "accepted")
          << f.extension << " cut to " << size << " of " << whole.size();
    }
  }
}

TEST(ImageFile, ErrorsSayTruncated) {
  for (const char* extension : {".jpg", ".png", ".bmp", ".webp", ".ppm"}) {
    Data bytes = encoded(extension, test_image());
    bytes.resize(bytes.size() * 2 / 3);
    EXPECT_THAT(refusal(bytes), HasSubstr("truncated")) << extension;
  }
}

TEST(ImageFile, DamagedBytesNeverCrash) {
  Rng rng(3);
  for (const Format& f : formats()) {
    const Data whole = encoded(f.extension, test_image(), f.parameters);
    for (int round = 0; round < 150; ++round) {
      Data bytes = whole;
      for (int i = rng.integer(1, 6); i > 0; --i) {
        bytes[static_cast<std::size_t>(
            rng.integer(0, static_cast<int>(std::min<std::size_t>(bytes.size(), 700)) - 1))] =
            static_cast<std::uint8_t>(rng.integer(0, 255));
      }
      ImageLimits limits;
      limits.max_pixels = 100'000;
      try {
        const cv::Mat image = decode_image(bytes, "x", limits);
        EXPECT_EQ(image.type(), CV_8UC3);
        EXPECT_LE(image.total(), 100'000U);
      } catch (const InputError&) {
      }
    }
  }
}

TEST(ImageFile, IgnoresBytesAfterJpegEnd) {
  Data bytes = encoded(".jpg", test_image());
  bytes.insert(bytes.end(), 100, 0);
  EXPECT_EQ(refusal(bytes), "accepted");
}

TEST(ImageFile, ErrorsShowHowOtherFilesStart) {
  const std::string text = "hello, I am a text file";
  EXPECT_THAT(refusal(Data(text.begin(), text.end())),
              HasSubstr("not an image: starts with \"hello, I am "));
  EXPECT_THAT(refusal({}), HasSubstr("empty file"));
  EXPECT_THAT(refusal({0xFF}), HasSubstr("not an image"));
  EXPECT_THAT(refusal({0x1B, '[', '2', 'J'}), HasSubstr("\\x1b"))
      << "no escape sequence reaches the terminal";
  const std::string gif = "GIF89a.......";
  EXPECT_THAT(refusal(Data(gif.begin(), gif.end())), HasSubstr("is a GIF"));
  const Data tiff = encoded(".tiff", test_image());
  ASSERT_FALSE(tiff.empty());
  EXPECT_THAT(refusal(tiff), HasSubstr("TIFF"));
  ImageLimits limits;
  limits.allow_tiff = true;
  EXPECT_EQ(refusal(tiff, limits), "accepted");
}

TEST(ImageFile, HugeSizesAreRefusedBeforeDecoding) {
  EXPECT_THAT(refusal(png_of_claimed_size(60000, 60000)), HasSubstr("60000x60000"));
  EXPECT_THAT(refusal(png_of_claimed_size(0xFFFFFFFFU, 0xFFFFFFFFU)), HasSubstr("limit"));
  EXPECT_THAT(refusal(png_of_claimed_size(0, 10)), HasSubstr("0x10"));
  Data bmp = encoded(".bmp", test_image());
  put_little(bmp, 18, 60000);
  put_little(bmp, 22, 60000);
  EXPECT_THAT(refusal(bmp), HasSubstr("60000x60000"));
  put_little(bmp, 22, 0x80000000U);  // the only height without an absolute value
  EXPECT_THAT(refusal(bmp), HasSubstr("limit"));
  put_little(bmp, 18, 0xFFFFFFFFU);
  EXPECT_NE(refusal(bmp), "accepted");
  const std::string ppm = "P6\n# big\n60000 60000\n255\n";
  EXPECT_THAT(refusal(Data(ppm.begin(), ppm.end())), HasSubstr("60000x60000"));
  const std::string overflow = "P6 99999999999999999999 9999999999999999999999 255\n";
  EXPECT_THAT(refusal(Data(overflow.begin(), overflow.end())), HasSubstr("limit"));
  ImageLimits limits;
  limits.max_pixels = 64 * 48 - 1;
  EXPECT_THAT(refusal(encoded(".png", test_image()), limits), HasSubstr("limit"));
  limits = {};
  limits.max_bytes = 10;
  EXPECT_THAT(refusal(encoded(".png", test_image()), limits), HasSubstr("bytes"));
}

// OpenCV's DICOM reader ends the process for such a file, so the file must not reach it.
TEST(ImageFile, RejectsImagesThatAreAlsoDicom) {
  Data bytes = encoded(".webp", test_image(), {cv::IMWRITE_WEBP_QUALITY, 101});
  bytes.resize(std::max<std::size_t>(bytes.size(), 200));
  constexpr std::string_view kMark = "DICM";
  std::copy(kMark.begin(), kMark.end(), bytes.begin() + 128);
  EXPECT_THAT(refusal(bytes), HasSubstr("DICOM"));
  bytes[24] |= 0x20;  // a version that libwebp does not know
  EXPECT_THAT(refusal(bytes), HasSubstr("WebP"));
  std::string pnm = "P6#" + std::string(125, 'x') + "DICM\n1 1\n255\nabc";
  EXPECT_THAT(refusal(Data(pnm.begin(), pnm.end())), HasSubstr("DICOM"));
}

TEST(ImageFile, RejectsPngWithMissingRows) {
  EXPECT_THAT(refusal(png_of_claimed_size(64, 4000)), HasSubstr("broken PNG"));
}

TEST(ImageFile, ReportsWrongPngChecksum) {
  Data bytes = encoded(".png", test_image());
  bytes[bytes.size() / 2] ^= 1;
  EXPECT_THAT(refusal(bytes), HasSubstr("checksum"));
}

TEST(ImageFile, TextAndProfilesInAPngAreIgnored) {
  Data bytes = encoded(".png", test_image());
  // A text chunk that is marked as compressed but is not: libpng would write to stderr.
  Data chunk{0, 0, 0, 5, 'z', 'T', 'X', 't', 'a', 0, 0, 9, 9, 0, 0, 0, 0};
  put_big(chunk, 13, crc(&chunk[4], 9));
  bytes.insert(bytes.begin() + 33, chunk.begin(), chunk.end());
  testing::internal::CaptureStderr();
  EXPECT_EQ(refusal(bytes), "accepted");
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

TEST(ImageFile, RejectsJpegWithThousandsOfScans) {
  const Data whole = encoded(".jpg", test_image(), {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  // Repeats the last scan many times before the end marker.
  std::size_t at = whole.size() - 3;
  while (!(whole[at] == 0xFF && whole[at + 1] == 0xDA)) --at;
  const Data scan(whole.begin() + static_cast<std::ptrdiff_t>(at), whole.end() - 2);
  Data bomb(whole.begin(), whole.end() - 2);
  for (int i = 0; i < 600; ++i) bomb.insert(bomb.end(), scan.begin(), scan.end());
  bomb.insert(bomb.end(), {0xFF, 0xD9});
  EXPECT_THAT(refusal(bomb), HasSubstr("scans"));
}

TEST(ImageFile, ConvertsToEightBitBgr) {
  cv::Mat deep;
  test_image().convertTo(deep, CV_16U, 257);
  EXPECT_LE(cv::norm(decode_image(encoded(".png", deep), "x"), test_image(), cv::NORM_INF), 1);
  cv::Mat alpha;
  cv::cvtColor(test_image(), alpha, cv::COLOR_BGR2BGRA);
  EXPECT_EQ(decode_image(encoded(".png", alpha), "x").type(), CV_8UC3);
  cv::Mat gray;
  cv::cvtColor(test_image(), gray, cv::COLOR_BGR2GRAY);
  for (const char* extension : {".png", ".jpg", ".pgm", ".bmp"}) {
    const cv::Mat image = decode_image(encoded(extension, gray), "x");
    ASSERT_EQ(image.type(), CV_8UC3);
    EXPECT_NEAR(cv::mean(image)[0], cv::mean(gray)[0], 1) << extension;
    EXPECT_NEAR(cv::mean(image)[2], cv::mean(gray)[0], 1) << extension;
  }
  const Data bilevel = encoded(".png", gray > 100, {cv::IMWRITE_PNG_BILEVEL, 1});
  EXPECT_EQ(decode_image(bilevel, "x").type(), CV_8UC3);
}

TEST(ImageFile, ReadsAsciiAndBitmapPnmWithComments) {
  const std::string text = "P3 # a comment\n2 #another\n1\n255\n255 0 0  0 0 255\n";
  const cv::Mat image = decode_image(Data(text.begin(), text.end()), "x");
  ASSERT_EQ(image.size(), cv::Size(2, 1));
  EXPECT_EQ(image.at<cv::Vec3b>(0, 0), cv::Vec3b(0, 0, 255));
  const std::string bits("P4\n8 2\n\xF0\x0F", 9);
  EXPECT_EQ(decode_image(Data(bits.begin(), bits.end()), "x").size(), cv::Size(8, 2));
}

TEST(ImageFile, ScalesBinaryPnmOfAnyMaximum) {
  const std::string low("P5\n4 1\n15\n\x00\x05\x0F\x20", 15);
  const cv::Mat of_low = decode_image(Data(low.begin(), low.end()), "x");
  EXPECT_EQ(of_low.at<cv::Vec3b>(0, 0), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(of_low.at<cv::Vec3b>(0, 1), cv::Vec3b(85, 85, 85));
  EXPECT_EQ(of_low.at<cv::Vec3b>(0, 2), cv::Vec3b(255, 255, 255));
  EXPECT_EQ(of_low.at<cv::Vec3b>(0, 3), cv::Vec3b(255, 255, 255)) << "above the maximum";
  const std::string high("P6\n1 1\n4095\n\x0F\xFF\x08\x00\x00\x00", 18);
  EXPECT_EQ(decode_image(Data(high.begin(), high.end()), "x").at<cv::Vec3b>(0, 0),
            cv::Vec3b(0, 128, 255));
}

TEST(ImageFile, ReadsTopDownBmp) {
  Data bytes = encoded(".bmp", test_image());
  put_little(bytes, 22, static_cast<std::uint32_t>(-48));
  const auto header = probe_image(bytes);
  ASSERT_TRUE(header);
  EXPECT_EQ(header->height, 48);
  cv::Mat flipped;
  cv::flip(test_image(), flipped, 0);
  EXPECT_EQ(cv::norm(decode_image(bytes, "x"), flipped, cv::NORM_INF), 0);
}

TEST(ImageFile, ExifRotationIsApplied) {
  Data bytes = encoded(".jpg", test_image());
  // Orientation 6: rotate by 90 degrees clockwise to display.
  const Data exif{0xFF, 0xE1, 0,    34,   'E', 'x', 'i', 'f', 0, 0, 'I', 'I', 42, 0, 8, 0, 0, 0,
                  1,    0,    0x12, 0x01, 3,   0,   1,   0,   0, 0, 6,   0,   0,  0, 0, 0, 0, 0};
  bytes.insert(bytes.begin() + 2, exif.begin(), exif.end());
  const auto header = probe_image(bytes);
  ASSERT_TRUE(header);
  EXPECT_EQ(header->width, 64);
  EXPECT_EQ(decode_image(bytes, "x").size(), cv::Size(48, 64));
}

TEST(ImageFile, ErrorsDistinguishFilesFoldersAndMissingOnes) {
  const TemporaryFolder folder;
  const auto reason = [](const std::string& path) -> std::string {
    try {
      (void)read_image(path);
    } catch (const InputError& error) {
      return error.what();
    }
    return "read";
  };
  EXPECT_EQ(reason(folder / "none.png"), folder / "none.png" + ": no such file");
  EXPECT_THAT(reason(folder / "."), HasSubstr("is a folder"));
  std::ofstream(folder / "empty.png").flush();
  EXPECT_THAT(reason(folder / "empty.png"), HasSubstr("empty file"));
  write_image(folder / "good.png", test_image());
  EXPECT_EQ(reason(folder / "good.png"), "read");
  EXPECT_EQ(read_gray_image(folder / "good.png").type(), CV_8UC1);
  std::ofstream(folder / "big") << std::string(100, 'x');
  EXPECT_EQ(read_file(folder / "big", 100).size(), 100U);
  EXPECT_THROW((void)read_file(folder / "big", 99), InputError);
  EXPECT_EQ(read_start(folder / "big", 99), read_file(folder / "big", 100).substr(0, 99));
  EXPECT_EQ(read_start(folder / "big", 1000).size(), 100U);
  EXPECT_EQ(read_start("/dev/zero", 1000).size(), 1000U);
  EXPECT_THROW((void)read_start(folder / "none", 99), InputError);
  EXPECT_THROW((void)read_file("/dev/zero", 100'000), InputError);
  EXPECT_EQ(read_file("/dev/null", 100), "");
}

TEST(ImageFile, WritesByExtensionAndLeavesNoFileOnFailure) {
  const TemporaryFolder folder;
  for (const char* name : {"a.png", "b.JPG", "c.jpeg", "d.webp", "e.bmp", "f.ppm", "g.pgm"}) {
    EXPECT_TRUE(is_image_path(name));
    write_image(folder / name, test_image());
    EXPECT_EQ(read_image(folder / name).size(), cv::Size(64, 48)) << name;
  }
  EXPECT_FALSE(is_image_path("x.gif"));
  EXPECT_FALSE(is_image_path("png"));
  EXPECT_THROW(write_image(folder / "x.gif", test_image()), UsageError);
  EXPECT_THROW(write_image(folder / "no/such/x.png", test_image()), OutputError);
  EXPECT_THROW(write_image(folder / "x.png", cv::Mat()), std::invalid_argument);
  EXPECT_THROW(write_image(folder / "x.jpg", test_image(), 0), std::invalid_argument);
  EXPECT_THROW(write_image(folder / "wide.webp", cv::Mat(1, 20000, CV_8UC3, cv::Scalar())),
               OutputError);
  EXPECT_FALSE(std::filesystem::exists(folder / "wide.webp"));
  write_image(folder / "gray.ppm", cv::Mat(4, 5, CV_8UC1, cv::Scalar(9)));
  EXPECT_EQ(read_image(folder / "gray.ppm").size(), cv::Size(5, 4));
}

}  // namespace
}  // namespace tarsier
