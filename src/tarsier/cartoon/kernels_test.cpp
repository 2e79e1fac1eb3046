// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/kernels.h"

#include "tarsier/cartoon/bilateral.h"
#include "tarsier/cartoon/enlarge.h"
#include "tarsier/cartoon/plane.h"
#include "tarsier/core/cpu.h"
#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cstring>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

namespace tarsier::cartoon {
namespace {

// Flat areas, edges and noise. They give ties and extremes for medians, and all distances for the
// bilateral weights.
cv::Mat test_image(cv::Size size, int channels, std::uint64_t seed) {
  Rng rng(seed);
  cv::Mat image(size, CV_8UC(channels));
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width * channels; ++x) {
      const int area = ((x / channels / 7 + y / 5) % 3) * 90;
      image.ptr(y)[x] =
          cv::saturate_cast<std::uint8_t>(area + rng.normal(20, x % 11 == 0 ? 90 : 8));
    }
  }
  return image;
}

const Kernels* kernels_of(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512:
      return avx512_kernels();
    case SimdLevel::kAvx2:
      return avx2_kernels();
    case SimdLevel::kSse41:
      return sse41_kernels();
    case SimdLevel::kDotProducts:
    case SimdLevel::kBaseline:
      return baseline_kernels();
  }
  return nullptr;
}

Plane plane_of(const cv::Mat& image) {
  Plane plane;
  plane.resize(image.cols, image.rows);
  image.copyTo(plane.view());
  return plane;
}

// Tests every instruction set on sizes that are no multiple of any vector.
class KernelTest : public testing::TestWithParam<std::tuple<SimdLevel, std::pair<int, int>>> {
 protected:
  void SetUp() override {
    kernels_ = kernels_of(std::get<0>(GetParam()));
    if (kernels_ == nullptr || std::get<0>(GetParam()) > hardware_simd_level()) {
      GTEST_SKIP() << "this processor has no " << name_of(std::get<0>(GetParam()));
    }
    const auto [width, height] = std::get<1>(GetParam());
    image_ = test_image({width, height}, 1, 7);
    input_ = plane_of(image_);
    output_.resize(width, height);
  }

  // Runs row(y, rows above and below up to `reach`) with the margin mirrored or copied.
  template <int kRows, typename Row>
  void run(bool copies, const Row& row) {
    constexpr int kReach = kRows / 2;
    for (int y = 0; y < image_.rows; ++y) {
      copies ? input_.extend_row_by_copies(y, kReach) : input_.extend_row_by_reflection(y, kReach);
    }
    copies ? input_.extend_height_by_copies(kReach) : input_.extend_height_by_reflection(kReach);
    for (int y = 0; y < image_.rows; ++y) {
      const std::uint8_t* rows[kRows];
      for (int i = 0; i < kRows; ++i) rows[i] = input_.row(y - kReach + i);
      row(rows, output_.row(y));
    }
  }

  void expect_output(const cv::Mat& expected) {
    EXPECT_EQ(cv::norm(output_.view(), expected, cv::NORM_INF), 0);
  }

  const Kernels* kernels_ = nullptr;
  cv::Mat image_;
  Plane input_;
  Plane output_;
};

INSTANTIATE_TEST_SUITE_P(All, KernelTest,
                         testing::Combine(testing::Values(SimdLevel::kBaseline, SimdLevel::kSse41,
                                                          SimdLevel::kAvx2, SimdLevel::kAvx512),
                                          testing::Values(std::pair(16, 16), std::pair(65, 17),
                                                          std::pair(199, 31))));

TEST_P(KernelTest, Median7IsExact) {
  std::vector<std::uint8_t> scratch(static_cast<size_t>(7 * input_.stride()));
  run<7>(true, [&](const std::uint8_t* const* rows, std::uint8_t* out) {
    kernels_->median7_row(rows, out, image_.cols, scratch.data(), input_.stride());
  });
  cv::Mat expected;
  cv::medianBlur(image_, expected, 7);
  expect_output(expected);
}

