// SPDX-License-Identifier: MIT
#include "tarsier/face/onnx/own_networks.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/onnx/module.h"
#include "tarsier/face/onnx/testing_onnx.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <fstream>
#include <numeric>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace tarsier::face::onnx {
namespace {

using testing::HasSubstr;
using namespace testing_onnx;

class OwnNetworks : public FolderTest {
 protected:
  void SetUp() override {
    if (module_path().empty()) GTEST_SKIP() << "tarsier-onnx.so is not built";
  }
  std::string write(const std::string& name, const std::string& bytes) {
    const std::string file = path(name);
    std::ofstream(file, std::ios::binary) << bytes;
    return file;
  }
  static std::string reason(const std::string& file) {
    try {
      (void)load_embedding(file);
    } catch (const ModelError& error) {
      return error.what();
    }
    return {};
  }
};

// The crop of a face of 128 x 160 px, with its eyes at the positions of a cut.
cv::Mat crop_with_eyes() {
  cv::Mat crop(160, 128, CV_8UC1, cv::Scalar(60));
  cv::circle(crop, cv::Point2d(0.27 * 128 - 0.5, 0.34 * 160 - 0.5), 3, cv::Scalar(255), cv::FILLED);
  cv::circle(crop, cv::Point2d(0.73 * 128 - 0.5, 0.34 * 160 - 0.5), 3, cv::Scalar(255), cv::FILLED);
  return crop;
}

TEST(AlignedChip, PutsTheEyesAtTheirAlignedPositions) {
  for (const int side : {112, 224}) {
    const cv::Mat chip = aligned_chip(crop_with_eyes(), {side, side});
    ASSERT_EQ(chip.size(), cv::Size(side, side));
    for (const double sign : {-1.0, 1.0}) {
      const cv::Rect half(sign < 0 ? 0 : side / 2, 0, side / 2, side);
      const cv::Moments moments = cv::moments(chip(half) > 200, true);
      const double scale = side / kAlignedSide;
      EXPECT_NEAR(half.x + moments.m10 / moments.m00,
                  scale * (kAlignedEyesX + sign * kAlignedEyeDistance / 2), 0.5);
      EXPECT_NEAR(moments.m01 / moments.m00, scale * kAlignedEyesY, 0.5);
    }
  }
  EXPECT_THROW((void)aligned_chip(cv::Mat(4, 4, CV_8UC3), {112, 112}), std::invalid_argument);
}

TEST(AlignedChip, DoesNotChangeItsInput) {
  const cv::Mat crop = crop_with_eyes();
  const cv::Mat before = crop.clone();
  (void)aligned_chip(crop, {64, 64});
  EXPECT_EQ(cv::norm(crop, before), 0);
}

TEST_F(OwnNetworks, ReturnsTheNormalisedOutput) {
  const auto network = load_embedding(write("means.onnx", means_of_fields()));
  EXPECT_EQ(network->outputs(), 16);
  EXPECT_EQ(network->name, "means.onnx");
  EXPECT_EQ(network->sha256.size(), 64U);
  EXPECT_GT(network->fingerprint, 0);
  const cv::Mat crop = crop_with_eyes();
  const std::vector<float> numbers = recognition::embed_crop(*network, crop);
  // Computed by hand: means of fields of 4 x 4 px, scaled to unit length.
  const cv::Mat chip = aligned_chip(crop, {16, 16});
  std::vector<double> expected;
  for (int y = 0; y < 4; ++y)
    for (int x = 0; x < 4; ++x) expected.push_back(cv::mean(chip(cv::Rect(4 * x, 4 * y, 4, 4)))[0]);
  const double length =
      std::sqrt(std::inner_product(expected.begin(), expected.end(), expected.begin(), 0.0));
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(numbers[i], expected[i] / length, 1e-5);
}

TEST_F(OwnNetworks, ReadsMeanAndScaleFromTheTextFile) {
  const std::string path = write("means.onnx", means_of_fields());
  const auto plain = load_embedding(path);
  write("means.onnx.txt", "mean: 60\nscale: 0.5\nlicence: of the test\n");
  const auto shifted = load_embedding(path);
  EXPECT_NE(plain->fingerprint, shifted->fingerprint);
  EXPECT_EQ(plain->sha256, shifted->sha256);
  const std::vector<float> numbers = recognition::embed_crop(*shifted, crop_with_eyes());
  EXPECT_EQ(numbers.back(), 0) << "the lower right corner is 60 in grey";
  write("means.onnx.txt", "mean: 1 2 3\n");
  EXPECT_THAT(reason(path), HasSubstr("more means than the network has channels"));
}

TEST_F(OwnNetworks, IsThreadSafe) {
  const auto network = load_embedding(write("means.onnx", means_of_fields()));
  const cv::Mat crop = crop_with_eyes();
  const std::vector<float> expected = recognition::embed_crop(*network, crop);
  std::vector<int> wrong(4);
  std::vector<std::thread> threads;
  for (int& count : wrong)
    threads.emplace_back([&] {
      for (int i = 0; i < 20; ++i)
        if (recognition::embed_crop(*network, crop) != expected) ++count;
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(wrong, testing::Each(0));
}

TEST_F(OwnNetworks, RefusesWithTheReason) {
  EXPECT_THAT(reason(path("gone.onnx")), HasSubstr("gone.onnx: cannot be read"));
  const auto relu = [&](const std::vector<std::uint64_t>& shape) {
    return write("relu.onnx", network({node("Relu", {"data"}, "out")}, {}, {form("data", shape)},
                                      {form("out", shape)}));
  };
  EXPECT_THAT(reason(relu({1, 3})), HasSubstr("in place of one image"));
  EXPECT_THAT(reason(relu({1, 7, 16, 16})), HasSubstr("images of 7 channels"));
  EXPECT_THAT(reason(relu({1, 3, 0, 0})), HasSubstr("relu.onnx.txt"));
  EXPECT_THAT(reason(relu({1, 3, 112, 112})), HasSubstr("of 37632 numbers in place of one"));
  // Weights of a convolution that do not fit the image: OpenCV's own message, on one line.
  const std::string wrong =
      write("wrong.onnx", network({node("Conv", {"data", "w"}, "out")},
                                  {tensor("w", {2, 5, 1, 1}, std::vector<float>(10, 1))},
                                  {form("data", {1, 3, 16, 16})}, {form("out", {1, 2, 16, 16})}));
  EXPECT_THAT(reason(wrong), HasSubstr("OpenCV does not take it"));
  EXPECT_EQ(reason(wrong).find('\n'), std::string::npos);
  EXPECT_THROW((void)load_box_detector(write("means.onnx", means_of_fields())), ModelError);
}

}  // namespace
}  // namespace tarsier::face::onnx
