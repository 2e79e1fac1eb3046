// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/pipeline.h"

#include "tarsier/core/testing_long.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/report.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/sensor_image.h"
#include "tarsier/sfm/scene/testing_exif.h"
#include "tarsier/synth/sfm_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <tuple>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

class PipelineTest : public FolderTest {
 protected:
  // Renders images of a scene into the folder, and appends their ground truth to truth_.
  std::vector<Input> shoot(const synth::SceneOptions& options, const std::string& prefix = "") {
    const synth::SfmScene scene(options);
    camera_ = scene.camera();
    // Drawn once for all tests.
    static std::map<std::tuple<int, std::uint64_t, synth::Content, bool, double>,
                    std::vector<cv::Mat>>
        drawn;
    std::vector<cv::Mat>& images = drawn[{options.images, options.seed, options.content,
                                          options.pure_rotation, options.focal_px}];
    std::vector<Input> inputs;
    for (int i = 0; i < scene.count(); ++i) {
      const std::string name = prefix + std::to_string(i) + ".png";
      if (static_cast<int>(images.size()) == i) images.push_back(scene.render(i));
      write_image(folder_ + "/" + name, images[static_cast<std::size_t>(i)]);
      inputs.push_back({name, folder_ + "/" + name});
      truth_[name] = scene.pose(i);
    }
    return inputs;
  }

  [[nodiscard]] PipelineOptions options() const {
    PipelineOptions options;
    options.camera = camera_;
    options.features.max_count = 700;
    return options;
  }

  static PipelineResult run(const std::vector<Input>& inputs, const PipelineOptions& options) {
    NoProgress progress;
    return run_pipeline(inputs, options, progress, {});
  }

  geometry::Camera camera_;
  PoseTruth truth_;
};

synth::SceneOptions small_scene(int images = 5) {
  synth::SceneOptions options;
  options.size = {400, 300};
  options.images = images;
  return options;
}

TEST_F(PipelineTest, RecoversCameraPoses) {
  const auto inputs = shoot(small_scene(6));
  PipelineOptions how = options();
  how.features.max_count = 1500;
  const PipelineResult result = run(inputs, how);
  ASSERT_EQ(result.reconstruction.models.size(), 1U);
  const PoseScores scores = evaluate_poses(result.reconstruction.models[0], truth_, "model");
  EXPECT_EQ(scores.registered, 6);
  EXPECT_LT(scores.center_mean, 0.003 * scores.extent);
  EXPECT_LT(scores.rotation_mean_deg, 0.1);
  EXPECT_GT(result.reconstruction.models[0].points.size(), 200U);
  const auto report = report_json(result);
  const double stated = report["models"][0]["center_sigma_percent"].get<double>();
  EXPECT_GT(stated, 100 * scores.center_mean / scores.extent / 4);
  EXPECT_LT(stated, 100 * scores.center_mean / scores.extent * 4);
  EXPECT_LE(report["images"][2]["center_sigma_percent"].get<double>(),
            report["models"][0]["center_sigma_worst_percent"].get<double>());
}

TEST_F(PipelineTest, ResultDoesNotDependOnThreadsAndCache) {
  const auto inputs = shoot(small_scene());
  PipelineOptions how = options();
  cv::setNumThreads(1);
  const Model one = run(inputs, how).reconstruction.models.at(0);
  cv::setNumThreads(3);
  how.cache_folder = folder_;
  const Model three = run(inputs, how).reconstruction.models.at(0);
  how.memory_gb = 100;  // nothing has to leave memory
  const PipelineResult again = run(inputs, how);
  cv::setNumThreads(-1);
  EXPECT_EQ(again.from_cache, 5 + 10);
  for (const Model* other : {&three, &again.reconstruction.models.at(0)}) {
    ASSERT_EQ(other->points.size(), one.points.size());
    for (std::size_t i = 0; i < one.images.size(); ++i)
      EXPECT_EQ(other->images[i].pose.center(), one.images[i].pose.center());
  }
}