TEST_P(KernelTest, Median3IsExact) {
  run<3>(true, [&](const std::uint8_t* const* rows, std::uint8_t* out) {
    kernels_->median3_row(rows, out, image_.cols);
  });
  cv::Mat expected;
  cv::medianBlur(image_, expected, 3);
  expect_output(expected);
}

TEST_P(KernelTest, LaplacianIsExact) {
  run<5>(false, [&](const std::uint8_t* const* rows, std::uint8_t* out) {
    kernels_->laplacian5_row(rows, out, image_.cols);
  });
  cv::Mat expected;
  cv::Laplacian(image_, expected, CV_8U, 5);
  expect_output(expected);
}

TEST_P(KernelTest, ScharrIsTheSumOfBothDirections) {
  for (const bool both_axes : {false, true}) {
    run<3>(false, [&](const std::uint8_t* const* rows, std::uint8_t* out) {
      kernels_->scharr_row(rows, out, image_.cols, both_axes);
    });
    cv::Mat expected;
    cv::Scharr(image_, expected, CV_8U, 1, 0);
    for (const auto& [dx, dy, scale] :
         {std::tuple(1, 0, -1.0), std::tuple(0, 1, 1.0), std::tuple(0, 1, -1.0)}) {
      if (dy == 1 && !both_axes) continue;
      cv::Mat part;
      cv::Scharr(image_, part, CV_8U, dx, dy, scale);
      expected += part;
    }
    expect_output(expected);
  }
}

TEST_P(KernelTest, ThresholdCountsEqualAsBelow) {
  for (const int threshold : {0, 80, 254, 255}) {
    for (int y = 0; y < image_.rows; ++y) {
      kernels_->threshold_inverse_row(input_.row(y), output_.row(y), image_.cols, threshold);
    }
    cv::Mat expected;
    cv::threshold(image_, expected, threshold, 255, cv::THRESH_BINARY_INV);
    expect_output(expected);
  }
}

// Pixels of three bytes at any width. Nothing may be written behind the row.
TEST_P(KernelTest, PixelsAreSplitAndJoined) {
  const cv::Mat image = test_image(image_.size(), 3, 11);
  const int width = image.cols;
  std::vector<Plane> planes(3);
  for (Plane& plane : planes) plane.resize(width, 1);
  for (int y = 0; y < image.rows; ++y) {
    std::uint8_t* const rows[3] = {planes[0].row(0), planes[1].row(0), planes[2].row(0)};
    kernels_->split_row(image.ptr(y), rows, width);
    for (int x = 0; x < width; ++x) {
      for (int c = 0; c < 3; ++c) ASSERT_EQ(rows[c][x], image.at<cv::Vec3b>(y, x)[c] ^ 128U);
    }
    std::vector<std::uint8_t> joined(static_cast<size_t>(3 * width + 1), 77);
    kernels_->join_row(rows, joined.data(), width);
    EXPECT_EQ(std::memcmp(joined.data(), image.ptr(y), static_cast<size_t>(3 * width)), 0);
    EXPECT_EQ(joined.back(), 77) << "written behind the row";
  }
}

TEST_P(KernelTest, BlendMatchesFormula) {
  const cv::Mat sharp = test_image(image_.size(), 3, 12);
  const cv::Mat soft = test_image(image_.size(), 3, 13);
  const int width = image_.cols;
  std::vector<std::uint8_t> weight(static_cast<size_t>(width));
  std::vector<std::uint8_t> out(static_cast<size_t>(3 * width + 1), 77);
  for (int y = 0; y < image_.rows; ++y) {
    // Weights of 0 for some groups of pixels, 255 for some pixels, and other weights between.
    for (int x = 0; x < width; ++x) {
      weight[static_cast<size_t>(x)] = x / 20 % 3 == 0 ? 0
                                       : x % 5 == 0    ? 255
                                                       : image_.at<std::uint8_t>(y, x);
    }
    kernels_->blend_row(sharp.ptr(y), soft.ptr(y), weight.data(), out.data(), width);
    for (int i = 0; i < 3 * width; ++i) {
      const int from = sharp.ptr(y)[i];
      const int expected =
          from + ((soft.ptr(y)[i] - from) * weight[static_cast<size_t>(i / 3)] + 127) / 255;
      ASSERT_EQ(out[static_cast<size_t>(i)], expected) << i;
    }
    EXPECT_EQ(out.back(), 77) << "written behind the row";
  }
}

