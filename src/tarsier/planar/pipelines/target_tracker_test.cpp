// SPDX-License-Identifier: MIT
#include "tarsier/planar/pipelines/target_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/planar/image_targets/target_io.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/planar/pipelines/testing_frame.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace tarsier::planar {
namespace {

synth::PlanarVideo poster_video() { return synth::print_video({synth::poster_print(0, 5)}, {}); }

const image_targets::Target& poster() {
  static const image_targets::Target target = [] {
    image_targets::TrainOptions options;
    options.trials = 4;
    return image_targets::train_target(synth::poster_print(0, 5).image, "poster", options);
  }();
  return target;
}

TEST(TargetTracker, DetectsTargetOfFileAndItsPose) {
  const TemporaryFolder folder;
  const std::string path = folder / "poster.target.json";
  image_targets::write_target(path, poster());
  TargetTrackerOptions options;
  options.camera = poster_video().camera();
  const auto tracker = TargetTracker::load({path}, options);
  EXPECT_EQ(tracker.targets().size(), 1U);
  TargetState state;
  auto result = tracker.process(frame_of(poster_video().image_at(0), true), state);
  ASSERT_EQ(result.tracked.size(), 1U);
  EXPECT_EQ(result.target_of(result.tracked[0]).name, "poster");
  const auto truth = poster_video().truth_at(0);
  for (std::size_t k = 0; k < 4; ++k)
    EXPECT_LT(cv::norm(result.tracked[0].corners[k] - truth[0].corners[k]), 1);
  ASSERT_TRUE(result.tracked[0].pose);
  EXPECT_LT((result.tracked[0].pose->camera_from_plane.translation -
             truth[0].camera_from_print.translation)
                .norm(),
            0.01);
  result.ms = 7.006;
  const auto json = to_json(result);
  std::string keys;
  for (const auto& item : json["markers"][0].items()) keys += item.key() + " ";
  EXPECT_EQ(keys, "id name corners homography confidence rvec tvec rms_px ");
  EXPECT_EQ(json["ms"], 7.01);
}

TEST(TargetTracker, TracksVideosAndResetsForAnotherSource) {
  const TargetTracker tracker({poster()});
  TargetState state;
  const auto clip = poster_video();
  const auto frames_of = [&](const std::string& name, double time, bool still = false) {
    const auto result = tracker.process(frame_of(clip.image_at(time), still, 0, name), state);
    return result.tracked.empty() ? 0 : static_cast<int>(result.tracked[0].frames);
  };
  EXPECT_EQ(frames_of("a.mp4", 0), 1);
  EXPECT_EQ(frames_of("a.mp4", 0.04), 2);
  EXPECT_EQ(frames_of("a.mp4", 0.08), 3);
  redetect(state);
  EXPECT_EQ(frames_of("a.mp4", 0.12), 1);
  EXPECT_EQ(frames_of("a.mp4", 0.16), 2);
  EXPECT_EQ(frames_of("b.mp4", 0.2), 1);
  EXPECT_EQ(frames_of("b.mp4", 0.2, true), 1);  // a still image is independent
  EXPECT_EQ(frames_of("c/1.png", 0.2), 1);
  EXPECT_EQ(frames_of("c/2.png", 0.24), 2);  // a folder that is played as a poster_video
}

TEST(TargetTracker, HasNoPoseWithoutCamera) {
  const TargetTracker tracker({poster()});
  TargetState state;
  const auto result = tracker.process(frame_of(poster_video().image_at(0), true), state);
  ASSERT_EQ(result.tracked.size(), 1U);
  EXPECT_FALSE(result.tracked[0].pose);
  EXPECT_FALSE(result.camera);
  EXPECT_FALSE(to_json(result)["markers"][0].contains("tvec"));
}

TEST(TargetTracker, RejectsInvalidInput) {
  EXPECT_THROW((void)TargetTracker::load({"/nowhere/x.target.json"}), Error);
  TargetTrackerOptions options;
  options.track.min_inlier_share = 2;
  EXPECT_THROW((void)TargetTracker({}, options), std::invalid_argument);
  options = {};
  options.camera = poster_video().camera();
  TargetState state;
  const cv::Mat square(480, 480, CV_8UC3, cv::Scalar::all(9));
  EXPECT_THROW((void)TargetTracker({}, options).process(frame_of(square, true), state), InputError);
  EXPECT_THROW((void)TargetTracker({}).process(frame_of({}, true), state), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar
