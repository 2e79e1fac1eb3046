// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/testing_relief.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

class Reconstructing : public ReliefFolderTest {
 protected:
  void SetUp() override {
    ReliefFolderTest::SetUp();
    std::string positions = "name,x,y,z\n";
    for (int i = 0; i < kImages; ++i) {
      const Eigen::Vector3d center = scene_->pose(i).center();
      positions += fmt::format("{}.png,{},{},{}\n", i, center[0], center[1], center[2]);
    }
    write_file_atomically(path("positions.csv"), positions);
    options_.pipeline.camera = scene_->camera();
    options_.pipeline.features.max_count = 450;
    options_.folder = path("model");
  }

  [[nodiscard]] ReconstructorResult run(const ReconstructorHooks& hooks = {},
                                        const std::stop_token& stop = {}) const {
    NoProgress progress;
    return Reconstructor(options_).run({path("images")}, progress, stop, hooks);
  }
  [[nodiscard]] bool has(const std::string& name) const { return fs::exists(path(name)); }
  [[nodiscard]] nlohmann::json report() const {
    return nlohmann::json::parse(contents(path("model/report.json")));
  }

  ReconstructorOptions options_;
};

TEST_F(Reconstructing, WritesAPlacedModelAndItsDerivedFiles) {
  options_.placement.alignment = Alignment::kPositions;
  options_.placement.positions_file = path("positions.csv");
  options_.turntable = options_.undistorted = options_.match_images = true;
  int calls = 0;
  ReconstructorHooks hooks;
  hooks.on_models = [&](const ReconstructorResult& result) {
    ++calls;
    EXPECT_EQ(result.models().size(), 1U);
    EXPECT_TRUE(has("model/view.html"));
    EXPECT_FALSE(has("model/turntable.gif")) << "comes later";
  };
  const ReconstructorResult result = run(hooks);
  EXPECT_EQ(calls, 1);
  ASSERT_EQ(result.models().size(), 1U);
  EXPECT_EQ(result.placement_error, "");
  for (const char* name : {"cameras.txt", "images.txt", "points3D.txt", "points.ply", "cameras.ply",
                           "view.html", "view.png", "turntable.gif",
                           "undistorted/sparse/points3D.txt", "undistorted/images/0.png"}) {
    EXPECT_TRUE(has(fmt::format("model/{}", name))) << name;
  }
  EXPECT_GE(std::distance(fs::directory_iterator(path("model/matches")), fs::directory_iterator()),
            kImages - 1);
  EXPECT_FALSE(fs::is_empty(path("model/cache")));

  // The file equals to_json(), and the model on disk is the placed one.
  const nlohmann::json written = report();
  EXPECT_EQ(written, nlohmann::json::parse(to_json(result).dump()));
  EXPECT_EQ(written["placed"]["aligned"]["images"], kImages);
  const Model read = read_colmap(path("model"));
  ASSERT_EQ(read.images.size(), static_cast<std::size_t>(kImages));
  for (int i = 0; i < kImages; ++i) {
    EXPECT_LT(
        (read.images[static_cast<std::size_t>(i)].pose.center() - scene_->pose(i).center()).norm(),
        0.1)
        << i;
  }
}

TEST_F(Reconstructing, ImagesOfMatchesHaveTheirOwnNames) {
  options_.match_images = true;
  // Names that are long, equal at their beginning, and not UTF-8.
  const std::string long_name(200, 'n');
  fs::rename(path("images/0.png"), path("images/" + long_name + "0.png"));
  fs::rename(path("images/1.png"), path("images/" + long_name + "1\xE9.png"));
  // One image of matches cannot be written.
  const std::string blocked = "model/matches/2-3-0-1.jpg";
  fs::create_directories(path(blocked));
  const ReconstructorResult result = run();
  ASSERT_EQ(result.models().size(), 1U);
  EXPECT_TRUE(fs::is_directory(path(blocked)));
  int matched = 0;
  for (const Pair& pair : result.pipeline.pairs) matched += pair.matches > 0 ? 1 : 0;
  EXPECT_EQ(std::distance(fs::directory_iterator(path("model/matches")), fs::directory_iterator()),
            matched);
  EXPECT_EQ(report()["images"].size(), static_cast<std::size_t>(kImages));
}

TEST_F(Reconstructing, ExportsTheCamerasOfTheModel) {
  options_.database = true;
  options_.pipeline.shared_camera = false;
  (void)run();
  const ColmapDatabase database = read_colmap_database(path("model/database.db"));
  ASSERT_EQ(database.images.size(), static_cast<std::size_t>(kImages));
  EXPECT_EQ(database.cameras.size(), static_cast<std::size_t>(kImages));
  EXPECT_TRUE(database.cameras[2].is_focal_known);
}

TEST_F(Reconstructing, WithoutAFolderWritesNothing) {
  options_.folder.clear();
  const std::size_t before = files();
  const ReconstructorResult result = run();
  ASSERT_EQ(result.models().size(), 1U);
  EXPECT_GT(result.models()[0].points.size(), 100U);
  EXPECT_FALSE(result.interrupted());
  EXPECT_EQ(files(), before);
  EXPECT_EQ(Reconstructor(options_).frames_folder(), "");
}

