// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/appearance_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace tarsier::face {
namespace {

using testing::HasSubstr;

AppearanceTracker loaded(AppearanceStart start) {
  AppearanceTrackerOptions options;
  options.start = start;
  return AppearanceTracker::load(models(), options);
}

class AppearanceTrackerTest : public MessiTest {};

TEST_F(AppearanceTrackerTest, BoxesAndLandmarksGiveTheSameFit) {
  const AppearanceTracker by_boxes = loaded(AppearanceStart::kAuto);
  const AppearanceTracker by_landmarks = loaded(AppearanceStart::kLandmarks);
  AppearanceState of_boxes;
  AppearanceState of_landmarks;
  const auto first = by_boxes.process(frame(0, true), of_boxes);
  const auto second = by_landmarks.process(frame(0, true), of_landmarks);
  ASSERT_EQ(first.size(), 1U);
  ASSERT_EQ(second.size(), 1U);
  EXPECT_EQ(first[0].id, 1);
  const double eyes = (first[0].fit.points.col(45) - first[0].fit.points.col(36)).norm();
  const double apart = (first[0].fit.points - second[0].fit.points).colwise().norm().mean();
  EXPECT_LT(apart, 0.06 * eyes);
  EXPECT_LT(second[0].fit.error, 0.6);
}

TEST_F(AppearanceTrackerTest, KeepsIdsWithinAVideo) {
  const AppearanceTracker tracker = loaded(AppearanceStart::kAuto);
  AppearanceState state;
  for (int k = 0; k < 3; ++k) EXPECT_EQ(tracker.process(frame(k, false), state).at(0).id, 1);
  // Ids of another video start from 1 again.
  state.track.next_id = 7;
  state.track.objects.at(0).tracked.id = 6;
  EXPECT_EQ(tracker.process(frame(3, false), state).at(0).id, 6);
  EXPECT_EQ(tracker.process(frame(0, false, "b.mp4"), state).at(0).id, 1);
  redetect(state);
  EXPECT_TRUE(state.track.objects.empty());
}

// The library names the option, not the caller's flag.
TEST(AppearanceTrackerLoadTest, ErrorNamesTheUnsupportedOption) {
  const TemporaryFolder folder;
  appearance::AppearanceModel model =
      appearance::read_appearance_model(models().path("aam68.json"));
  model.shape_in_box = {};
  AppearanceTrackerOptions options;
  options.model = folder / "things.json";
  options.start = AppearanceStart::kDetector;
  appearance::write_appearance_model(options.model, model, {});
  try {
    static_cast<void>(AppearanceTracker::load(models(), options));
    FAIL() << "no error";
  } catch (const ModelError& error) {
    EXPECT_THAT(error.what(), HasSubstr("option 'start' must be search"));
  }
  options.start = AppearanceStart::kAuto;
  EXPECT_NO_THROW(static_cast<void>(AppearanceTracker::load(models(), options)));
}

TEST(AppearanceTrackerLoadTest, ErrorNamesTheMissingFile) {
  const TemporaryFolder empty;
  try {
    static_cast<void>(AppearanceTracker::load(ModelStore(empty.path())));
    FAIL() << "no error";
  } catch (const ModelError& error) {
    EXPECT_THAT(error.what(), HasSubstr(empty / "aam68.json"));
  }
  AppearanceTrackerOptions options;
  options.starts = 0;
  EXPECT_THROW(static_cast<void>(AppearanceTracker::load(models(), options)),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face
