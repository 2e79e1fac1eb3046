// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/testing_portraits.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <nlohmann/json.hpp>

namespace tarsier::face::appearance {
namespace {

AppearanceModel trained() {
  NoProgress silent;
  return train_appearance_model(test_support::portraits(30, 1), {}, {}, silent, {});
}

TEST(AppearanceModel, LearnsShapeAndTextureModes) {
  const AppearanceModel model = trained();
  EXPECT_EQ(model.points(), 16);
  EXPECT_GE(model.shape.mode_count(), 2);
  EXPECT_LE(model.shape.mode_count(), 4);
  ASSERT_FALSE(model.levels.empty());
  EXPECT_GE(model.levels[0].mode_count(), 1);
}

TEST(AppearanceModel, ReconstructsTrainingImages) {
  const AppearanceModel model = trained();
  const Texture& texture = model.levels[0];
  const Eigen::MatrixXf modes = texture.modes();
  for (const TrainingImage& own : test_support::portraits(5, 1)) {
    EXPECT_LT(fit_texture(model, texture, modes, own.image, own.points).error, 0.35);
    const Eigen::Matrix2Xd displaced = own.points.colwise() + Eigen::Vector2d(18, -14);
    EXPECT_GT(fit_texture(model, texture, modes, own.image, displaced).error,
              fit_texture(model, texture, modes, own.image, own.points).error);
  }
}

TEST(AppearanceModel, IsTheSameForAnyNumberOfThreads) {
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const AppearanceModel one = trained();
  cv::setNumThreads(4);
  const AppearanceModel four = trained();
  cv::setNumThreads(threads);
  EXPECT_EQ(one.levels[0].mean, four.levels[0].mean);
  EXPECT_EQ(one.levels[0].packed_modes, four.levels[0].packed_modes);
}

TEST(AppearanceModel, JsonRoundTripAndRejectsInvalidJson) {
  const AppearanceModel model = trained();
  const nlohmann::json good = to_json(model);
  const AppearanceModel read = appearance_model_from_json(good, "m.json");
  EXPECT_EQ(read.levels[0].packed_modes, model.levels[0].packed_modes);
  EXPECT_EQ(read.mesh, model.mesh);
  for (const auto& [key, value] : good.items()) {
    nlohmann::json bad = good;
    bad[key] = "broken";
    EXPECT_THROW((void)appearance_model_from_json(bad, "m.json"), ModelError) << key;
  }
  nlohmann::json bad = good;
  bad["mesh"] = nlohmann::json::array({{0, 1, 9999}});
  EXPECT_THROW((void)appearance_model_from_json(bad, "m.json"), ModelError);
}

TEST(AppearanceModel, TrainingRejectsOneImage) {
  NoProgress silent;
  EXPECT_THROW((void)train_appearance_model(test_support::portraits(1, 1), {}, {}, silent, {}),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::appearance