TEST_F(PipelineTest, RecomputesDamagedCache) {
  const auto inputs = shoot(small_scene(3));
  PipelineOptions how = options();
  how.cache_folder = folder_ + "/cache";
  fs::create_directory(how.cache_folder);
  const Model first = run(inputs, how).reconstruction.models.at(0);
  int damaged = 0;
  for (const auto& entry : fs::directory_iterator(how.cache_folder)) {
    if (++damaged % 2 == 0) {
      fs::resize_file(entry.path(), fs::file_size(entry.path()) / 2);
    } else {
      std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
      file.seekp(200);
      file.put('!');
    }
  }
  EXPECT_GE(damaged, 4);
  const PipelineResult again = run(inputs, how);
  EXPECT_EQ(again.from_cache, 0);
  EXPECT_EQ(again.reconstruction.models.at(0).points.size(), first.points.size());
}

// A box whose four sides look alike. Its features alone fold it onto one or two sides.
TEST_F(PipelineTest, DetailsDistinguishSimilarSides) {
  TARSIER_LONG_TEST();
  synth::SceneOptions scene;
  scene.content = synth::Content::kSymmetric;
  scene.trajectory = synth::Trajectory::kRing;
  scene.size = {480, 360};
  scene.focal_px = 840;
  scene.images = 24;
  scene.details = 0.1;
  const auto inputs = shoot(scene);
  PipelineOptions how = options();
  how.features.max_count = 4000;
  const PipelineResult result = run(inputs, how);
  const Reconstruction& built = result.reconstruction;
  int registered = 0;
  for (std::size_t m = 0; m < built.models.size(); ++m) {
    if (built.trust[m] < 0.5) continue;
    const PoseScores score = evaluate_poses(built.models[m], truth_, "truth");
    registered += score.registered;
    EXPECT_LT(score.center_mean, 0.005 * score.extent);
  }
  EXPECT_GE(registered, 20);
  EXPECT_TRUE(std::any_of(built.refused.begin(), built.refused.end(),
                          [](const RefusedPair& pair) { return pair.patches_differ; }));
}

// Nothing is known of the lens. The pairs are verified with a guessed focal length, and still agree
// with the model.
TEST_F(PipelineTest, TrustsModelWithUnknownLens) {
  synth::SceneOptions scene = small_scene(8);
  scene.focal_px = 800;
  const auto inputs = shoot(scene, "long");
  PipelineOptions how = options();
  how.camera.reset();
  const PipelineResult result = run(inputs, how);
  ASSERT_EQ(result.reconstruction.models.size(), 1U);
  EXPECT_NEAR(result.reconstruction.models[0].cameras[0].fx, 800, 15);
  EXPECT_GT(result.reconstruction.trust[0], 0.95);
  EXPECT_THAT(result.reconstruction.log.front(), HasSubstr("focal length of camera 0"));
  EXPECT_EQ(result.images[0].focal_from, "pairs");
}

// Cameras that face one place from all sides determine the focal length badly. The model's value is
// better.
TEST_F(PipelineTest, TrustsModelWithAdoptedFocalLength) {
  TARSIER_LONG_TEST();
  struct Case {
    int images;
    std::uint64_t seed;
    double focal_px;
    const char* line;
  };
  for (const Case& given : {Case{8, 30, 240, "the images are mapped again with it"},
                            Case{5, 45, 420, "the pairs are evaluated again with it"},
                            Case{8, 35, 320, "initial pair"}, Case{8, 31, 320, "initial pair"}}) {
    synth::SceneOptions scene = small_scene(given.images);
    scene.trajectory = synth::Trajectory::kRing;
    scene.seed = given.seed;
    scene.focal_px = given.focal_px;
    const auto inputs = shoot(scene, "ring");
    PipelineOptions how = options();
    how.camera.reset();
    how.features.max_count = 3000;
    const Reconstruction result = run(inputs, how).reconstruction;
    ASSERT_EQ(result.models.size(), 1U);
    EXPECT_NEAR(result.models[0].cameras[0].fx, given.focal_px, 0.02 * given.focal_px);
    EXPECT_THAT(result.log, testing::Contains(HasSubstr(given.line)));
    EXPECT_GT(result.trust[0], 0.9);
  }
}

TEST_F(PipelineTest, TwoScenesGiveTwoModels) {
  auto inputs = shoot(small_scene(4), "a");
  synth::SceneOptions other = small_scene(3);
  other.seed = 77;
  for (const Input& input : shoot(other, "b")) inputs.push_back(input);
  const PipelineResult result = run(inputs, options());
  ASSERT_EQ(result.reconstruction.models.size(), 2U);
  const auto report = report_json(result);
  EXPECT_EQ(report["models"][0]["images"], 4);
  EXPECT_EQ(report["models"][1]["images"], 3);
  EXPECT_EQ(report["images"][5]["model"], 1);
}