TEST_F(Reconstructing, AModelThatCannotBePlacedIsWrittenUnchanged) {
  write_image(path("images/blank.png"), cv::Mat(180, 240, CV_8UC3, {120, 120, 120}));
  options_.placement.distance = KnownDistance{"0.png", "blank.png", 3};
  const ReconstructorResult result = run();
  EXPECT_EQ(
      result.placement_error,
      "the known distance: 'blank.png' is not in the model; the model is written without scaling");
  EXPECT_FALSE(result.placement.scale);
  EXPECT_TRUE(has("model/points3D.txt"));
  EXPECT_TRUE(has("model/view.png"));
  EXPECT_EQ(report()["not_placed"], result.placement_error);
  EXPECT_FALSE(report().contains("placed"));
}

TEST_F(Reconstructing, ChecksBeforeTheWork) {
  const auto nothing_done = [&] {
    return !has("model/cache") || fs::is_empty(path("model/cache"));
  };
  options_.placement.distance = KnownDistance{"0.png", "nobody.png", 3};
  EXPECT_THROW((void)run(), UsageError);
  EXPECT_TRUE(nothing_done());
  options_.placement = {};
  options_.pipeline.pairs = PairChoice::kList;
  options_.pipeline.pairs_file = path("pairs.txt");
  write_file_atomically(path("pairs.txt"), "0.png nobody.png\n");
  EXPECT_THROW((void)run(), InputError);
  EXPECT_TRUE(nothing_done());
  options_.pipeline.pairs = PairChoice::kAuto;
  options_.placement.alignment = Alignment::kPositions;
  options_.placement.positions_file = path("missing.csv");
  EXPECT_THROW((void)run(), InputError);
  options_.placement = {};
  options_.folder = path("positions.csv");  // a file
  EXPECT_THROW((void)run(), OutputError);
  EXPECT_THROW(Reconstructor(options_).check_outputs(), OutputError);

  fs::create_directories(path("theirs"));
  options_.folder = path("theirs");
  write_file_atomically(path("theirs/frames.txt"), "");
  EXPECT_THROW(Reconstructor(options_).check_outputs(), OutputError);

  NoProgress progress;
  options_.folder = path("model");
  const Reconstructor one(options_);
  EXPECT_THROW((void)one.run({path("images/0.png")}, progress, {}), InputError);
  EXPECT_THROW((void)one.run_images({}, progress, {}), InputError);
  EXPECT_THROW((void)one.run({}, progress, {}), std::invalid_argument);
  EXPECT_TRUE(nothing_done());
}

TEST_F(Reconstructing, AnInterruptedRunKeepsAFinishedModel) {
  ASSERT_FALSE(run().models().empty());
  const std::string images = contents(path("model/images.txt"));
  const std::string written = contents(path("model/report.json"));
  // Again with another number of features, so that mapping repeats; it is stopped on the way.
  options_.pipeline.features.max_count = 400;
  std::stop_source stop;
  ReconstructorHooks hooks;
  hooks.watch = [&](const std::string& label, const Model&) {
    if (label == "grown-002-after") stop.request_stop();
  };
  const ReconstructorResult result = run(hooks, stop.get_token());
  EXPECT_TRUE(result.interrupted());
  EXPECT_TRUE(result.kept_earlier_model);
  EXPECT_FALSE(result.models().empty());
  EXPECT_EQ(contents(path("model/images.txt")), images);
  EXPECT_EQ(contents(path("model/report.json")), written);

  // If there is no finished model, the current model is written.
  fs::remove_all(path("model"));
  std::stop_source again;
  hooks.watch = [&](const std::string& label, const Model&) {
    if (label == "grown-002-after") again.request_stop();
  };
  EXPECT_FALSE(run(hooks, again.get_token()).kept_earlier_model);
  EXPECT_EQ(report()["partial"], true);
  EXPECT_TRUE(has("model/points3D.txt"));
}

TEST_F(Reconstructing, ResumesFromItsCache) {
  (void)run();
  const std::string images = contents(path("model/images.txt"));
  const ReconstructorResult again = run();
  EXPECT_EQ(again.pipeline.from_cache, kImages + kImages * (kImages - 1) / 2);
  EXPECT_EQ(contents(path("model/images.txt")), images);
  options_.cache = false;
  EXPECT_EQ(Reconstructor(options_).pipeline().cache_folder, "");
}

TEST(ReconstructorOptions, AreChecked) {
  ReconstructorOptions options;
  EXPECT_NO_THROW(options.check());
  options.turntable = true;
  EXPECT_THROW(options.check(), std::invalid_argument) << "no folder";
  options = {};
  options.pipeline.camera = geometry::Camera{};
  options.pipeline.camera->lens = geometry::Lens::kFisheye;
  EXPECT_THROW(Reconstructor{options}, std::invalid_argument);
  options = {};
  options.placement.distance = KnownDistance{"a", "a", 1};
  EXPECT_THROW(Reconstructor{options}, std::invalid_argument);
  options = {};
  options.keyframes.window = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

TEST(ReconstructorOptions, FollowTheKindOfFeatures) {
  PipelineOptions options;
  use_features(options, FeatureKind::kSift);
  EXPECT_EQ(options.matching.ratio, PipelineOptions().matching.ratio);
  use_features(options, FeatureKind::kOrb);
  EXPECT_EQ(options.features.kind, FeatureKind::kOrb);
  EXPECT_EQ(options.matching.ratio, 0.85);
  EXPECT_EQ(options.mapper.extend_similarity, 0.6);
  options.matching.ratio = 0.9;  // set by the user
  use_features(options, FeatureKind::kAkaze);
  EXPECT_EQ(options.matching.ratio, 0.9);
}

}  // namespace
}  // namespace tarsier::sfm