TEST_P(KernelTest, EnlargedRowsMatchOpenCv) {
  const cv::Mat small = test_image(image_.size(), 3, 14);
  cv::Mat expected;
  cv::resize(small, expected, {2 * small.cols, 2 * small.rows}, 0, 0, cv::INTER_LINEAR);
  const int width = small.cols;
  std::vector<Plane> planes(3);
  for (Plane& plane : planes) plane.resize(width, small.rows);
  for (int y = 0; y < small.rows; ++y) {
    std::uint8_t* const rows[3] = {planes[0].row(y), planes[1].row(y), planes[2].row(y)};
    kernels_->split_row(small.ptr(y), rows, width);
    for (Plane& plane : planes) plane.extend_row_by_copies(y, 1);
  }
  for (Plane& plane : planes) plane.extend_height_by_copies(1);
  Plane mask;
  mask.resize(2 * width, 1);
  for (int x = 0; x < 2 * width; ++x) mask.row(0)[x] = x % 7 == 3 ? 0 : 255;
  std::vector<std::uint8_t> out(static_cast<size_t>(6 * width + 1), 77);
  for (int y = 0; y < 2 * small.rows; ++y) {
    const int near_y = y / 2;
    const int far_y = y % 2 == 0 ? near_y - 1 : near_y + 1;
    const std::uint8_t* near[3];
    const std::uint8_t* far[3];
    for (size_t c = 0; c < 3; ++c) {
      near[c] = planes[c].row(near_y);
      far[c] = planes[c].row(far_y);
    }
    kernels_->enlarge_row(near, far, nullptr, out.data(), width);
    EXPECT_EQ(std::memcmp(out.data(), expected.ptr(y), static_cast<size_t>(6 * width)), 0) << y;
    kernels_->enlarge_row(near, far, mask.row(0), out.data(), width);
    for (int i = 0; i < 6 * width; ++i) {
      ASSERT_EQ(out[static_cast<size_t>(i)], i / 3 % 7 == 3 ? 0 : expected.ptr(y)[i]) << y;
    }
    EXPECT_EQ(out.back(), 77) << "written behind the row";
  }
}

TEST_P(KernelTest, EnlargedPlanesMatchOpenCv) {
  cv::Mat expected;
  cv::resize(image_, expected, {2 * image_.cols, 2 * image_.rows}, 0, 0, cv::INTER_LINEAR);
  for (int y = 0; y < image_.rows; ++y) input_.extend_row_by_copies(y, 1);
  input_.extend_height_by_copies(1);
  std::vector<std::uint8_t> out(static_cast<size_t>(2 * (image_.cols + kRowSlack)));
  for (int y = 0; y < expected.rows; ++y) {
    kernels_->enlarge_plane_row(input_.row(y / 2), input_.row(y % 2 == 0 ? y / 2 - 1 : y / 2 + 1),
                                out.data(), image_.cols);
    EXPECT_EQ(std::memcmp(out.data(), expected.ptr(y), static_cast<size_t>(expected.cols)), 0) << y;
  }
}

TEST(Enlarger, MatchesOpenCvResizeWithLines) {
  for (const cv::Size size : {cv::Size(130, 66), cv::Size(131, 67), cv::Size(16, 16)}) {
    const cv::Mat small = test_image({size.width / 2, size.height / 2}, 3, 15);
    cv::Mat expected;
    cv::resize(small, expected, size, 0, 0, cv::INTER_LINEAR);
    Enlarger enlarger;
    cv::Mat large(size, CV_8UC3);
    enlarger.enlarge(small, nullptr, large);
    EXPECT_EQ(cv::norm(large, expected, cv::NORM_INF), 0) << size;
    Plane mask = plane_of(test_image(size, 1, 16) > 128);
    expected.setTo(cv::Scalar::all(0), mask.view() == 0);
    enlarger.enlarge(small, &mask, large);
    EXPECT_EQ(cv::norm(large, expected, cv::NORM_INF), 0) << size;
  }
}

