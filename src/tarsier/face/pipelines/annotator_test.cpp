// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/annotator.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/pipelines/annotator_match.h"
#include "tarsier/face/shape/import.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::face {
namespace {

using Eigen::Matrix2Xd;

// An object with six points: discs on a plate, on a blotched background. It has any position and
// size, and its parts move a little on their own.
struct SyntheticObject {
  cv::Mat gray;
  Matrix2Xd points;
};

SyntheticObject synthetic_object(std::uint64_t seed, double jitter = 0.05) {
  Rng rng(seed);
  const double size = rng.uniform(34, 46);
  const double angle = rng.uniform(-0.15, 0.15);
  const cv::Point2d middle(rng.uniform(110, 210), rng.uniform(90, 150));
  Matrix2Xd mean(2, 6);
  mean << -1, 1, 0, -0.8, 0.8, 0, -0.7, -0.7, 0, 0.8, 0.8, 1.2;
  SyntheticObject result;
  result.points.resize(2, 6);
  for (int i = 0; i < 6; ++i) {
    const double x = mean(0, i) + rng.uniform(-jitter, jitter);
    const double y = mean(1, i) + rng.uniform(-jitter, jitter);
    result.points.col(i) << middle.x + size * (std::cos(angle) * x - std::sin(angle) * y),
        middle.y + size * (std::sin(angle) * x + std::cos(angle) * y);
  }
  cv::Mat image(240, 320, CV_8UC1, cv::Scalar(120));
  for (int k = 0; k < 60; ++k)
    cv::circle(image, {rng.integer(0, 319), rng.integer(0, 239)}, rng.integer(4, 20),
               cv::Scalar(rng.integer(90, 150)), cv::FILLED, cv::LINE_AA);
  cv::circle(image, middle, cvRound(1.7 * size), cv::Scalar(190), cv::FILLED, cv::LINE_AA);
  const auto at = [&](int i, int bits) {
    return cv::Point(cvRound(result.points(0, i) * (1 << bits)),
                     cvRound(result.points(1, i) * (1 << bits)));
  };
  cv::line(image, at(3, 4), at(4, 4), cv::Scalar(80), 3, cv::LINE_AA, 4);
  for (int i = 0; i < 6; ++i)
    cv::circle(image, at(i, 4), cvRound((0.14 + 0.03 * i) * size * 16),
               cv::Scalar(20 + 20 * (i % 3)), cv::FILLED, cv::LINE_AA, 4);
  cv::GaussianBlur(image, result.gray, {}, 0.8);
  return result;
}

class AnnotatorTest : public ::testing::Test {
 protected:
  shape::LandmarkSet done(int count, double jitter = 0.05) {
    shape::LandmarkSet set;
    for (int k = 0; k < count; ++k) {
      const SyntheticObject one = synthetic_object(static_cast<std::uint64_t>(k) + 1, jitter);
      shape::LandmarkSample sample;
      sample.image = folder_ / (std::to_string(k) + ".png");
      write_image(sample.image, one.gray);
      sample.points = one.points;
      set.samples.push_back(sample);
    }
    return set;
  }
  // Share of points within 3 px, over held-out images.
  static double share(Annotator& annotator, const shape::LandmarkSet& set, int images) {
    int good = 0;
    for (int k = 0; k < images; ++k) {
      const SyntheticObject one = synthetic_object(1000 + static_cast<std::uint64_t>(k));
      const auto proposal =
          annotator.propose({one.gray, set, static_cast<int>(set.samples.size()) - 1});
      if (!proposal) continue;
      for (int i = 0; i < 6; ++i)
        good += (proposal->points.col(i) - one.points.col(i)).norm() <= 3 ? 1 : 0;
    }
    return good / (6.0 * images);
  }
  TemporaryFolder folder_;
};

TEST_F(AnnotatorTest, LearnsAnObjectWithoutAFaceDetector) {
  AnnotatorOptions options;
  options.find_faces = false;
  Annotator annotator(options);
  const double after_ten = share(annotator, done(10), 12);
  EXPECT_GT(after_ten, 0.8);
}

TEST_F(AnnotatorTest, IgnoresADetectorThatFindsOtherObjects) {
  Annotator annotator;
  EXPECT_GT(share(annotator, done(10), 6), 0.8);
}

TEST_F(AnnotatorTest, IsDeterministic) {
  const shape::LandmarkSet set = done(6);
  const SyntheticObject one = synthetic_object(77);
  Annotator a;
  Annotator b;
  (void)b.propose({synthetic_object(78).gray, done(4), 0});
  const auto first = a.propose({one.gray, set, 0});
  const auto second = b.propose({one.gray, set, 0});
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first->points, second->points);
  EXPECT_TRUE(first->from_model);
  EXPECT_EQ(first->points, a.propose({one.gray, set, 0})->points) << "again";
}

