// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/normalize.h"

#include "tarsier/face/recognition/lbp.h"
#include "tarsier/face/recognition/testing_faces.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::face::recognition {
namespace {

double cosine(const std::vector<float>& a, const std::vector<float>& b) {
  double ab = 0;
  double aa = 0;
  double bb = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ab += static_cast<double>(a[i]) * b[i];
    aa += static_cast<double>(a[i]) * a[i];
    bb += static_cast<double>(b[i]) * b[i];
  }
  return ab / std::sqrt(aa * bb);
}

// A face with few dark pixels, and the same face in light that falls off to one side.
cv::Mat even_face() { return synthetic_faces(1, 1, 0, 1).faces.front(); }
cv::Mat with_light_gradient(const cv::Mat& face) {
  cv::Mat out = face.clone();
  for (int y = 0; y < face.rows; ++y)
    for (int x = 0; x < face.cols; ++x)
      out.at<unsigned char>(y, x) =
          cv::saturate_cast<unsigned char>(face.at<unsigned char>(y, x) * std::exp(-0.02 * x));
  return out;
}

double correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Scalar ma;
  cv::Scalar mb;
  cv::Scalar sa;
  cv::Scalar sb;
  cv::meanStdDev(a, ma, sa);
  cv::meanStdDev(b, mb, sb);
  return (a - ma[0]).dot(b - mb[0]) / (static_cast<double>(a.total()) * sa[0] * sb[0]);
}

TEST(Light, NormalisationRemovesALightGradient) {
  const cv::Mat face = even_face();
  const cv::Mat dark = with_light_gradient(face);
  const double plain =
      correlation(normalize_light(face, Light::kNone), normalize_light(dark, Light::kNone));
  EXPECT_LT(plain, 0.7);
  for (const auto light : {Light::kTanTriggs, Light::kSelfQuotient})
    EXPECT_GT(correlation(normalize_light(face, light), normalize_light(dark, light)), 0.9)
        << name_of(light);
}

TEST(Light, LogOfAKnownValue) {
  const cv::Mat log = normalize_light(cv::Mat(8, 8, CV_8UC1, cv::Scalar(96)), Light::kLog);
  EXPECT_NEAR(log.at<float>(3, 3), std::log(100.0), 1e-5);
}

TEST(Light, FlatImagesGiveNoNaN) {
  for (const auto light :
       {Light::kNone, Light::kEqualize, Light::kLog, Light::kTanTriggs, Light::kSelfQuotient}) {
    for (const int level : {0, 128, 255}) {
      const cv::Mat out = normalize_light(cv::Mat(80, 64, CV_8UC1, cv::Scalar(level)), light);
      EXPECT_TRUE(cv::checkRange(out)) << name_of(light) << level;
      EXPECT_EQ(light_image(out).type(), CV_8UC1);
    }
  }
  const auto values = describe(cv::Mat(80, 64, CV_8UC1, cv::Scalar(7)), {});
  for (const float value : values) EXPECT_EQ(value, 0.0F);
}

TEST(Light, ParsesItsNames) {
  for (const auto light :
       {Light::kNone, Light::kEqualize, Light::kLog, Light::kTanTriggs, Light::kSelfQuotient})
    EXPECT_EQ(parse_light(name_of(light)), light);
  EXPECT_THROW((void)parse_light("sun"), std::invalid_argument);
}

TEST(Descriptor, HasUnitLengthAndItsStatedSize) {
  DescriptorOptions options;
  for (const bool symmetric : {false, true}) {
    options.symmetric = symmetric;
    const auto values = describe(even_face(), options);
    EXPECT_EQ(static_cast<int>(values.size()), descriptor_length(options));
    EXPECT_NEAR(cosine(values, values), 1, 1e-6);
    double square = 0;
    for (const float value : values) square += static_cast<double>(value) * value;
    EXPECT_NEAR(square, 1, 1e-5);
  }
}

TEST(Descriptor, SymmetricDescriptorIgnoresMirroring) {
  cv::Mat mirrored;
  cv::flip(even_face(), mirrored, 1);
  DescriptorOptions options;
  EXPECT_GT(cosine(describe(even_face(), options), describe(mirrored, options)), 1 - 1e-5);
  options.symmetric = false;
  EXPECT_LT(cosine(describe(even_face(), options), describe(mirrored, options)), 0.95);
}

TEST(Descriptor, VariesLessWithLightThanWithPerson) {
  const DescriptorOptions options;
  const auto own = describe(even_face(), options);
  const auto dark = describe(with_light_gradient(even_face()), options);
  const auto other = describe(synthetic_faces(1, 1, 0, 1, 5).faces.front(), options);
  EXPECT_GT(cosine(own, dark), cosine(own, other) + 0.1);
}

TEST(TransformedFace, ShiftsAndRotatesClockwise) {
  cv::Mat face(41, 41, CV_8UC1, cv::Scalar(0));
  face.at<unsigned char>(20, 30) = 255;  // right of the middle
  EXPECT_EQ(transformed_face(face, 2, 3, 0, 1).at<unsigned char>(23, 32), 255);
  EXPECT_GT(transformed_face(face, 0, 0, 90, 1).at<unsigned char>(30, 20), 200);  // now below it
}

TEST(Lbp, PatternOfAGradient) {
  // The grey level grows to the right. The neighbours at the right, above and below are not darker.
  cv::Mat face(12, 12, CV_8UC1);
  for (int y = 0; y < 12; ++y)
    for (int x = 0; x < 12; ++x) face.at<unsigned char>(y, x) = static_cast<unsigned char>(20 * x);
  LbpOptions options;
  options.grid = 2;
  const auto histograms = lbp_histograms(face, options);
  ASSERT_EQ(histograms.size(), 4U * 256U);
  // Bits 0 (right), 1 (right above), 2 (above, equal), 6 (below, equal) and 7 (right below).
  for (std::size_t cell = 0; cell < 4; ++cell)
    EXPECT_NEAR(histograms[cell * 256 + 0b11000111], 1, 1e-5);
}

TEST(Lbp, IsInvariantToGain) {
  const cv::Mat face = even_face();
  cv::Mat dark = face / 2;
  cv::Mat lighter = dark * 2;
  const LbpOptions options;
  EXPECT_LT(chi_square(lbp_histograms(dark, options), lbp_histograms(lighter, options)), 1e-6);
  EXPECT_THROW((void)lbp_histograms(cv::Mat::zeros(9, 9, CV_8UC1), options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::recognition
