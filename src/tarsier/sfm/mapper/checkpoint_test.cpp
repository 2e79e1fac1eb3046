// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/checkpoint.h"

#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

MapperState some_state() {
  MapperState state;
  Model model = synthetic_model();
  model.points[7] = {};  // a track without a point
  state.models.push_back(packed(synthetic_model()));
  IncrementalMapperState& current = state.current.emplace();
  current.model = packed(model);
  current.ray_cameras = model.cameras;
  current.ray_cameras[1].fx += 1;
  current.tracks.resize(model.points.size());
  for (std::size_t p = 0; p < model.points.size(); ++p) current.tracks[p] = model.points[p].track;
  state.log = {"one", "", "two\nlines"};
  state.reasons = {"a", "", "b", "", ""};
  state.rejections = {PairRejection::kNone, PairRejection::kBadInitialPair, PairRejection::kNone};
  state.failed = {{1, 40}, {3, 7}};
  state.adjusted_at = 4;
  state.stage = 2;
  state.round = 1;
  state.has_open_loop_model = true;
  state.is_global = true;
  state.no_model = "none";
  state.conflict_rounds = 2;
  state.loop_stays_open = true;
  state.global_failed = true;
  GlobalStartState& start = state.start.emplace();
  start.image = 2;
  start.step = GlobalStartState::kAdjustment;
  start.round = 3;
  start.edges = {0, 2};
  start.nodes = {0, 3};
  start.rotations = {model.images[0].pose.rotation, model.images[3].pose.rotation};
  start.model = packed(model);
  start.points = {Eigen::Vector3d(1, 2, 3)};
  start.rejections = {PairRejection::kNone, PairRejection::kOpenCycles, PairRejection::kNone};
  start.log = {"global"};
  state.patch_rejections = {{}, {"patches differ", true}, {"few patches", false}};
  MapperState of_try = state;
  of_try.log = {"of a try"};
  state.attempts = {of_try, of_try};
  ModelJoin& join = state.joins.emplace_back();
  join.first = 1;
  join.second = 2;
  join.images = 3;
  join.agreeing = 4;
  join.points = 5;
  join.inliers = 6;
  join.rotation_deg = 7;
  join.scale_error = 0.5;
  join.first_from_second = {2, model.images[0].pose.rotation, {8, 9, 10}};
  join.refusal = "why";
  state.grown = 1;
  return state;
}

Model empty_copy(Model model) {
  for (Image& image : model.images) {
    image.registered = false;
    image.pose = {};
  }
  for (Point& point : model.points) point = {};
  return model;
}

class Checkpoint : public FolderTest {};

