// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/tracker.h"

#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/testing_portraits.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

namespace tarsier::face::appearance {
namespace {

const AppearanceModel& gray_model() {
  static const AppearanceModel result = [] {
    AppearanceOptions options;
    options.colour = false;
    NoProgress silent;
    AppearanceModel trained =
        train_appearance_model(test_support::portraits(40, 1), {}, options, silent, {});
    trained.lost_error = 0.4;
    return trained;
  }();
  return result;
}

// A video of the same object on a plain background. It moves a little from frame to frame.
struct Video {
  TrainingImage thing = test_support::portraits(1, 91)[0];
  Eigen::Vector2d at{0, 0};

  [[nodiscard]] cv::Mat frame(bool is_shown = true) const {
    cv::Mat image(240, 320, CV_8UC3, cv::Scalar(128, 115, 102));
    if (!is_shown) return image;
    const cv::Mat shift = (cv::Mat_<double>(2, 3) << 1, 0, at.x(), 0, 1, at.y());
    cv::warpAffine(thing.image, image, shift, image.size(), cv::INTER_LINEAR,
                   cv::BORDER_TRANSPARENT);
    return image;
  }
  [[nodiscard]] Eigen::Matrix2Xd points() const { return thing.points.colwise() + at; }
  // Starts with a small displacement from the object.
  [[nodiscard]] FindStarts find(int* calls) const {
    return [this, calls](const cv::Mat&) {
      ++*calls;
      const Eigen::Matrix2Xd mean =
          shape::fit_similarity(gray_model().shape.mean, points())(gray_model().shape.mean);
      return std::vector<std::vector<Eigen::Matrix2Xd>>{{mean.colwise() + Eigen::Vector2d(3, -2)}};
    };
  }
};

double error_of(const TrackedObject& object, const Video& video) {
  return (object.fit.points - video.points()).colwise().norm().mean();
}

class TrackTest : public ::testing::TestWithParam<Method> {};

TEST_P(TrackTest, TracksWithoutSearchAndKeepsId) {
  FitOptions options;
  options.method = GetParam();
  const Fitter fitter(gray_model(), options);
  Video video;
  Track track;
  int calls = 0;
  const TrackOptions how{.search_every = 100};
  for (int i = 0; i < 20; ++i) {
    video.at = {3.0 * i, 1.5 * i};
    const auto objects =
        track_objects(fitter, how, video.find(&calls), track, video.frame(), i / 25.0);
    ASSERT_EQ(objects.size(), 1U) << "frame " << i;
    EXPECT_EQ(objects[0].id, 1);
    EXPECT_LT(error_of(objects[0], video), 1.0) << "frame " << i;
  }
  EXPECT_EQ(calls, 1);
}

INSTANTIATE_TEST_SUITE_P(Both, TrackTest,
                         ::testing::Values(Method::kProjectOut, Method::kAlternating));

TEST(Track, ReappearingObjectKeepsItsId) {
  const Fitter fitter(gray_model(), {});
  Video video;
  Track track;
  int calls = 0;
  const TrackOptions how;
  const auto step = [&](int i, bool is_shown) {
    return track_objects(fitter, how, video.find(&calls), track, video.frame(is_shown), i / 25.0);
  };
  ASSERT_EQ(step(0, true).size(), 1U);
  ASSERT_EQ(step(1, true).size(), 1U);
  for (int i = 2; i < 8; ++i) EXPECT_EQ(step(i, false).size(), 0U) << "frame " << i;
  video.at = {5, 0};
  std::vector<TrackedObject> back;
  for (int i = 8; i < 20 && back.empty(); ++i) back = step(i, true);
  ASSERT_EQ(back.size(), 1U);
  EXPECT_EQ(back[0].id, 1);
  EXPECT_LT(error_of(back[0], video), 1.0);
}

TEST(Track, DuplicateStartsGiveOneObject) {
  const Fitter fitter(gray_model(), {});
  const Video video;
  int calls = 0;
  const FindStarts one = video.find(&calls);
  const FindStarts twice = [&](const cv::Mat& image) {
    auto starts = one(image);
    starts.push_back(starts[0]);
    return starts;
  };
  FitWorkspace workspace;
  EXPECT_EQ(find_objects(fitter, twice, video.frame(), 5, workspace).size(), 1U);
  EXPECT_EQ(find_objects(fitter, twice, video.frame(false), 5, workspace).size(), 0U);
}

TEST(Track, FindObjectsDoesNotDependOnEarlierImages) {
  FitOptions options;
  options.method = Method::kAlternating;
  const Fitter fitter(gray_model(), options);
  const Video video;
  Video other;
  other.thing = test_support::portraits(1, 92)[0];
  int calls = 0;
  FitWorkspace used;
  FitWorkspace fresh;
  (void)find_objects(fitter, other.find(&calls), other.frame(), 5, used);
  const auto a = find_objects(fitter, video.find(&calls), video.frame(), 5, used);
  const auto b = find_objects(fitter, video.find(&calls), video.frame(), 5, fresh);
  ASSERT_EQ(a.size(), 1U);
  ASSERT_EQ(b.size(), 1U);
  EXPECT_EQ(a[0].fit.points, b[0].fit.points);
}

}  // namespace
}  // namespace tarsier::face::appearance
