// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/online_reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/synth/sfm_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

// A camera that moves along a wall.
class OnlineReconstructing : public FolderTest {
 protected:
  static void SetUpTestSuite() {
    synth::SceneOptions options;
    options.size = {320, 240};
    options.images = 20;
    options.trajectory = synth::Trajectory::kLine;
    const synth::SfmScene scene(options);
    camera_ = new geometry::Camera(scene.camera());
    video_ = new std::vector<cv::Mat>();
    for (int i = 0; i < scene.count(); ++i) video_->push_back(scene.render(i));
  }
  static void TearDownTestSuite() {
    delete video_;
    delete camera_;
  }
  void SetUp() override {
    options_.mapper.pipeline.camera = *camera_;
    options_.mapper.pipeline.features.max_count = 600;
    options_.mapper.overlap = 4;
    options_.frames_folder = path("frames");
  }
  [[nodiscard]] static Frame frame(int index, const std::string& name = "walk") {
    Frame frame;
    frame.image = (*video_)[static_cast<std::size_t>(index)];
    frame.index = index;
    frame.time = index / 10.0;
    frame.name = name;
    return frame;
  }

  static std::vector<cv::Mat>* video_;
  static geometry::Camera* camera_;
  OnlineReconstructorOptions options_;
};
std::vector<cv::Mat>* OnlineReconstructing::video_ = nullptr;
geometry::Camera* OnlineReconstructing::camera_ = nullptr;

TEST_F(OnlineReconstructing, GrowsWithTheKeyFramesOfAVideo) {
  OnlineReconstructor online(options_);
  std::vector<int> changes;
  OnlineResult last;
  for (int i = 0; i < 14; ++i) {
    const OnlineResult now = online.process(frame(i));
    EXPECT_GE(now.key_frames, last.key_frames);
    EXPECT_GE(now.registered, last.registered);
    if (now.model_changed) changes.push_back(i);
    last = now;
  }
  EXPECT_GE(changes.size(), 2U);
  EXPECT_LT(changes.size(), 7U) << "a growth after every third key frame";
  EXPECT_GT(last.points, 100);
  EXPECT_GT(last.tracked.size(), 30U);
  const auto json = to_json(last);
  EXPECT_EQ(json.dump(), nlohmann::ordered_json({{"key_frames", last.key_frames},
                                                 {"registered", last.registered},
                                                 {"points", last.points},
                                                 {"followed", last.tracked.size()}})
                             .dump());
  const OnlineResult end = online.finish();
  EXPECT_EQ(end.registered, static_cast<int>(online.inputs().size()));
  EXPECT_EQ(end.key_frames, end.registered);
  EXPECT_EQ(online.model().points.size(), static_cast<std::size_t>(end.points));
  EXPECT_GT(end.growth_ms, 0);
  for (const Input& input : online.inputs()) {
    EXPECT_EQ(input.path, path("frames/" + input.name));
    EXPECT_FALSE(read_image(input.path).empty());
  }
}

TEST_F(OnlineReconstructing, TracksThePointsOfTheModelInTheFrame) {
  options_.every_frame = true;
  options_.grow_every = 2;
  OnlineReconstructor online(options_);
  for (int i = 0; i < 5; ++i) (void)online.process(frame(2 * i));
  // The frame is the latest image of the model: the points are at its features.
  const OnlineResult now = online.process(frame(10));
  ASSERT_TRUE(now.model_changed);
  ASSERT_EQ(now.registered, 6);
  const Image& image = online.model().images.back();
  ASSERT_GT(now.tracked.size(), 30U);
  for (const cv::Point2f& point : now.tracked) {
    double nearest = 1e9;
    for (std::size_t f = 0; f < image.points.size(); ++f)
      if (image.points[f] >= 0) nearest = std::min(nearest, cv::norm(image.features[f] - point));
    EXPECT_LT(nearest, 0.05);
  }
  // The camera moves to the right by one step: the points move to the left.
  const OnlineResult next = online.process(frame(11));
  ASSERT_GT(next.tracked.size(), 20U);
  const auto mean_x = [](const OnlineResult& result) {
    double sum = 0;
    for (const cv::Point2f& point : result.tracked) sum += point.x;
    return sum / static_cast<double>(result.tracked.size());
  };
  EXPECT_LT(mean_x(next), mean_x(now) - 2);
  // After a global adjustment, the model differs, but has the same images.
  const Eigen::Vector3d before = online.model().images.back().pose.center();
  const OnlineResult refined = online.refine();
  EXPECT_TRUE(refined.model_changed);
  EXPECT_GE(refined.registered, 6);
  EXPECT_NE(online.model().images.back().pose.center(), before);
}

TEST_F(OnlineReconstructing, ExistingImagesAreNotWritten) {
  options_.every_frame = true;
  options_.frames_folder.clear();
  for (int i = 0; i < 3; ++i) {
    const std::string name = std::to_string(i) + ".png";
    write_image(path(name), (*video_)[static_cast<std::size_t>(2 * i)]);
    options_.images.push_back({"image-" + name, path(name)});
  }
  OnlineReconstructor online(options_);
  const std::size_t before = files();
  for (int i = 0; i < 3; ++i)
    (void)online.process(frame(2 * i, options_.images[static_cast<std::size_t>(i)].path));
  EXPECT_EQ(online.finish().registered, 3);
  EXPECT_EQ(files(), before);
  EXPECT_EQ(online.inputs()[1].name, "image-1.png");
  EXPECT_EQ(online.model().images[1].name, "image-1.png");
}

TEST_F(OnlineReconstructing, EndsEarlyWhenStopped) {
  std::stop_source stop;
  stop.request_stop();
  OnlineReconstructor online(options_);
  for (int i = 0; i < 8; ++i) (void)online.process(frame(i), stop.get_token());
  EXPECT_GE(online.inputs().size(), 3U) << "key frames are kept";
  EXPECT_EQ(online.finish(stop.get_token()).registered, 0);
}

TEST_F(OnlineReconstructing, OptionsAreChecked) {
  EXPECT_NO_THROW(options_.check());
  options_.grow_every = 0;
  EXPECT_THROW(OnlineReconstructor{options_}, std::invalid_argument);
  options_.grow_every = 3;
  options_.frames_folder.clear();
  EXPECT_THROW(options_.check(), std::invalid_argument) << "nowhere to keep key frames";
  options_.images = {{"a.png", "a.png"}};
  EXPECT_THROW(options_.check(), std::invalid_argument) << "images, but not each a key frame";
  options_.every_frame = true;
  EXPECT_NO_THROW(options_.check());
}

}  // namespace
}  // namespace tarsier::sfm
