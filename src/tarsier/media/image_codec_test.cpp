// SPDX-License-Identifier: MIT
#include "tarsier/media/image_codec.h"

#include "tarsier/core/rng.h"
#include "tarsier/media/image_file.h"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <array>
#include <string>

namespace tarsier {
namespace {

using Data = std::vector<std::uint8_t>;

// Noise over a ramp, of odd size: covers every code path of the predictors and of the halved
// chroma.
cv::Mat noisy(int type, int width = 61, int height = 47) {
  cv::Mat image(height, width, type);
  Rng rng(5);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width * image.channels(); ++x)
      image.ptr(y)[x] = static_cast<std::uint8_t>(2 * x / image.channels() + rng.integer(0, 99));
  }
  return image;
}

Data by_opencv(const std::string& extension, const cv::Mat& image,
               const std::vector<int>& parameters = {}) {
  Data bytes;
  cv::imencode(extension, image, bytes, parameters);
  return bytes;
}

cv::Mat decoded(const Data& bytes, bool gray) {
  const auto header = probe_image(bytes);
  return header ? decode_plain(bytes, *header, gray) : cv::Mat();
}

// Equal to the result of the OpenCV version that this code follows. Other versions may round the
// weights for grey differently: within one grey level.
constexpr bool kIsExact = CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR == 6;

bool same(const cv::Mat& one, const cv::Mat& other) {
  return one.size() == other.size() && one.type() == other.type() &&
         cv::norm(one, other, cv::NORM_INF) <= (kIsExact ? 0 : 1);
}

TEST(ImageCodec, DecodingMatchesOpenCv) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    const cv::Mat image = noisy(type);
    const std::array<Data, 6> files{
        by_opencv(".png", image),
        by_opencv(".png", image, {cv::IMWRITE_PNG_COMPRESSION, 9}),
        by_opencv(".jpg", image),
        by_opencv(".jpg", image, {cv::IMWRITE_JPEG_QUALITY, 20, cv::IMWRITE_JPEG_OPTIMIZE, 1}),
        by_opencv(".jpg", image, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}),
        by_opencv(".jpg", image, {cv::IMWRITE_JPEG_RST_INTERVAL, 2})};
    for (std::size_t k = 0; k < files.size(); ++k) {
      EXPECT_TRUE(same(decoded(files[k], false), cv::imdecode(files[k], cv::IMREAD_COLOR)))
          << type << " " << k;
      EXPECT_TRUE(same(decoded(files[k], true), cv::imdecode(files[k], cv::IMREAD_GRAYSCALE)))
          << type << " " << k;
    }
  }
}

void expect_same_file(const std::string& extension, const cv::Mat& image, int quality) {
  const Data from_tarsier = encode_plain(extension, image, quality);
  std::vector<int> parameters;
  if (extension == ".jpg") parameters = {cv::IMWRITE_JPEG_QUALITY, quality};
  const Data from_opencv = by_opencv(extension, image, parameters);
  if (kIsExact) {
    EXPECT_EQ(from_tarsier, from_opencv)
        << extension << " " << image.type() << " quality " << quality;
  }
  const cv::Mat back = cv::imdecode(from_tarsier, cv::IMREAD_UNCHANGED);
  EXPECT_TRUE(same(back, cv::imdecode(from_opencv, cv::IMREAD_UNCHANGED)))
      << extension << " " << quality;
  if (extension == ".png") {
    EXPECT_EQ(cv::norm(back, image, cv::NORM_INF), 0);
  }
}

TEST(ImageCodec, EncodingMatchesOpenCv) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    const cv::Mat whole = noisy(type);
    const cv::Mat part = whole(cv::Rect(3, 5, 40, 30));  // rows are not contiguous
    for (const cv::Mat& image : {whole, part}) {
      expect_same_file(".png", image, 95);
      for (const int quality : {1, 50, 95, 100}) expect_same_file(".jpg", image, quality);
      EXPECT_EQ(encode_plain(".jpeg", image, 80), encode_plain(".jpg", image, 80));
    }
  }
}

TEST(ImageCodec, LeavesOtherFormatsToOpenCv) {
  const cv::Mat color = noisy(CV_8UC3);
  cv::Mat alpha;
  cv::cvtColor(color, alpha, cv::COLOR_BGR2BGRA);
  cv::Mat gray;
  cv::extractChannel(color, gray, 0);
  cv::Mat deep;
  color.convertTo(deep, CV_16U, 200);
  for (const Data& bytes :
       {by_opencv(".png", alpha), by_opencv(".png", deep), by_opencv(".webp", color),
        by_opencv(".bmp", color), by_opencv(".png", gray > 128, {cv::IMWRITE_PNG_BILEVEL, 1})}) {
    EXPECT_TRUE(decoded(bytes, false).empty());
    EXPECT_FALSE(decode_image(bytes, "x").empty());
  }
  EXPECT_TRUE(encode_plain(".png", alpha, 95).empty());
  EXPECT_TRUE(encode_plain(".png", deep, 95).empty());
  EXPECT_TRUE(encode_plain(".webp", color, 95).empty());
  EXPECT_EQ(encode_image(".png", deep, "x"), by_opencv(".png", deep));
}

// EXIF after the start of the image, orientation 6: rotated by 90 degrees.
TEST(ImageCodec, DeclinesRotatedImages) {
  Data bytes = by_opencv(".jpg", noisy(CV_8UC3));
  const Data exif{0xFF, 0xE1, 0, 34, 'E', 'x', 'i', 'f', 0, 0,  // APP1
                  'M',  'M',  0, 42, 0,   0,   0,   8,          // TIFF, big-endian
                  0,    1,    1, 18, 0,   3,   0,   0,   0, 1, 0, 6, 0, 0, 0, 0, 0, 0};
  bytes.insert(bytes.begin() + 2, exif.begin(), exif.end());
  EXPECT_TRUE(decoded(bytes, false).empty());
  EXPECT_EQ(decode_image(bytes, "x").size(), cv::Size(47, 61));
}

// Many cameras send JPEGs like this one. They must not be decoded twice.
TEST(ImageCodec, AcceptsAJpegWithTrailingBytes) {
  Data bytes = by_opencv(".jpg", noisy(CV_8UC3));
  const cv::Mat plain = decoded(bytes, false);
  bytes.insert(bytes.end() - 2, 6, 0x55);
  const cv::Mat image = decoded(bytes, false);
  ASSERT_FALSE(image.empty());
  EXPECT_EQ(cv::norm(image, plain, cv::NORM_INF), 0);
  EXPECT_TRUE(same(image, cv::imdecode(bytes, cv::IMREAD_COLOR)));
}

TEST(ImageCodec, BrokenPixelsAreRefused) {
  for (const char* extension : {".jpg", ".png"}) {
    const Data whole = by_opencv(extension, noisy(CV_8UC3));
    const auto header = probe_image(whole);
    for (std::size_t size = 40; size + 64 < whole.size(); size += 97) {
      const Data cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
      EXPECT_TRUE(decode_plain(cut, *header, false).empty()) << extension << " cut to " << size;
    }
    ImageHeader other = *header;
    other.width += 1;
    EXPECT_TRUE(decode_plain(whole, other, false).empty()) << "the size of another image";
  }
}

}  // namespace
}  // namespace tarsier