TEST_F(Checkpoint, RoundTripKeepsState) {
  const std::string path = folder_ + "/state";
  const MapperState state = some_state();
  write_checkpoint(path, state);
  const auto read = read_checkpoint(path);
  ASSERT_TRUE(read);
  EXPECT_EQ(read->log, state.log);
  EXPECT_EQ(read->reasons, state.reasons);
  EXPECT_EQ(read->rejections, state.rejections);
  EXPECT_EQ(read->failed, state.failed);
  EXPECT_EQ(read->adjusted_at, 4);
  EXPECT_EQ(read->stage, 2);
  EXPECT_EQ(read->round, 1);
  EXPECT_EQ(read->has_open_loop_model, state.has_open_loop_model);
  EXPECT_EQ(read->is_global, state.is_global);
  EXPECT_EQ(read->no_model, state.no_model);
  EXPECT_EQ(read->conflict_rounds, state.conflict_rounds);
  EXPECT_TRUE(read->loop_stays_open);
  EXPECT_TRUE(read->global_failed);
  EXPECT_FALSE(read->done);
  EXPECT_EQ(read->registered(), 8);
  ASSERT_TRUE(read->start);
  EXPECT_EQ(read->start->image, 2);
  EXPECT_EQ(read->start->step, GlobalStartState::kAdjustment);
  EXPECT_EQ(read->start->round, 3);
  EXPECT_EQ(read->start->edges, state.start->edges);
  EXPECT_EQ(read->start->nodes, state.start->nodes);
  EXPECT_EQ(read->start->rotations, state.start->rotations);
  EXPECT_EQ(read->start->model.registered, state.start->model.registered);
  EXPECT_EQ(read->start->points, state.start->points);
  EXPECT_EQ(read->start->rejections, state.start->rejections);
  EXPECT_EQ(read->start->log, state.start->log);
  EXPECT_EQ(read->patch_rejections, state.patch_rejections);
  ASSERT_EQ(read->attempts.size(), 2U);
  EXPECT_EQ(read->attempts[1].log, state.attempts[1].log);
  EXPECT_EQ(read->attempts[1].registered(), 8);
  ASSERT_EQ(read->joins.size(), 1U);
  const ModelJoin& join = read->joins[0];
  EXPECT_EQ(
      (std::array{join.first, join.second, join.images, join.agreeing, join.points, join.inliers}),
      (std::array{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ((std::array{join.rotation_deg, join.scale_error, join.first_from_second.scale}),
            (std::array{7.0, 0.5, 2.0}));
  EXPECT_EQ(join.first_from_second.rotation, state.joins[0].first_from_second.rotation);
  EXPECT_EQ(join.first_from_second.translation, state.joins[0].first_from_second.translation);
  EXPECT_EQ(join.refusal, "why");
  EXPECT_EQ(read->grown, 1);
  ASSERT_TRUE(read->current);
  EXPECT_EQ(read->current->tracks, state.current->tracks);
  EXPECT_EQ(read->current->ray_cameras[1].fx, state.current->ray_cameras[1].fx);
  const Model truth = synthetic_model();
  Model model = empty_copy(truth);
  unpack(read->current->model, model);
  for (std::size_t i = 0; i < truth.images.size(); ++i) {
    EXPECT_EQ(model.images[i].registered, truth.images[i].registered);
    if (truth.images[i].registered) {
      EXPECT_EQ(model.images[i].pose.rotation, truth.images[i].pose.rotation);
    }
  }
  EXPECT_EQ(model.cameras[2].distortion, truth.cameras[2].distortion);
  for (std::size_t p = 0; p < truth.points.size(); ++p) {
    if (p == 7) {
      EXPECT_TRUE(model.points[p].track.empty());
      continue;
    }
    EXPECT_EQ(model.points[p].position, truth.points[p].position);
    EXPECT_EQ(model.points[p].track, truth.points[p].track);
  }
}

TEST_F(Checkpoint, IsRejectedForOtherImages) {
  const Model model = synthetic_model();
  MapperState state = some_state();
  EXPECT_TRUE(fits(state, model.cameras, model.images, 3));
  EXPECT_FALSE(fits(state, model.cameras, model.images, 4));
  std::vector<Image> fewer = model.images;
  fewer.pop_back();
  EXPECT_FALSE(fits(state, model.cameras, fewer, 3));
  fewer = model.images;
  fewer[2].features.resize(10);
  EXPECT_FALSE(fits(state, model.cameras, fewer, 3));
  state.current->model.point_indices.back() = 100;
  EXPECT_FALSE(fits(state, model.cameras, model.images, 3));
  state = some_state();
  state.grown = 2;  // of one model
  EXPECT_FALSE(fits(state, model.cameras, model.images, 3));
  state = some_state();
  state.has_open_loop_model = true;
  EXPECT_TRUE(fits(state, model.cameras, model.images, 3));
  state.models.clear();
  EXPECT_FALSE(fits(state, model.cameras, model.images, 3));
  state = some_state();
  state.patch_rejections.pop_back();
  EXPECT_FALSE(fits(state, model.cameras, model.images, 3));
  state = some_state();
  state.attempts[1].reasons.pop_back();
  EXPECT_FALSE(fits(state, model.cameras, model.images, 3));
  state = some_state();
  state.start->image = 100;
  EXPECT_FALSE(fits(state, model.cameras, model.images, 3));
}

TEST(Checkpoints, GlobalStartIsRejectedForOtherPairs) {
  const Model model = synthetic_model();
  const auto fits_now = [&](const GlobalStartState& state) {
    return fits(state, 3, model.cameras.size(), model.images);
  };
  const GlobalStartState good = *some_state().start;
  EXPECT_TRUE(fits_now(good));
  EXPECT_FALSE(fits(good, 2, model.cameras.size(), model.images));
  GlobalStartState bad = good;
  bad.edges = {2, 0};
  EXPECT_FALSE(fits_now(bad));
  bad = good;
  bad.nodes = {0, 100};
  EXPECT_FALSE(fits_now(bad));
  bad = good;
  bad.rotations.pop_back();
  EXPECT_FALSE(fits_now(bad));
  bad = good;
  bad.model.registered.back() = 100;
  EXPECT_FALSE(fits_now(bad));
  bad = good;
  bad.step = 17;
  EXPECT_FALSE(fits_now(bad));
}

TEST_F(Checkpoint, DamagedFileIsIgnored) {
  const std::string path = folder_ + "/state";
  EXPECT_FALSE(read_checkpoint(path));
  write_checkpoint(path, some_state());
  const auto size = fs::file_size(path);
  {
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    file.seekp(static_cast<std::streamoff>(size / 2));
    file.put('!');
    file.put('?');
  }
  EXPECT_FALSE(read_checkpoint(path));
  write_checkpoint(path, some_state());
  fs::resize_file(path, size / 3);
  EXPECT_FALSE(read_checkpoint(path));
}

}  // namespace
}  // namespace tarsier::sfm
