// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/view_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/head_view/testing_view.h"
#include "tarsier/face/head_view/view_train.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <unistd.h>
#include <vector>

namespace tarsier::face::head_view {
namespace {

// Heads with a rough pitch of half the true one, and a rough yaw of four fifths.
struct WrongPose {
  cv::Mat image;
  geometry::Rigid3 rough;
  geometry::Rigid3 truth;
};

WrongPose random_wrong_pose(Rng& rng) {
  const double yaw = rng.uniform(-40, 40);
  const double pitch = rng.uniform(-30, 30);
  const double roll = rng.uniform(-10, 10);
  const Eigen::Vector3d place(rng.uniform(-40, 40), rng.uniform(-50, 10), rng.uniform(480, 620));
  WrongPose result;
  result.truth = {head::rotation_of_angles({yaw, pitch, roll}), place};
  result.rough = {head::rotation_of_angles(
                      {0.8 * yaw + 3 * rng.normal(), 0.5 * pitch + 3 * rng.normal(), roll}),
                  place};
  result.image = painted_head(result.truth, testing_camera());
  return result;
}

ViewSample sample_of(const WrongPose& head, int group) {
  const HeadView view = *view_of_painted(head.image, testing_camera(), head.rough, &head.truth);
  const Eigen::Vector3d forward = head.truth.rotation * Eigen::Vector3d(0, 0, -1);
  return {view, direction_of(view, view.camera_from_view.transpose() * forward), group};
}

std::vector<ViewSample> samples(int count, std::uint64_t seed) {
  Rng rng(seed);
  std::vector<ViewSample> result;
  result.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) result.push_back(sample_of(random_wrong_pose(rng), i % 5));
  return result;
}

struct Errors {
  double pitch = 0;
  double yaw = 0;
};

Errors errors_of(const std::vector<ViewSample>& test, const std::vector<Direction>& found) {
  Errors mean;
  for (std::size_t i = 0; i < test.size(); ++i) {
    mean.pitch += std::abs(found[i].pitch_deg - test[i].truth.pitch_deg);
    mean.yaw += std::abs(found[i].yaw_deg - test[i].truth.yaw_deg);
  }
  const auto n = static_cast<double>(test.size());
  return {mean.pitch / n, mean.yaw / n};
}

std::vector<Direction> approximate_directions(const std::vector<ViewSample>& test) {
  std::vector<Direction> result;
  for (const ViewSample& sample : test)
    result.push_back({sample.view.angles.pitch_deg, sample.view.angles.yaw_deg});
  return result;
}

TEST(ViewModel, ReducesPitchAndYawErrors) {
  const ViewModel model = train_view_model(samples(250, 1), {});
  const std::vector<ViewSample> test = samples(80, 2);
  std::vector<Direction> found;
  for (const ViewSample& sample : test)
    found.push_back(correct_direction(model, sample.view).direction);
  const Errors before = errors_of(test, approximate_directions(test));
  const Errors after = errors_of(test, found);
  EXPECT_GT(before.pitch, 6);
  EXPECT_LT(after.pitch, 0.5 * before.pitch);
  EXPECT_LT(after.yaw, 0.7 * before.yaw);
}

TEST(ViewModel, IsMirrorSymmetric) {
  const ViewModel model = train_view_model(samples(120, 3), {});
  for (const ViewSample& sample : samples(10, 4)) {
    const Direction here = correct_direction(model, sample.view).direction;
    const Direction there = correct_direction(model, mirrored(sample.view)).direction;
    EXPECT_NEAR(here.pitch_deg, there.pitch_deg, 0.05);
    EXPECT_NEAR(here.yaw_deg, -there.yaw_deg, 0.05);
  }
}

TEST(ViewModel, DoesNotCorrectUnfamiliarViews) {
  const ViewModel model = train_view_model(samples(120, 5), {});
  HeadView unfamiliar = samples(1, 6).front().view;
  unfamiliar.gradients.setConstant(3);
  const CorrectedDirection corrected = correct_direction(model, unfamiliar);
  const Direction& found = corrected.direction;
  EXPECT_NEAR(found.pitch_deg, unfamiliar.angles.pitch_deg, 1e-3);
  EXPECT_NEAR(found.yaw_deg, unfamiliar.angles.yaw_deg, 1e-3);
  EXPECT_LT((corrected.jacobian - Eigen::Matrix2d::Identity()).norm(), 1e-3);
}

TEST(ViewModel, JacobianMatchesNumericDerivative) {
  const ViewModel model = train_view_model(samples(120, 15), {});
  constexpr double kStep = 0.2;  // degrees
  for (const ViewSample& sample : samples(10, 16)) {
    const Eigen::Matrix2d jacobian = correct_direction(model, sample.view).jacobian;
    for (int by = 0; by < 2; ++by) {
      const auto moved = [&](double step) {
        HeadView view = sample.view;
        (by == 0 ? view.angles.pitch_deg : view.angles.yaw_deg) += step;
        return correct_direction(model, view).direction;
      };
      const Direction low = moved(-kStep / 2);
      const Direction high = moved(kStep / 2);
      EXPECT_NEAR(jacobian(0, by), (high.pitch_deg - low.pitch_deg) / kStep, 0.02);
      EXPECT_NEAR(jacobian(1, by), (high.yaw_deg - low.yaw_deg) / kStep, 0.02);
    }
  }
}

TEST(ViewModel, LeaveGroupsOutMatchesTrainingWithoutTheGroup) {
  const std::vector<ViewSample> all = samples(60, 7);
  TrainViewOptions options;
  options.components = 12;
  const std::vector<CorrectedDirection> left_out = leave_groups_out(all, options);
  std::vector<ViewSample> others;
  for (const ViewSample& sample : all)
    if (sample.group != 2) others.push_back(sample);
  const ViewModel model = train_view_model(others, options);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].group != 2) continue;
    const CorrectedDirection corrected = correct_direction(model, all[i].view);
    EXPECT_EQ(left_out[i].direction.pitch_deg, corrected.direction.pitch_deg);
    EXPECT_EQ(left_out[i].jacobian, corrected.jacobian);
  }
}