TEST_F(PipelineTest, ReportsUnreadableImage) {
  auto inputs = shoot(small_scene(4));
  const std::string broken = folder_ + "/broken.jpg";
  std::ofstream(broken) << "not an image";
  inputs.insert(inputs.begin() + 1, {"broken.jpg", broken});
  const PipelineResult result = run(inputs, options());
  ASSERT_EQ(result.reconstruction.models.size(), 1U);
  EXPECT_FALSE(result.images[1].read);
  EXPECT_THAT(summary_text(result), HasSubstr("not registered: broken.jpg: "));
  EXPECT_TRUE(result.images[2].outcome.registered);
}

TEST_F(PipelineTest, DegenerateScenesGiveReasonAndNoModel) {
  struct Case {
    synth::Content content;
    bool rotation;
  };
  for (const Case& given :
       {Case{synth::Content::kRelief, true}, Case{synth::Content::kNothing, false}}) {
    synth::SceneOptions scene = small_scene(3);
    scene.content = given.content;
    scene.pure_rotation = given.rotation;
    const auto inputs = shoot(scene);
    const PipelineResult result = run(inputs, options());
    EXPECT_TRUE(result.reconstruction.models.empty());
    EXPECT_FALSE(result.reconstruction.no_model.empty());
    for (const ImageReport& report : result.images) EXPECT_FALSE(report.outcome.reason.empty());
  }
}

TEST_F(PipelineTest, RejectsPairOfIdenticalImages) {
  auto inputs = shoot(small_scene(1));
  inputs.push_back({"copy.png", inputs[0].path});
  const PipelineResult result = run(inputs, options());
  EXPECT_TRUE(result.reconstruction.models.empty());
  EXPECT_THAT(result.reconstruction.no_model, HasSubstr("sideways"));
}

TEST_F(PipelineTest, TrackedPointsAreAsAccurateAsDescriptors) {
  TARSIER_LONG_TEST();
  // A video: the camera moves little from frame to frame.
  const auto inputs = shoot(small_scene(11));
  PipelineOptions how = options();
  const PipelineResult by_sift = run(inputs, how);
  how.flow = true;
  const PipelineResult by_flow = run(inputs, how);
  ASSERT_FALSE(by_sift.reconstruction.models.empty());
  ASSERT_FALSE(by_flow.reconstruction.models.empty());
  const PoseScores sift = evaluate_poses(by_sift.reconstruction.models[0], truth_, "sift");
  const PoseScores flow = evaluate_poses(by_flow.reconstruction.models[0], truth_, "flow");
  EXPECT_EQ(flow.registered, 11);
  EXPECT_LT(flow.center_mean, 2 * sift.center_mean + 1e-3 * sift.extent);
}

TEST_F(PipelineTest, CachesTrackedPoints) {
  auto inputs = shoot(small_scene(5));
  PipelineOptions how = options();
  how.features.max_count = 600;
  how.flow = true;
  const Model without = run(inputs, how).reconstruction.models.at(0);
  how.cache_folder = folder_ + "/cache";
  fs::create_directory(how.cache_folder);
  EXPECT_EQ(run(inputs, how).from_cache, 0);
  // Everything except the checkpoint, so that the mapper uses data that is read.
  for (const auto& entry : fs::directory_iterator(how.cache_folder))
    if (entry.path().extension() == ".mapper") fs::remove(entry.path());
  const PipelineResult again = run(inputs, how);
  EXPECT_EQ(again.from_cache, 5 + again.compared);
  EXPECT_EQ(again.resumed, 0);
  const Model& with = again.reconstruction.models.at(0);
  ASSERT_EQ(with.points.size(), without.points.size());
  for (std::size_t i = 0; i < with.images.size(); ++i)
    EXPECT_EQ(with.images[i].pose.center(), without.images[i].pose.center());
  // Another sequence is another one.
  inputs.pop_back();
  EXPECT_EQ(run(inputs, how).from_cache, 0);
}

