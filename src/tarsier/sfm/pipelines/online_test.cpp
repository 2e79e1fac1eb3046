// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/online.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/synth/sfm_scene.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <fstream>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

class Online : public FolderTest {
 protected:
  std::vector<Input> shoot(int images, synth::Trajectory trajectory, cv::Size size = {320, 240},
                           const std::string& prefix = "") {
    synth::SceneOptions scene_options;
    scene_options.size = size;
    scene_options.images = images;
    scene_options.trajectory = trajectory;
    const synth::SfmScene scene(scene_options);
    camera_ = scene.camera();
    std::vector<Input> inputs;
    for (int i = 0; i < scene.count(); ++i) {
      const std::string name = prefix + std::to_string(i) + ".png";
      write_image(path(name), scene.render(i));
      inputs.push_back({name, path(name)});
      truth_[name] = scene.pose(i);
    }
    return inputs;
  }

  [[nodiscard]] OnlineOptions options() const {
    OnlineOptions options;
    options.pipeline.camera = camera_;
    options.pipeline.features.max_count = 900;
    return options;
  }

  geometry::Camera camera_;
  PoseTruth truth_;
};

TEST_F(Online, RegistersAllImagesAccurately) {
  const auto inputs = shoot(9, synth::Trajectory::kLine);
  OnlineMapper mapper(options());
  EXPECT_TRUE(mapper.model().images.empty());
  std::vector<int> registered;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    mapper.add(inputs[i], {});
    if (i % 3 != 2) continue;
    mapper.grow({});
    registered.push_back(mapper.registered());
  }
  EXPECT_EQ(registered, (std::vector<int>{3, 6, 9}));
  PoseScores scores = evaluate_poses(mapper.model(), truth_, "model");
  EXPECT_EQ(scores.registered, 9);
  EXPECT_LT(scores.center_mean, 0.005 * scores.extent);
  const std::size_t points = mapper.model().points.size();
  mapper.refine({});
  EXPECT_EQ(mapper.registered(), 9);
  EXPECT_GT(mapper.model().points.size(), points / 2);
  scores = evaluate_poses(mapper.model(), truth_, "model");
  EXPECT_LT(scores.center_mean, 0.005 * scores.extent);
}

TEST_F(Online, KeepsPosesWhileImagesAreAdded) {
  const auto inputs = shoot(9, synth::Trajectory::kLine);
  OnlineMapper mapper(options());
  for (std::size_t i = 0; i < 7; ++i) mapper.add(inputs[i], {});
  mapper.grow({});
  ASSERT_EQ(mapper.registered(), 7);
  const Eigen::Vector3d before = mapper.model().images[3].pose.center();
  const double extent =
      (mapper.model().images[0].pose.center() - mapper.model().images[6].pose.center()).norm();
  for (std::size_t i = 7; i < 9; ++i) mapper.add(inputs[i], {});
  mapper.grow({});
  EXPECT_EQ(mapper.registered(), 9);
  EXPECT_LT((mapper.model().images[3].pose.center() - before).norm(), 0.01 * extent)
      << "the model on show jumped";
}

TEST_F(Online, PipelineReusesCachedResults) {
  const auto inputs = shoot(6, synth::Trajectory::kLine);
  OnlineOptions how = options();
  how.pipeline.cache_folder = path("cache");
  std::filesystem::create_directory(how.pipeline.cache_folder);
  {
    OnlineMapper mapper(how);
    for (const Input& input : inputs) mapper.add(input, {});
    mapper.grow({});
  }
  NoProgress progress;
  const PipelineResult after = run_pipeline(inputs, how.pipeline, progress, {});
  EXPECT_EQ(after.from_cache, 6 + 15) << "features and pairs";
  how.pipeline.cache_folder.clear();
  const PipelineResult alone = run_pipeline(inputs, how.pipeline, progress, {});
  ASSERT_EQ(after.reconstruction.models.size(), 1U);
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    EXPECT_EQ(after.reconstruction.models[0].images[i].pose.center(),
              alone.reconstruction.models[0].images[i].pose.center());
  }
}

TEST_F(Online, IsTheSameForAnyNumberOfThreads) {
  const auto inputs = shoot(6, synth::Trajectory::kArc);
  const auto grown = [&](int threads) {
    cv::setNumThreads(threads);
    OnlineMapper mapper(options());
    for (std::size_t i = 0; i < inputs.size(); ++i) {
      mapper.add(inputs[i], {});
      if (i >= 3) mapper.grow({});
    }
    cv::setNumThreads(-1);
    return mapper.model();
  };
  const Model one = grown(1);
  const Model three = grown(3);
  ASSERT_FALSE(one.images.empty());
  EXPECT_EQ(one.points.size(), three.points.size());
  for (std::size_t i = 0; i < one.images.size(); ++i)
    EXPECT_EQ(one.images[i].pose.center(), three.images[i].pose.center());
}

TEST_F(Online, AcceptsImagesOfAnotherSize) {
  auto inputs = shoot(5, synth::Trajectory::kArc);
  const auto larger = shoot(5, synth::Trajectory::kArc, {400, 300}, "large-");
  OnlineMapper mapper(options());
  for (const Input& input : inputs) mapper.add(input, {});
  mapper.grow({});
  for (const Input& input : {larger[1], larger[3]}) mapper.add(input, {});
  mapper.grow({});
  EXPECT_EQ(mapper.registered(), 7);
  EXPECT_EQ(mapper.model().cameras.size(), 2U);
}

TEST_F(Online, GivesReasonWithoutInitialPairAndContinues) {
  synth::SceneOptions turned;
  turned.size = {320, 240};
  turned.images = 4;
  turned.pure_rotation = true;
  const synth::SfmScene scene(turned);
  camera_ = scene.camera();
  OnlineMapper mapper(options());
  for (int i = 0; i < 4; ++i) {
    write_image(path("t.png"), scene.render(i));
    mapper.add({"t" + std::to_string(i), path("t.png")}, {});
  }
  mapper.grow({});
  EXPECT_EQ(mapper.registered(), 0);
  EXPECT_NE(mapper.no_model_reason().find("sideways"), std::string::npos)
      << mapper.no_model_reason();
  for (const Input& input : shoot(4, synth::Trajectory::kArc)) mapper.add(input, {});
  mapper.grow({});
  EXPECT_GE(mapper.registered(), 4);
  EXPECT_EQ(mapper.no_model_reason(), "");
}

TEST_F(Online, SkipsUnreadableImageAndCanBeInterrupted) {
  const auto inputs = shoot(4, synth::Trajectory::kArc);
  std::ofstream(path("bad.png")) << "no image";
  OnlineMapper mapper(options());
  mapper.add(inputs[0], {});
  EXPECT_THROW(mapper.add({"bad.png", path("bad.png")}, {}), InputError);
  for (std::size_t i = 1; i < 4; ++i) mapper.add(inputs[i], {});
  EXPECT_EQ(mapper.count(), 4);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(mapper.grow(stop.get_token()), Interrupted);
  EXPECT_TRUE(mapper.model().images.empty());
  mapper.grow({});
  EXPECT_EQ(mapper.registered(), 4);
}

TEST_F(Online, RefusesInvalidOptions) {
  OnlineOptions bad;
  bad.overlap = 0;
  EXPECT_THROW(OnlineMapper{bad}, std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
