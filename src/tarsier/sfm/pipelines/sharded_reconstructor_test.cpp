// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/sharded_reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/pipelines/model_merger.h"
#include "tarsier/sfm/pipelines/shard_commands.h"
#include "tarsier/sfm/pipelines/testing_relief.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/colmap_binary.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

class Sharded : public ReliefFolderTest {
 protected:
  void SetUp() override {
    ReliefFolderTest::SetUp();
    options_.camera = scene_->camera();
    options_.features.max_count = 300;
  }

  [[nodiscard]] std::vector<Input> inputs() {
    return find_inputs({path("images")}, {}, "", progress_, {});
  }
  void plan(int shards, int cluster_size = 0) {
    (void)write_plan(path("work"), inputs(), options_, shards, progress_, {}, cluster_size);
  }
  // A plan of two clusters, mapped.
  void map_clusters(const ShardedReconstructor& sharded) {
    find_all(sharded);
    match_all(sharded);
    for (int k = sharded.plan().clusters(); k >= 1; --k) (void)map_cluster(sharded, k);
  }
  ShardReport map_cluster(const ShardedReconstructor& sharded, int cluster) {
    ReconstructorOptions options;
    options.cache = false;
    return sharded.map_cluster(cluster, options, progress_, {});
  }
  [[nodiscard]] ReconstructorResult merge(const ShardedReconstructor& sharded,
                                          const std::string& folder) {
    ReconstructorOptions options;
    options.folder = path(folder);
    options.cache = false;
    return sharded.merge(options, progress_, {});
  }
  void find_all(const ShardedReconstructor& sharded) {
    for (int k = sharded.plan().shards; k >= 1; --k) (void)sharded.find_features(k, progress_, {});
  }
  void match_all(const ShardedReconstructor& sharded) {
    for (int k = sharded.plan().shards; k >= 1; --k) (void)sharded.match(k, progress_, {});
  }
  [[nodiscard]] ReconstructorResult map(const ShardedReconstructor& sharded,
                                        const std::string& folder) {
    ReconstructorOptions options;
    options.folder = path(folder);
    options.cache = false;
    return sharded.map(options, progress_, {});
  }
  void expect_same_as_whole(const std::string& folder) {
    ReconstructorOptions options;
    options.pipeline = options_;
    options.folder = path("whole");
    options.cache = false;
    (void)Reconstructor(options).run_images(inputs(), progress_, {});
    for (const std::string file : {"cameras.txt", "images.txt", "points3D.txt", "points.ply"})
      EXPECT_EQ(contents(path(folder + "/" + file)), contents(path("whole/" + file))) << file;
  }
  // The error of `run` names the command.
  template <class Run>
  void expect_error(const Run& run, const std::string& part) {
    try {
      run();
      ADD_FAILURE() << "expected: " << part;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << error.what();
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
  void change_byte(const std::string& file, std::size_t offset) {
    std::string bytes = contents(file);
    ASSERT_LT(offset, bytes.size());
    bytes[offset] = static_cast<char>(bytes[offset] ^ 1);
    write_file_atomically(file, bytes);
  }

  PipelineOptions options_;
  NoProgress progress_;
};

TEST_F(Sharded, AnyNumberOfShardsGivesTheModelOfOneRun) {
  for (const int shards : {1, 3, 7}) {
    plan(shards);
    const ShardedReconstructor sharded(path("work"));
    find_all(sharded);
    match_all(sharded);
    const std::string folder = fmt::format("model-of-{}", shards);
    const ReconstructorResult result = map(sharded, folder);
    ASSERT_EQ(result.models().size(), 1U);
    EXPECT_EQ(result.pipeline.compared, kImages * (kImages - 1) / 2);
    expect_same_as_whole(folder);
  }
}

TEST_F(Sharded, SimulatedViewsArePartOfThePlan) {
  options_.features.wide = true;
  options_.features.max_count = 150;
  plan(2);
  const ShardedReconstructor sharded(path("work"));
  find_all(sharded);
  match_all(sharded);
  (void)map(sharded, "model");
  expect_same_as_whole("model");
}

TEST_F(Sharded, PairsByRetrievalAreChosenOnceForAllShards) {
  options_.pairs = PairChoice::kRetrieval;
  options_.nearest = 2;
  plan(2);
  const ShardedReconstructor sharded(path("work"));
  EXPECT_TRUE(sharded.has_pairs_stage());
  find_all(sharded);
  EXPECT_FALSE(sharded.choose_pairs(progress_, {}).was_done);
  EXPECT_TRUE(sharded.choose_pairs(progress_, {}).was_done);
  match_all(sharded);
  (void)map(sharded, "model");
  expect_same_as_whole("model");
  fs::remove(path("work/pairs.done"));
  expect_error([&] { (void)map(sharded, "model"); }, "run: tarsier sfm match");
}

TEST_F(Sharded, AListOfPairsIsPartOfThePlan) {
  write_file_atomically(path("list.txt"), "0.png 1.png\n1.png 2.png\n2.png 0.png\n");
  options_.pairs = PairChoice::kList;
  options_.pairs_file = path("list.txt");
  plan(2);
  fs::remove(path("list.txt"));
  const ShardedReconstructor sharded(path("work"));
  find_all(sharded);
  match_all(sharded);
  EXPECT_EQ(map(sharded, "model").pipeline.compared, 3);
  write_file_atomically(path("work/pairs.txt"), "0.png 1.png\n");
  expect_error([&] { (void)read_plan(path("work")); }, "run `tarsier sfm plan` again");
}

TEST_F(Sharded, UnreadableImagesAreLeftOutAsInASingleRun) {
  write_file_atomically(path("images/3-broken.png"), "no image");
  plan(3);
  const ShardedReconstructor sharded(path("work"));
  find_all(sharded);
  match_all(sharded);
  const ReconstructorResult result = map(sharded, "model");
  ASSERT_EQ(result.pipeline.images.size(), kImages + 1U);
  EXPECT_FALSE(result.pipeline.images[3].read);  // 3-broken.png comes before 3.png
  EXPECT_NE(result.pipeline.images[3].outcome.reason, "");
  expect_same_as_whole("model");
}

TEST_F(Sharded, AShardIsRecomputedOnlyIfItsFileIsDamaged) {
  plan(2);
  const ShardedReconstructor sharded(path("work"));
  EXPECT_FALSE(sharded.find_features(1, progress_, {}).was_done);
  EXPECT_TRUE(sharded.find_features(1, progress_, {}).was_done);
  const std::string file = path("work/features-1-of-2");
  const std::string bytes = contents(file);
  const std::string info = contents(file + ".done");
  change_byte(file, bytes.size() - 1);
  EXPECT_FALSE(sharded.find_features(1, progress_, {}).was_done);
  EXPECT_EQ(contents(file), bytes);
  fs::remove(file + ".done");  // as after a kill
  EXPECT_FALSE(sharded.find_features(1, progress_, {}).was_done);
  EXPECT_EQ(contents(file), bytes);
  EXPECT_EQ(contents(file + ".done"), info);
}

TEST_F(Sharded, ErrorsNameTheCommandThatMakesTheMissingFile) {
  plan(2);
  const ShardedReconstructor sharded(path("work"));
  expect_error([&] { (void)sharded.match(1, progress_, {}); }, "--shard 1/2");
  (void)sharded.find_features(1, progress_, {});
  expect_error([&] { (void)sharded.match(1, progress_, {}); },
               "features-2-of-2: is missing; run: tarsier sfm features");
  (void)sharded.find_features(2, progress_, {});
  (void)sharded.match(2, progress_, {});
  expect_error([&] { (void)map(sharded, "model"); },
               "match-1-of-2: is missing; run: tarsier sfm match");
  (void)sharded.match(1, progress_, {});
  for (const std::string name : {"work/features-2-of-2", "work/match-1-of-2"}) {
    const std::string bytes = contents(path(name));
    write_file_atomically(path(name), bytes.substr(0, bytes.size() / 2));
    expect_error([&] { (void)map(sharded, "model"); }, "is damaged; run: tarsier sfm");
    write_file_atomically(path(name), "");
    expect_error([&] { (void)map(sharded, "model"); }, "is damaged; run: tarsier sfm");
    write_file_atomically(path(name), bytes);
    const std::string info = contents(path(name + ".done"));
    for (const std::string text : {"", "{}", "[1", "{\"shard\":[0,0]}"}) {
      write_file_atomically(path(name + ".done"), text);
      expect_error([&] { (void)map(sharded, "model"); }, "run: tarsier sfm");
    }
    write_file_atomically(path(name + ".done"), info);
  }
  EXPECT_EQ(map(sharded, "model").models().size(), 1U);
}

TEST_F(Sharded, ShardsOfAnotherPlanAreRefused) {
  plan(2);
  find_all(ShardedReconstructor(path("work")));
  options_.features.max_count = 200;
  plan(2);
  const ShardedReconstructor other(path("work"));
  expect_error([&] { (void)other.match(1, progress_, {}); }, "belongs to another plan");
  find_all(other);
  match_all(other);
  EXPECT_EQ(map(other, "model").models().size(), 1U);
  expect_same_as_whole("model");
}

TEST_F(Sharded, AChangedImageIsRefused) {
  plan(2);
  const ShardedReconstructor sharded(path("work"));
  write_image(path("images/0.png"), (*images_)[1]);
  expect_error([&] { (void)sharded.find_features(1, progress_, {}); },
               "run `tarsier sfm plan` again");
  fs::remove(path("images/0.png"));
  expect_error([&] { (void)sharded.find_features(1, progress_, {}); },
               "run `tarsier sfm plan` again");
  EXPECT_FALSE(fs::exists(path("work/features-1-of-2")));
}

TEST_F(Sharded, ThePlanRoundTripsAndInvalidOnesAreRefused) {
  options_.mapper.choice = MapperChoice::kGlobal;
  options_.two_view.threshold_px = 0.1 + 0.2;
  options_.mapper.refine_center = true;
  options_.features.wide = true;
  options_.seed = 0xFFFFFFFFFFFFFFFFU;
  plan(4);
  const std::string text = contents(path("work/plan.json"));
  const Plan read = read_plan(path("work"));
  EXPECT_EQ(read.shards, 4);
  EXPECT_EQ(read.options.mapper.choice, MapperChoice::kGlobal);
  EXPECT_EQ(read.options.two_view.threshold_px, 0.1 + 0.2);
  EXPECT_TRUE(read.options.mapper.refine_center);
  EXPECT_TRUE(read.options.features.wide);
  EXPECT_EQ(read.options.seed, options_.seed);
  ASSERT_TRUE(read.options.camera);
  EXPECT_EQ(read.options.camera->fx, scene_->camera().fx);
  plan(4);
  EXPECT_EQ(contents(path("work/plan.json")), text);
  for (const auto& [key, value] :
       std::vector<std::pair<std::string, nlohmann::json>>{{"shards", 0},
                                                           {"shards", "two"},
                                                           {"version", 1},
                                                           {"written_by", "someone"},
                                                           {"images", nlohmann::json::array()},
                                                           {"options", nullptr}}) {
    nlohmann::json json = nlohmann::json::parse(text);
    json[key] = value;
    write_file_atomically(path("work/plan.json"), json.dump());
    expect_error([&] { (void)read_plan(path("work")); }, "plan");
  }
  expect_error([&] { (void)read_plan(path("nowhere")); }, "there is no plan");
  EXPECT_THROW(plan(0), std::invalid_argument);
}

TEST_F(Sharded, ThePlanKeepsThePositionsOfImages) {
  std::vector<Input> placed = inputs();
  placed[0].position = Eigen::Vector3d(0.1 + 0.2, -1e6, 3);
  (void)write_plan(path("work"), placed, options_, 2, progress_, {});
  const Plan read = read_plan(path("work"));
  EXPECT_EQ(read.inputs()[0].position, placed[0].position);
  EXPECT_FALSE(read.inputs()[1].position.has_value());
  const std::string text = contents(path("work/plan.json"));
  for (const nlohmann::json& value :
       std::vector<nlohmann::json>{{1, 2}, {1, 2, "3"}, {1, 2, nullptr}, "north"}) {
    nlohmann::json json = nlohmann::json::parse(text);
    json["images"][1]["place"] = value;
    write_file_atomically(path("work/plan.json"), json.dump());
    expect_error([&] { (void)read_plan(path("work")); }, "'place'");
  }
}

TEST_F(Sharded, GivenPositionsGuideRetrieval) {
  const std::string name = inputs()[1].name;
  options_.pairs = PairChoice::kRetrieval;
  (void)write_plan(path("work"), inputs(), options_, 2, progress_, {}, 0, {{name, {1, 2, 3}}});
  EXPECT_EQ(read_plan(path("work")).inputs()[1].position, Eigen::Vector3d(1, 2, 3));
  options_.pairs = PairChoice::kExhaustive;  // they are not needed
  (void)write_plan(path("work"), inputs(), options_, 2, progress_, {}, 0, {{name, {1, 2, 3}}});
  EXPECT_FALSE(read_plan(path("work")).inputs()[1].position.has_value());
}

// Requests a stop when the n-th amount is reported within the stage "join".
class StopInJoin final : public Progress {
 public:
  explicit StopInJoin(int n) : remaining_(n) {}
  void begin(std::string_view stage, std::int64_t, std::string_view) override {
    is_join_ = stage == "join";
  }
  void advance(std::int64_t) override {
    if (is_join_ && --remaining_ == 0) stop_.request_stop();
  }
  void end() override { is_join_ = false; }
  [[nodiscard]] std::stop_token stop() const { return stop_.get_token(); }

 private:
  int remaining_;
  bool is_join_ = false;
  std::stop_source stop_;
};

TEST_F(Sharded, AMergeResumesFromItsCheckpoint) {
  plan(2, 4);
  const ShardedReconstructor sharded(path("work"));
  map_clusters(sharded);
  (void)merge(sharded, "whole");
  const auto expect_same = [&] {
    for (const std::string file : {"cameras.txt", "images.txt", "points3D.txt"})
      EXPECT_EQ(contents(path("model/" + file)), contents(path("whole/" + file))) << file;
    const nlohmann::json whole = nlohmann::json::parse(contents(path("whole/report.json")));
    const nlohmann::json model = nlohmann::json::parse(contents(path("model/report.json")));
    for (const char* key : {"log", "joins", "parts", "models", "refused_pairs"})
      EXPECT_EQ(model.value(key, nlohmann::json()), whole.value(key, nlohmann::json())) << key;
  };
  ReconstructorOptions options;
  options.folder = path("model");
  options.pipeline.checkpoint_s = 0;
  StopInJoin progress(1);  // after the join, where the model begins to grow
  EXPECT_THROW((void)sharded.merge(options, progress, progress.stop()), Interrupted);
  EXPECT_FALSE(fs::exists(path("model/points3D.txt")));
  const ReconstructorResult resumed = sharded.merge(options, progress_, {});
  EXPECT_EQ(resumed.pipeline.resumed, kImages);
  expect_same();
  // From the state at the end; and without a damaged file.
  EXPECT_EQ(sharded.merge(options, progress_, {}).pipeline.resumed, kImages);
  expect_same();
  for (const auto& entry : fs::directory_iterator(path("model/cache")))
    write_file_atomically(entry.path().string(), "damaged");
  EXPECT_EQ(sharded.merge(options, progress_, {}).pipeline.resumed, 0);
  expect_same();
}

TEST_F(Sharded, AMergedModelIsPlaced) {
  plan(2, 4);
  const ShardedReconstructor sharded(path("work"));
  map_clusters(sharded);
  std::string positions;
  for (int i = 0; i < kImages; ++i) {
    const Eigen::Vector3d center = scene_->pose(i).center();
    positions += fmt::format("{}.png,{},{},{}\n", i, center[0], center[1], center[2]);
  }
  write_file_atomically(path("positions.csv"), positions);
  ReconstructorOptions options;
  options.folder = path("model");
  options.cache = false;
  options.binary = options.database = options.undistorted = true;
  options.placement.alignment = Alignment::kPositions;
  options.placement.positions_file = path("positions.csv");
  const ReconstructorResult result = sharded.merge(options, progress_, {});
  EXPECT_EQ(result.placement_error, "");
  ASSERT_TRUE(result.placement.aligned);
  EXPECT_EQ(result.placement.aligned->images, kImages);
  // The files have the placed model.
  const Model text = read_colmap(path("model"));
  const Model binary = read_colmap_binary(path("model"));
  ASSERT_EQ(text.images.size(), static_cast<std::size_t>(kImages));
  for (std::size_t i = 0; i < text.images.size(); ++i) {
    const Eigen::Vector3d center = scene_->pose(static_cast<int>(i)).center();
    EXPECT_LT((text.images[i].pose.center() - center).norm(), 0.1);
    EXPECT_LT((binary.images[i].pose.center() - center).norm(), 0.1);
  }
  for (const char* name : {"model/database.db", "model/undistorted/images/0.png"})
    EXPECT_TRUE(fs::exists(path(name))) << name;

  options.placement = {};
  options.placement.distance = KnownDistance{"0.png", "4.png", 7};
  const Model scaled = sharded.merge(options, progress_, {}).models().at(0);
  EXPECT_NEAR((scaled.images[0].pose.center() - scaled.images[4].pose.center()).norm(), 7, 1e-9);
}

TEST_F(Sharded, ClustersAreMappedSeparatelyAndMerged) {
  plan(2, 4);
  const ShardedReconstructor sharded(path("work"));
  ASSERT_EQ(sharded.plan().clusters(), 2);
  map_clusters(sharded);
  const ReconstructorResult result = merge(sharded, "model");
  ASSERT_EQ(result.models().size(), 1U);
  EXPECT_EQ(statistics_of(result.models()[0]).registered, kImages);
  EXPECT_LT(statistics_of(result.models()[0]).reprojection_px, 0.6);
  const nlohmann::ordered_json report = to_json(result);
  EXPECT_EQ(report["parts"], (nlohmann::json{"cluster 1", "cluster 2"}));
  ASSERT_EQ(report["joins"].size(), 1U);
  EXPECT_EQ(report["joins"][0]["joined"], true);
  EXPECT_GE(report["joins"][0]["images"], 3);
  // Merged again in the same way: the same byte for byte.
  const std::string points = contents(path("model/points3D.txt"));
  (void)merge(sharded, "again");
  EXPECT_EQ(contents(path("again/points3D.txt")), points);
  // Mapping all images together is possible with such a plan too.
  (void)map(sharded, "together");
  expect_same_as_whole("together");
}

TEST_F(Sharded, AClusterIsRecomputedOnlyIfItsFileIsDamaged) {
  plan(1, 4);
  const ShardedReconstructor sharded(path("work"));
  map_clusters(sharded);
  const ShardReport report = map_cluster(sharded, 1);
  EXPECT_TRUE(report.was_done);
  EXPECT_GE(report.count, 3);
  EXPECT_LE(report.own, 4);
  EXPECT_EQ(report.registered, report.count);
  EXPECT_EQ(report.models, 1);
  const std::string file = path("work/model-1-of-2");
  const std::string bytes = contents(file);
  change_byte(file, bytes.size() - 1);
  expect_error([&] { (void)merge(sharded, "model"); }, "is damaged; run: tarsier sfm map");
  EXPECT_FALSE(map_cluster(sharded, 1).was_done);
  EXPECT_EQ(contents(file), bytes);
  fs::remove(path("work/model-2-of-2.done"));
  expect_error([&] { (void)merge(sharded, "model"); }, "--cluster 2/2");
  (void)map_cluster(sharded, 2);
  // Other matches make other clusters.
  write_file_atomically(path("work/match-1-of-1.done"), "");
  expect_error([&] { (void)merge(sharded, "model"); }, "run: tarsier sfm match");
  match_all(sharded);
  EXPECT_EQ(merge(sharded, "model").models().size(), 1U);
  EXPECT_THROW((void)map_cluster(sharded, 3), std::invalid_argument);
}

TEST_F(Sharded, TheClusterSizeIsPartOfThePlan) {
  plan(2);
  expect_error([&] { (void)merge(ShardedReconstructor(path("work")), "model"); }, "no clusters");
  const std::string without = contents(path("work/plan.json"));
  plan(2, 5);
  EXPECT_EQ(read_plan(path("work")).clusters(), 1);
  EXPECT_NE(contents(path("work/plan.json")), without);
  EXPECT_THROW(plan(2, 3), std::invalid_argument);
  EXPECT_THROW(plan(2, -1), std::invalid_argument);
  for (const nlohmann::json& value : std::vector<nlohmann::json>{-5, 3, "four", 4.5}) {
    nlohmann::json json = nlohmann::json::parse(without);
    json["cluster_size"] = value;
    write_file_atomically(path("work/plan.json"), json.dump());
    expect_error([&] { (void)read_plan(path("work")); }, "'cluster_size'");
  }
}

TEST_F(Sharded, ModelsOfFoldersAreMerged) {
  const auto model_of = [&](const std::string& folder, std::vector<std::string> names) {
    ReconstructorOptions options;
    options.pipeline = options_;
    options.folder = path(folder);
    options.cache = false;
    std::vector<Input> some;
    for (const Input& input : inputs())
      if (std::find(names.begin(), names.end(), input.name) != names.end()) some.push_back(input);
    (void)Reconstructor(options).run_images(some, progress_, {});
  };
  model_of("a", {"0.png", "1.png", "2.png", "3.png"});
  model_of("b", {"1.png", "2.png", "3.png", "4.png"});
  model_of("c", {"3.png", "4.png"});
  ReconstructorOptions options;
  options.folder = path("merged");
  const ReconstructorResult result = merge_models({path("a"), path("b")}, options, progress_, {});
  ASSERT_EQ(result.models().size(), 1U);
  EXPECT_EQ(statistics_of(result.models()[0]).registered, kImages);
  EXPECT_LT(statistics_of(result.models()[0]).reprojection_px, 0.6);
  EXPECT_TRUE(fs::exists(path("merged/points.ply")));
  // With few common images the parts stay apart, and the report says why.
  const ReconstructorResult merged = merge_models({path("a"), path("c")}, options, progress_, {});
  EXPECT_EQ(merged.models().size(), 2U);
  const nlohmann::ordered_json report = to_json(merged);
  EXPECT_EQ(report["joins"][0]["joined"], false);
  EXPECT_EQ(report["joins"][0]["reason"], "1 image in common, 3 are needed");
  EXPECT_FALSE(report["images"][0].contains("trust"));
  EXPECT_TRUE(fs::exists(path("merged/model-1/points.ply")));
  EXPECT_THROW((void)merge_models({path("a"), path("nowhere")}, options, progress_, {}),
               InputError);
  EXPECT_THROW((void)merge_models({path("a")}, options, progress_, {}), std::invalid_argument);
}

TEST_F(Sharded, AStopLeavesNoPartialFiles) {
  plan(1);
  const ShardedReconstructor sharded(path("work"));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)sharded.find_features(1, progress_, stop.get_token()), Interrupted);
  EXPECT_FALSE(fs::exists(path("work/features-1-of-1")));
}

TEST(ShardRanges, CoverEveryItemOnce) {
  for (const std::int64_t count : {0, 1, 5, 1000}) {
    std::int64_t next = 0;
    for (int shard = 1; shard <= 7; ++shard) {
      const ShardRange range = range_of_shard(count, shard, 7);
      EXPECT_EQ(range.first, next);
      EXPECT_GE(range.size(), count / 7);
      EXPECT_LE(range.size(), count / 7 + 1);
      next = range.last;
    }
    EXPECT_EQ(next, count);
  }
}

TEST(ShardCommands, QuoteWordsForTheShell) {
  EXPECT_EQ(shell_word("/data/work-1"), "/data/work-1");
  EXPECT_EQ(shell_word("my work"), "'my work'");
  EXPECT_EQ(shell_word("it's $(x)"), "'it'\\''s $(x)'");
  EXPECT_EQ(shell_word(""), "''");
  EXPECT_EQ(shard_command("W", ShardStage::kMatch, 3, 8), "tarsier sfm match W --shard 3/8");
  EXPECT_EQ(shard_command("my W", ShardStage::kModel, 3, 8),
            "tarsier sfm map 'my W' --cluster 3/8");
}

}  // namespace
}  // namespace tarsier::sfm
