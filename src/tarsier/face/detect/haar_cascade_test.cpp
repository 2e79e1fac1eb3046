// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/haar_cascade.h"

#include "tarsier/core/rng.h"
#include "tarsier/face/detect/cascade.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/objdetect.hpp>

#include <algorithm>
#include <tuple>

namespace tarsier::face {
namespace {

bool is_before(const cv::Rect& a, const cv::Rect& b) {
  return std::tuple(a.width, a.y, a.x) < std::tuple(b.width, b.y, b.x);
}

std::vector<cv::Rect> sorted(std::vector<cv::Rect> boxes) {
  std::sort(boxes.begin(), boxes.end(), is_before);
  return boxes;
}

// Shades similar to faces: dark eyes and mouths in bright ovals, at all sizes, with noise.
cv::Mat face_like(cv::Size size, std::uint64_t seed) {
  Rng rng(seed);
  cv::Mat image(size, CV_8UC1, cv::Scalar(90));
  for (int k = 0; k < 14; ++k) {
    const double r = rng.uniform(12, 60);
    const cv::Point2d at(rng.uniform(0, size.width), rng.uniform(0, size.height));
    const auto oval = [&](double dx, double dy, double rx, double ry, double shade) {
      cv::ellipse(image, cv::Point2d(at.x + dx * r, at.y + dy * r), cv::Size2d(rx * r, ry * r), 0,
                  0, 360, cv::Scalar(shade), cv::FILLED);
    };
    oval(0, 0, 0.9, 1.2, rng.uniform(150, 220));
    for (const double side : {-1., 1.}) oval(0.38 * side, -0.2, 0.2, 0.1, rng.uniform(30, 70));
    oval(0, 0.25, 0.12, 0.1, 120);
    oval(0, 0.65, 0.4, 0.1, rng.uniform(60, 90));
  }
  cv::GaussianBlur(image, image, {}, 1.2);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x)
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(image.at<uchar>(y, x) + rng.uniform(-6, 6));
  return image;
}

struct Case {
  const char* cascade;
  cv::Size size;
  double step;
  int min;
  int max;
};

class HaarCascadeTest : public testing::TestWithParam<Case> {};

TEST_P(HaarCascadeTest, FindsTheSameWindowsAsOpenCv) {
  const auto [name, size, step, min, max] = GetParam();
  const std::string path = find_cascade(name);
  if (path.empty()) GTEST_SKIP() << "OpenCV's cascades are not installed (opencv-data)";
  std::optional<HaarCascade> haar = HaarCascade::read(path);
  ASSERT_TRUE(haar);
  cv::CascadeClassifier opencv(path);
  std::size_t windows = 0;
  for (const std::uint64_t seed : {1, 2, 3}) {
    const cv::Mat image = face_like(size, seed);
    std::vector<cv::Rect> expected;
    opencv.detectMultiScale(image, expected, step, 0, 0, {min, min}, {max, max});
    std::vector<cv::Rect> found = haar->find(image, step, {min, min}, {max, max});
    for (cv::Rect& box : found) box &= cv::Rect({}, size);  // rounding may add a pixel
    EXPECT_EQ(sorted(found), sorted(expected)) << "seed " << seed;
    windows += expected.size();

    std::vector<cv::Rect> boxes = expected;
    std::vector<cv::Rect> same = expected;
    cv::groupRectangles(same, 2, 0.2);
    EXPECT_EQ(sorted(grouped_boxes(boxes, 2)), sorted(same)) << "seed " << seed;
  }
  EXPECT_GT(windows, 0U);
}

INSTANTIATE_TEST_SUITE_P(
    Files, HaarCascadeTest,
    testing::Values(Case{"haarcascade_frontalface_alt2.xml", {320, 240}, 1.1, 20, 0},
                    Case{"haarcascade_frontalface_alt2.xml", {161, 123}, 1.05, 24, 90},
                    Case{"haarcascade_frontalface_default.xml", {320, 240}, 1.05, 30, 0},
                    Case{"haarcascade_profileface.xml", {250, 199}, 1.05, 20, 0},
                    Case{"haarcascade_frontalface_alt2.xml", {200, 200}, 1.3, 61, 61}));

TEST(HaarCascade, IsTheSameForAnyThreadsAndInstructionSet) {
  const std::string path = find_cascade("haarcascade_frontalface_alt2.xml");
  if (path.empty()) GTEST_SKIP() << "OpenCV's cascades are not installed (opencv-data)";
  const cv::Mat image = face_like({400, 300}, 7);
  const auto found = [&] { return HaarCascade::read(path)->find(image, 1.05, {20, 20}, {}); };
  const std::vector<cv::Rect> expected = found();
  EXPECT_FALSE(expected.empty());
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  EXPECT_EQ(found(), expected);
  cv::setNumThreads(threads);

  const HaarStage stage{0, 1, 0.5F};
  const HaarTree tree{0, 1};
  HaarNode node;
  node.rects[0] = {0, 1, 0, 0};
  node.weights = {1, 0, 0};
  node.threshold = -30;
  node.below_value = 1;
  Rng rng(3);
  std::vector<std::int32_t> sum(100 + kHaarPadding);
  for (std::int32_t& value : sum) value = rng.integer(0, 99);
  const std::vector<float> norms(sum.size(), 1.F);
  const auto pass = [&](const HaarKernels& kernels) {
    std::vector<std::int32_t> windows;
    for (int i = 0; i < 99; i += 1 + i % 3) windows.push_back(i);
    windows.resize(
        static_cast<std::size_t>(kernels.pass(stage, &tree, &node, sum.data(), norms.data(),
                                              windows.data(), static_cast<int>(windows.size()))));
    return windows;
  };
  const std::vector<std::int32_t> plain = pass(*haar_baseline());
  EXPECT_FALSE(plain.empty());
  EXPECT_EQ(pass(haar_kernels()), plain);
}

TEST(HaarCascade, UnsupportedCascadesUseOpenCv) {
  for (const char* name : {"lbpcascade_frontalface.xml", "haarcascade_eye_tree_eyeglasses.xml"}) {
    const std::string path = find_cascade(name);
    if (path.empty()) GTEST_SKIP() << "OpenCV's cascades are not installed (opencv-data)";
    EXPECT_FALSE(HaarCascade::read(path)) << name;
    EXPECT_GT(Cascade(name).window().width, 0) << name;
  }
  EXPECT_FALSE(HaarCascade::read("/nowhere/cascade.xml"));
}

TEST(HaarCascade, FindsNothingInImagesSmallerThanTheWindow) {
  const std::string path = find_cascade("haarcascade_frontalface_alt2.xml");
  if (path.empty()) GTEST_SKIP() << "OpenCV's cascades are not installed (opencv-data)";
  std::optional<HaarCascade> cascade = HaarCascade::read(path);
  for (const cv::Size size : {cv::Size(19, 40), cv::Size(40, 19), cv::Size(20, 20)})
    EXPECT_TRUE(cascade->find(cv::Mat1b::zeros(size), 1.1, {20, 20}, {}).empty());
}

}  // namespace
}  // namespace tarsier::face