TEST_F(AnnotatorTest, TransfersPointsToTheNextFrame) {
  const shape::LandmarkSet set = done(1);
  const cv::Mat first = read_gray_image(set.samples[0].image);
  const cv::Mat map = (cv::Mat_<double>(2, 3) << 1.02, -0.02, 3.5, 0.02, 1.02, -6.25);
  cv::Mat next;
  cv::warpAffine(first, next, map, first.size(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  Annotator annotator;
  const auto proposal = annotator.propose({next, set, 0});
  ASSERT_TRUE(proposal);
  for (int i = 0; i < 6; ++i) {
    const double x = set.samples[0].points(0, i);
    const double y = set.samples[0].points(1, i);
    EXPECT_NEAR(proposal->points(0, i), 1.02 * x - 0.02 * y + 3.5, 0.5) << i;
    EXPECT_NEAR(proposal->points(1, i), 0.02 * x + 1.02 * y - 6.25, 0.5) << i;
  }
  EXPECT_FALSE(proposal->from_model);
  const nlohmann::ordered_json json = to_json(*proposal);
  ASSERT_EQ(json["points"].size(), 6U);
  EXPECT_NEAR(json["points"][3][0].get<double>(), proposal->points(0, 3), 0.005);
  EXPECT_EQ(json["learned"], false);
}

TEST_F(AnnotatorTest, MakesNoProposalForAnUnrelatedImage) {
  Annotator annotator;
  EXPECT_FALSE(annotator.propose({synthetic_object(1).gray, {}, 0})) << "nothing done yet";
  cv::Mat noise(240, 320, CV_8UC1);
  Rng rng(5);
  for (int y = 0; y < noise.rows; ++y)
    for (int x = 0; x < noise.cols; ++x)
      noise.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(rng.integer(0, 255));
  EXPECT_FALSE(annotator.propose({noise, done(1), 0}));
}

TEST_F(AnnotatorTest, ToleratesMissingPointsAndImages) {
  shape::LandmarkSet set = done(8);
  set.samples[2].points.col(1).setConstant(std::nan(""));
  set.samples[3].points.setConstant(std::nan(""));
  set.samples[4].image = folder_ / "gone.png";
  AnnotatorOptions options;
  options.find_faces = false;
  Annotator annotator(options);
  EXPECT_GT(share(annotator, set, 6), 0.7);
  shape::LandmarkSet gone = done(1);
  gone.samples[0].image = folder_ / "gone.png";
  EXPECT_FALSE(annotator.propose({synthetic_object(1).gray, gone, 0}));
}

TEST_F(AnnotatorTest, DoesNotModifyTheImage) {
  const shape::LandmarkSet set = done(5);
  Annotator annotator;
  const SyntheticObject one = synthetic_object(77);
  const cv::Mat before = one.gray.clone();
  (void)annotator.propose({one.gray, set, 0});
  EXPECT_EQ(cv::norm(before, one.gray, cv::NORM_INF), 0);
}

TEST(AnnotatorData, ProposesPointsOfImmFaces) {
  TARSIER_LONG_TEST();
  const char* data = std::getenv("TARSIER_DATA");
  if (data == nullptr || *data == '\0') GTEST_SKIP() << "no $TARSIER_DATA";
  shape::LandmarkSet all;
  try {
    all = shape::import_landmarks(std::string(data) + "/imm-frontal").set;
  } catch (const InputError& error) {
    GTEST_SKIP() << error.what();
  }
  ASSERT_EQ(all.samples.size(), 60u);
  Rng rng(1);
  for (int i = 59; i > 0; --i)
    std::swap(all.samples[static_cast<std::size_t>(i)],
              all.samples[static_cast<std::size_t>(rng.integer(0, i))]);
  shape::LandmarkSet done = all;
  done.samples.resize(20);
  Annotator annotator;
  int good = 0;
  int total = 0;
  for (std::size_t k = 20; k < 60; k += 4) {  // only some of them, since it is slow
    const auto proposal = annotator.propose({read_gray_image(all.samples[k].image), done, 19});
    ASSERT_TRUE(proposal);
    for (Eigen::Index i = 0; i < proposal->points.cols(); ++i) {
      good += (proposal->points.col(i) - all.samples[k].points.col(i)).norm() <= 3 ? 1 : 0;
      ++total;
    }
  }
  EXPECT_GE(good, 0.8 * total) << 100.0 * good / total << " % within 3 px";
}

}  // namespace
}  // namespace tarsier::face