TEST_F(PipelineTest, TrackedPointsOfAStartModelsImagesAreCachedApart) {
  const auto inputs = shoot(small_scene(5));
  PipelineOptions how = options();
  how.features.max_count = 600;
  how.flow = true;
  const auto features_of = [](const PipelineResult& result) {
    std::vector<int> counts;
    for (const ImageReport& report : result.images)
      if (report.read) counts.push_back(report.features);
    return counts;
  };
  const PipelineResult all = run(inputs, how);
  // A start model of the last four images; the second of these has another size in the model.
  Model start = all.reconstruction.models.at(0);
  start.images.erase(start.images.begin());
  start.points.clear();
  for (Image& image : start.images) std::fill(image.points.begin(), image.points.end(), -1);
  start.cameras.push_back(start.cameras[0]);
  start.cameras[1].width /= 2;
  start.images[1].camera = 1;
  fs::create_directory(folder_ + "/start");
  write_colmap(folder_ + "/start", start);
  PipelineOptions subset = how;
  subset.start_model = folder_ + "/start";
  subset.only_start = true;
  const PipelineResult expected = run(inputs, subset);
  EXPECT_FALSE(expected.images[0].read);
  EXPECT_FALSE(expected.images[2].read);
  EXPECT_EQ(features_of(expected), features_of(run({inputs[1], inputs[3], inputs[4]}, how)))
      << "images that are left out are not tracked";

  how.cache_folder = subset.cache_folder = folder_ + "/cache";
  fs::create_directory(how.cache_folder);
  EXPECT_EQ(features_of(run(inputs, subset)), features_of(expected));
  EXPECT_EQ(features_of(run(inputs, how)), features_of(all));
  EXPECT_EQ(features_of(run(inputs, subset)), features_of(expected));
}

TEST_F(PipelineTest, ResumesMapperFromCheckpoint) {
  const auto inputs = shoot(small_scene(6));
  PipelineOptions how = options();
  how.cache_folder = folder_ + "/cache";
  how.checkpoint_s = 0;
  fs::create_directory(how.cache_folder);
  // Stopped when the fourth image is in.
  struct StopAt final : Progress {
    std::stop_source stop;
    bool mapping = false;
    std::int64_t done = 0;
    void begin(std::string_view stage, std::int64_t, std::string_view) override {
      mapping = stage == "reconstruct";
    }
    void advance(std::int64_t count) override {
      done += mapping ? count : 0;
      if (done >= 4) stop.request_stop();
    }
    void end() override {}
  } progress;
  PipelineHooks hooks;
  hooks.partial = true;
  const PipelineResult part = run_pipeline(inputs, how, progress, progress.stop.get_token(), hooks);
  EXPECT_TRUE(part.reconstruction.interrupted);
  EXPECT_EQ(statistics_of(part.reconstruction.models.at(0)).registered, 4);
  EXPECT_EQ(report_json(part)["partial"], true);

  const PipelineResult rest = run(inputs, how);
  EXPECT_EQ(rest.resumed, 4);
  EXPECT_FALSE(report_json(rest).contains("partial"));
  how.cache_folder.clear();
  const PipelineResult whole = run(inputs, how);
  EXPECT_EQ(rest.reconstruction.log, whole.reconstruction.log);
  const Model& a = rest.reconstruction.models.at(0);
  const Model& b = whole.reconstruction.models.at(0);
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.images.size(); ++i)
    EXPECT_EQ(a.images[i].pose.translation, b.images[i].pose.translation);

  // With other options it begins again, and one checkpoint is kept.
  how.cache_folder = folder_ + "/cache";
  how.mapper.reprojection_px = 2.5;
  EXPECT_EQ(run(inputs, how).resumed, 0);
  EXPECT_EQ(run(inputs, how).resumed, 6);
  int checkpoints = 0;
  for (const auto& entry : fs::directory_iterator(how.cache_folder))
    checkpoints += entry.path().extension() == ".mapper" ? 1 : 0;
  EXPECT_EQ(checkpoints, 1);
}

