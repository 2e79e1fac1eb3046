// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/simulated_views.h"

#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/matching.h"
#include "tarsier/synth/sfm_scene.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr double kDeg = std::numbers::pi / 180;

cv::Mat texture() { return synth::SfmScene(synth::SceneOptions{}).render(0); }

struct TiltedPlane {
  cv::Mat image;
  cv::Matx33d from_front;  // homography of pixels, pixel centres at integers
};

// The camera image of a plane with this image on it, rotated about the vertical axis through its
// middle.
TiltedPlane seen_from_the_side(const cv::Mat& image, double degrees) {
  const double c = std::cos(degrees * kDeg);
  const double s = std::sin(degrees * kDeg);
  const double x = (image.cols - 1) / 2.0;
  const double y = (image.rows - 1) / 2.0;
  const double focal = 1.5 * image.cols;
  const double distance = 1.6 * image.cols;
  TiltedPlane plane;
  plane.from_front = cv::Matx33d(focal, 0, x, 0, focal, y, 0, 0, 1) *
                     cv::Matx33d(c, 0, -c * x, 0, 1, -y, s, 0, distance - s * x);
  // Rendered at three times the size and reduced, against aliasing.
  constexpr int kFiner = 3;
  const cv::Matx33d finer(kFiner, 0, (kFiner - 1) / 2.0, 0, kFiner, (kFiner - 1) / 2.0, 0, 0, 1);
  cv::Mat large;
  cv::warpPerspective(image, large, finer * plane.from_front, image.size() * kFiner,
                      cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar::all(127));
  cv::resize(large, plane.image, image.size(), 0, 0, cv::INTER_AREA);
  return plane;
}

struct PlaneMatches {
  int matches = 0;
  int correct = 0;          // within 3 px of the truth
  double median_error = 0;  // px, of those within 3 px
};

PlaneMatches matched_plane(const cv::Mat& front, const TiltedPlane& plane, bool wide) {
  FeatureOptions options;
  options.wide = wide;
  options.max_count = 1500;
  const Features a = find_features(front, options);
  const Features b = find_features(plane.image, options);
  std::vector<double> errors;
  PlaneMatches quality;
  for (const Match& match : match_features(a, b, FeatureKind::kSift, {})) {
    const cv::Point2f p = a.points[static_cast<std::size_t>(match.first)];
    const cv::Point2f q = b.points[static_cast<std::size_t>(match.second)];
    const cv::Vec3d at = plane.from_front * cv::Vec3d(p.x, p.y, 1);
    const double error = std::hypot(at[0] / at[2] - q.x, at[1] / at[2] - q.y);
    ++quality.matches;
    if (error <= 3) errors.push_back(error);
  }
  quality.correct = static_cast<int>(errors.size());
  if (!errors.empty()) {
    std::sort(errors.begin(), errors.end());
    quality.median_error = errors[errors.size() / 2];
  }
  return quality;
}

TEST(SimulatedViews, MatchPlaneSeenObliquely) {
  const cv::Mat front = texture();
  for (const double degrees : {60.0, 70.0}) {
    SCOPED_TRACE(degrees);
    const TiltedPlane plane = seen_from_the_side(front, degrees);
    const PlaneMatches plain = matched_plane(front, plane, false);
    const PlaneMatches wide = matched_plane(front, plane, true);
    RecordProperty("plain", plain.correct);
    RecordProperty("wide", wide.correct);
    EXPECT_GT(wide.correct, 4 * plain.correct);
    EXPECT_GT(wide.correct, 150);
    EXPECT_GT(wide.correct, 0.9 * wide.matches);
    EXPECT_LT(wide.median_error, 0.5);
  }
}