TEST(ViewModel, IgnoresConstantErrorOfAGroup) {
  // One of five people looks 12 degrees beside the direction of the others.
  std::vector<ViewSample> training = samples(200, 13);
  for (ViewSample& sample : training) {
    sample.nominal = true;
    if (sample.group == 1) sample.truth.yaw_deg += 12;
  }
  const std::vector<ViewSample> test = samples(60, 14);
  const auto yaw_error = [&](const TrainViewOptions& options) {
    const ViewModel model = train_view_model(training, options);
    std::vector<Direction> found;
    for (const ViewSample& sample : test)
      found.push_back(correct_direction(model, sample.view).direction);
    return errors_of(test, found).yaw;
  };
  EXPECT_LT(yaw_error({}), 0.9 * yaw_error({.group_error = 0}));
}

TEST(ViewModel, FitsExactTruthsMoreCloselyThanNominalOnes) {
  const auto error_of_training = [](bool nominal) {
    std::vector<ViewSample> training = samples(100, 17);
    for (ViewSample& sample : training) sample.nominal = nominal;
    const ViewModel model = train_view_model(training, {.group_error = 0});
    std::vector<Direction> found;
    for (const ViewSample& sample : training)
      found.push_back(correct_direction(model, sample.view).direction);
    return errors_of(training, found);
  };
  const Errors exact = error_of_training(false);
  const Errors nominal = error_of_training(true);
  EXPECT_LT(exact.pitch, 0.6 * nominal.pitch);
  EXPECT_LT(exact.yaw, 0.6 * nominal.yaw);
}

TEST(ViewModel, RejectsInvalidOptionsAndData) {
  const std::vector<ViewSample> few = samples(4, 8);
  EXPECT_THROW((void)train_view_model(few, {}), std::invalid_argument);
  const std::vector<ViewSample> equal_views(20, few.front());
  EXPECT_THROW((void)train_view_model(equal_views, {.mirror = false}), std::invalid_argument);
  EXPECT_THROW((void)train_view_model(samples(10, 9), {.ridge = 0}), std::invalid_argument);
  EXPECT_THROW((void)train_view_model(samples(10, 9), {.exact_ridge = 0}), std::invalid_argument);
  std::vector<ViewSample> one_group = samples(10, 9);
  for (ViewSample& sample : one_group) sample.group = 0;
  EXPECT_THROW((void)leave_groups_out(one_group, {}), std::invalid_argument);
  std::vector<ViewSample> without_offsets = samples(10, 9);
  without_offsets.back().view.offsets.resize(0);
  EXPECT_THROW((void)train_view_model(without_offsets, {.mirror = false}), std::invalid_argument);
}

class ViewModelFile : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::temp_directory_path() / ("tarsier-view-" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  [[nodiscard]] std::string path(const std::string& name) const {
    return (folder_ / name).string();
  }
  std::filesystem::path folder_;
};

TEST_F(ViewModelFile, RoundTripKeepsPredictions) {
  const ViewModel model = train_view_model(samples(40, 10), {});
  write_view_model(path("view.json"), model, {{"data", "painted"}});
  const ViewModel read = read_view_model(path("view.json"));
  for (const ViewSample& sample : samples(5, 11)) {
    const CorrectedDirection written = correct_direction(model, sample.view);
    const CorrectedDirection again = correct_direction(read, sample.view);
    EXPECT_EQ(written.direction.pitch_deg, again.direction.pitch_deg);
    EXPECT_EQ(written.direction.yaw_deg, again.direction.yaw_deg);
    EXPECT_EQ(written.jacobian, again.jacobian);
  }
  EXPECT_EQ(read.trained_on, 40);
}

TEST_F(ViewModelFile, RejectsInvalidFilesWithTheirName) {
  write_view_model(path("good.json"), train_view_model(samples(20, 12), {}),
                   nlohmann::json::object());
  nlohmann::json file;
  std::ifstream(path("good.json")) >> file;
  const auto refused = [&](const std::string& member, const nlohmann::json& value) {
    nlohmann::json bad = file;
    bad["payload"][member] = value;
    std::ofstream(path("bad.json")) << bad;
    try {
      (void)read_view_model(path("bad.json"));
    } catch (const ModelError& error) {
      return std::string(error.what()).find("bad.json") != std::string::npos;
    }
    return false;
  };
  EXPECT_TRUE(refused("gamma", -1));
  EXPECT_TRUE(refused("gamma", "much"));
  EXPECT_TRUE(refused("most_deg", 1e9));
  EXPECT_TRUE(refused("mean", file["payload"]["weights"]));
  EXPECT_TRUE(refused("weights", file["payload"]["centres"]));
  EXPECT_TRUE(refused("centres", file["payload"]["basis"]));
  EXPECT_TRUE(refused("basis", nullptr));
  EXPECT_TRUE(refused("trained_on", -4));
  EXPECT_THROW((void)read_view_model(path("gone.json")), ModelError);
}

}  // namespace
}  // namespace tarsier::face::head_view