// A camera held upright writes the same pixels, and an orientation tag.
TEST_F(PipelineTest, OrientationsShareLensAndGiveSameModel) {
  const synth::SfmScene scene(small_scene(6));
  const auto shot = [&](const std::string& prefix, const std::vector<int>& orientations) {
    std::vector<Input> inputs;
    for (int i = 0; i < scene.count(); ++i) {
      const int orientation = orientations[static_cast<std::size_t>(i)];
      cv::Mat pixels = scene.render(i);
      if (orientation == 2 || orientation == 4 || orientation == 5 || orientation == 7)
        cv::flip(pixels, pixels, 1);
      const std::string name = prefix + std::to_string(i) + ".jpg";
      inputs.push_back({name, path(name)});
      auto bytes = encode_image(".jpg", pixels, name, 95);
      if (orientation > 0) bytes = with_orientation(bytes, orientation);
      write_file_atomically(inputs.back().path, std::span<const std::uint8_t>(bytes));
      truth_[name] = scene.pose(i);
    }
    return inputs;
  };
  camera_ = scene.camera();
  const auto scores_of = [&](const PipelineResult& result) {
    return evaluate_poses(result.reconstruction.models.at(0), truth_, "model");
  };
  const PipelineResult plain = run(shot("plain", {0, 0, 0, 0, 0, 0}), options());
  const PipelineResult turned = run(shot("turned", {6, 1, 8, 3, 6, 6}), options());
  const PipelineResult mirrored = run(shot("mirrored", {6, 2, 4, 5, 7, 1}), options());
  const PoseScores expected = scores_of(plain);
  ASSERT_EQ(expected.registered, 6);
  for (const PipelineResult* result : {&turned, &mirrored}) {
    const Model& model = result->reconstruction.models.at(0);
    EXPECT_EQ(model.cameras.size(), 1U);
    EXPECT_EQ(cv::Size(model.cameras[0].width, model.cameras[0].height), cv::Size(400, 300));
    EXPECT_EQ(scores_of(*result).registered, 6);
    EXPECT_NEAR(scores_of(*result).center_mean, expected.center_mean, 1e-3 * expected.extent);
  }
  EXPECT_EQ(turned.reconstruction.models[0].points.size(),
            plain.reconstruction.models[0].points.size());
  EXPECT_NEAR(scores_of(turned).center_mean, expected.center_mean, 1e-9);
  // y points down in the images as displayed.
  const Model& model = turned.reconstruction.models[0];
  EXPECT_EQ(model.images[0].turns, 1);
  Eigen::Vector3d down = Eigen::Vector3d::Zero();
  for (const Image& image : model.images)
    down += image.pose.rotation.transpose() * down_direction(image.turns);
  EXPECT_GT(down.normalized().y(), 1 - 1e-9);
}

TEST_F(PipelineTest, SimulatedViewsAreCached) {
  const auto inputs = shoot(small_scene(3));
  PipelineOptions how = options();
  how.features.max_count = 300;
  const Model plain = run(inputs, how).reconstruction.models.at(0);
  how.features.wide = true;
  const Model one = run(inputs, how).reconstruction.models.at(0);
  how.cache_folder = folder_ + "/cache";
  fs::create_directory(how.cache_folder);
  (void)run(inputs, how);
  // Matches again with cached features.
  for (const auto& entry : fs::directory_iterator(how.cache_folder))
    if (entry.path().extension() != ".features") fs::remove(entry.path());
  const PipelineResult again = run(inputs, how);
  EXPECT_EQ(again.from_cache, 3);
  const Model& model = again.reconstruction.models.at(0);
  EXPECT_GT(model.points.size(), plain.points.size());
  ASSERT_EQ(model.points.size(), one.points.size());
  for (std::size_t i = 0; i < model.images.size(); ++i)
    EXPECT_EQ(model.images[i].pose.center(), one.images[i].pose.center());
  // No track has two features at the same position of an image, and none has an additional
  // descriptor.
  for (const Point& point : model.points)
    for (const Observation& seen : point.track)
      EXPECT_LT(static_cast<std::size_t>(seen.feature),
                model.images[static_cast<std::size_t>(seen.image)].features.size());
  how.features.wide = false;
  EXPECT_EQ(run(inputs, how).from_cache, 0) << "others without the views";
  how.features.wide = true;
  how.flow = true;
  EXPECT_THROW((void)run(inputs, how), std::invalid_argument);
}

TEST_F(PipelineTest, CanBeInterrupted) {
  const auto inputs = shoot(small_scene(2));
  std::stop_source stop;
  stop.request_stop();
  NoProgress progress;
  EXPECT_ANY_THROW((void)run_pipeline(inputs, options(), progress, stop.get_token()));
}

}  // namespace
}  // namespace tarsier::sfm