TEST(SimulatedViews, MapToImagePositions) {
  const cv::Point2d position(131.3, 70.6);
  constexpr double kSigma = 6;
  cv::Mat image(160, 220, CV_8UC1);
  for (int v = 0; v < image.rows; ++v)
    for (int u = 0; u < image.cols; ++u) {
      const cv::Point2d d = cv::Point2d(u, v) - position;
      image.at<std::uint8_t>(v, u) =
          cv::saturate_cast<std::uint8_t>(20 + 200 * std::exp(-d.dot(d) / (2 * kSigma * kSigma)));
    }
  for (const SimulatedView& view : simulated_views()) {
    SCOPED_TRACE(testing::Message() << view.tilt << ' ' << view.angle);
    const ViewImage made = simulate_view(image, view);
    // The blob's centre of gravity.
    double sum = 0;
    cv::Point2d center;
    for (int v = 0; v < made.pixels.rows; ++v)
      for (int u = 0; u < made.pixels.cols; ++u) {
        const double weight = std::max(0, made.pixels.at<std::uint8_t>(v, u) - 25);
        sum += weight;
        center += weight * cv::Point2d(u, v);
      }
    center /= sum;
    const cv::Vec2d back = made.image_from_view * cv::Vec3d(center.x, center.y, 1);
    EXPECT_LT(std::hypot(back[0] - position.x, back[1] - position.y), 0.1);
    EXPECT_NEAR(std::abs(made.image_from_view(0, 0) * made.image_from_view(1, 1) -
                         made.image_from_view(0, 1) * made.image_from_view(1, 0)),
                view.tilt, 1e-9);
  }
}

TEST(SimulatedViews, KeepOrdinaryFeatures) {
  const cv::Mat image = texture();
  FeatureOptions options;
  options.max_count = 400;
  const Features plain = find_features(image, options);
  options.wide = true;
  const Features wide = find_features(image, options);
  const std::size_t count = plain.points.size();
  ASSERT_GT(wide.points.size(), count);
  EXPECT_TRUE(plain.owners.empty());
  EXPECT_TRUE(std::equal(plain.points.begin(), plain.points.end(), wide.points.begin()));
  EXPECT_TRUE(std::equal(plain.sizes.begin(), plain.sizes.end(), wide.sizes.begin()));
  const cv::Mat own = wide.descriptors.rowRange(0, static_cast<int>(count));
  EXPECT_EQ(cv::norm(plain.descriptors, own, cv::NORM_INF), 0);

  // Each descriptor belongs to a point, and there are no more than requested.
  ASSERT_EQ(wide.descriptors.rows, static_cast<int>(wide.points.size() + wide.owners.size()));
  EXPECT_EQ(wide.sizes.size(), wide.points.size());
  EXPECT_EQ(wide.colors.size(), wide.points.size());
  EXPECT_LE(wide.descriptors.rows, 4 * options.max_count + 20);
  ASSERT_FALSE(wide.owners.empty());
  for (const std::int32_t owner : wide.owners)
    EXPECT_TRUE(owner >= 0 && owner < static_cast<std::int32_t>(wide.points.size()));

  // Additional positions are new and inside the image.
  std::set<std::pair<float, float>> positions;
  for (std::size_t i = count; i < wide.points.size(); ++i) {
    const cv::Point2f p = wide.points[i];
    EXPECT_TRUE(positions.insert({p.x, p.y}).second);
    EXPECT_TRUE(p.x >= 0 && p.y >= 0 && p.x < static_cast<float>(image.cols) &&
                p.y < static_cast<float>(image.rows));
    for (std::size_t k = 0; k < count; ++k) EXPECT_GT(cv::norm(p - plain.points[k]), 0.49);
  }
}

TEST(SimulatedViews, AreTheSameForAnyNumberOfThreads) {
  const cv::Mat image = texture();
  FeatureOptions options;
  options.wide = true;
  options.max_count = 300;
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const Features one = find_features(image, options);
  cv::setNumThreads(4);
  const Features four = find_features(image, options);
  cv::setNumThreads(before);
  EXPECT_EQ(one.points, four.points);
  EXPECT_EQ(one.owners, four.owners);
  EXPECT_EQ(cv::norm(one.descriptors, four.descriptors, cv::NORM_INF), 0);
}

TEST(SimulatedViews, TolerateUniformAndTinyImages) {
  FeatureOptions options;
  options.wide = true;
  EXPECT_TRUE(find_features(cv::Mat(100, 90, CV_8UC1, cv::Scalar(90)), options).points.empty());
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(5, 200), cv::Size(9, 11)}) {
    cv::Mat image(size, CV_8UC1);
    cv::randu(image, 0, 255);
    const Features features = find_features(image, options);
    EXPECT_EQ(features.descriptors.rows,
              static_cast<int>(features.points.size() + features.owners.size()));
  }
  options.kind = FeatureKind::kOrb;
  EXPECT_THROW((void)find_features(texture(), options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