// Diameter 9 has its own kernel on some processors. It works in strips of 512 pixels, and the
// tables of the larger sigma do not fit into it.
TEST(BilateralPainter, AllInstructionSetsGiveTheSameBytes) {
  for (const auto& [size, options] :
       {std::pair(cv::Size(131, 37), PaintOptions{}), std::pair(cv::Size(16, 16), PaintOptions{}),
        std::pair(cv::Size(1100, 9), PaintOptions{}),
        std::pair(cv::Size(513, 5), PaintOptions{.sigma_space = 2}),
        std::pair(cv::Size(131, 37), PaintOptions{.sigma_color = 9.6}),
        std::pair(cv::Size(131, 37), PaintOptions{.diameter = 7})}) {
    const cv::Mat image = test_image(size, 3, 3);
    cv::Mat first;
    for (const SimdLevel level :
         {SimdLevel::kBaseline, SimdLevel::kSse41, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
      if (level > hardware_simd_level()) continue;
      // Passes the kernels directly, since limit_simd_level() can only lower the level of the
      // process.
      BilateralPainter painter;
      cv::Mat painted = image.clone();
      painter.paint_with(*kernels_of(level), painted, options, 4);
      if (first.empty()) first = painted;
      EXPECT_EQ(cv::norm(painted, first, cv::NORM_INF), 0)
          << name_of(level) << ", " << size << ", diameter " << options.diameter << ", sigma "
          << options.sigma_color;
    }
  }
}

TEST(BilateralPainter, MatchesOpenCvBilateralFilter) {
  cv::Mat image = test_image({320, 240}, 3, 5);
  cv::GaussianBlur(image, image, {5, 5}, 1.2);
  for (const PaintOptions& options :
       {PaintOptions{}, PaintOptions{.diameter = 5, .sigma_color = 4, .sigma_space = 2},
        PaintOptions{.diameter = 13, .sigma_color = 3, .sigma_space = 5}}) {
    ASSERT_TRUE(BilateralPainter::supports(options));
    cv::Mat expected;
    cv::bilateralFilter(image, expected, options.diameter, options.sigma_color,
                        options.sigma_space);
    cv::Mat painted = image.clone();
    BilateralPainter().paint(painted, options, 1);
    // After one pass, weights in 127 steps may change a value by 1 at most.
    EXPECT_LE(cv::norm(painted, expected, cv::NORM_INF), 1) << options.diameter;
    EXPECT_GT(cv::PSNR(painted, expected), 55) << options.diameter;
  }
}

TEST(BilateralPainter, RejectsUnsupportedWeights) {
  EXPECT_FALSE(BilateralPainter::supports({.sigma_color = 25}));
  cv::Mat image(20, 20, CV_8UC3, cv::Scalar::all(9));
  EXPECT_THROW(BilateralPainter().paint(image, {.sigma_color = 25}, 1), std::invalid_argument);
}

TEST(BilateralPainter, SumsCannotOverflow) {
  // One pixel that differs from all its neighbours by the max amount in every channel.
  for (const int step : {3, 9, 12, 31}) {
    cv::Mat image(33, 33, CV_8UC3, cv::Scalar::all(100));
    image.at<cv::Vec3b>(16, 16) = {static_cast<std::uint8_t>(100 + step), 100, 100};
    cv::Mat expected;
    cv::bilateralFilter(image, expected, 9, 9, 7);
    BilateralPainter().paint(image, {}, 1);
    // 48 weights below half a step are rounded to 0: at most 4 levels of error. An overflow would
    // give errors of tens of levels.
    EXPECT_LE(cv::norm(image, expected, cv::NORM_INF), 4) << step;
  }
}

TEST(Plane, ReflectionDoesNotRepeatTheBorder) {
  EXPECT_EQ(Plane::reflected(-1, 5), 1);
  EXPECT_EQ(Plane::reflected(5, 5), 3);
  EXPECT_EQ(Plane::reflected(-4, 2), 0);
  EXPECT_EQ(Plane::reflected(7, 1), 0);
}

}  // namespace
}  // namespace tarsier::cartoon
