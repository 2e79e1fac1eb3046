// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/visibility.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/occlusion.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace tarsier::face::regression {
namespace {

VisibilityModel trained_visibility(const std::vector<TrainingFace>& faces, int steps) {
  VisibilityOptions options;
  options.steps = steps;
  NoProgress silent;
  return train_visibility_model(faces, options, silent, {});
}

TEST(Occlusion, HidesSomePointsAndIsDeterministic) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(3, 5);
  Rng rng(1);
  for (int k = 0; k < 60; ++k) {
    const TrainingFace& face = faces[static_cast<std::size_t>(k % 3)];
    cv::Mat gray = face.gray.clone();
    Rng same = rng;
    const std::vector<bool> hidden = draw_occlusion(gray, face.points, faces[0].gray, rng);
    const auto count = std::count(hidden.begin(), hidden.end(), true);
    EXPECT_GE(count, 1);
    EXPECT_LE(count, 6);
    cv::Mat changed;
    cv::absdiff(gray, face.gray, changed);
    EXPECT_GT(cv::countNonZero(changed), 10);
    cv::Mat again = face.gray.clone();
    EXPECT_EQ(draw_occlusion(again, face.points, faces[0].gray, same), hidden);
    EXPECT_EQ(cv::norm(again, gray, cv::NORM_INF), 0);
  }
}

TEST(Occlusion, RefusesPointsOutsideTheImage) {
  Rng rng(1);
  cv::Mat gray(40, 40, CV_8UC1, cv::Scalar(9));
  const Eigen::Matrix2Xd far = Eigen::Matrix2Xd::Random(2, 5).array() + 5000;
  EXPECT_THROW((void)draw_occlusion(gray, far, gray, rng), std::invalid_argument);
}

// On held-out faces, hidden points are reported as hidden, and sigma is right.
TEST(Visibility, DetectsHiddenPointsOnUnseenFaces) {
  TARSIER_LONG_TEST();
  const std::vector<TrainingFace> faces = test_support::blob_faces(40, 7);
  const VisibilityModel model = trained_visibility(faces, 120);
  NoProgress silent;
  DescentOptions options;
  options.folds = 2;
  const Descent descent =
      train_descent(faces, scattered_starts(faces, model.mean, 6, 1), options, silent, {});
  const std::vector<TrainingFace> others = test_support::blob_faces(40, 99);
  VisibilityScore score;
  double of_hidden = 0;
  double of_visible = 0;
  VisibilityWorkspace workspace;
  DescentWorkspace fitting;
  Rng rng(3);
  const std::vector<Start> starts = scattered_starts(others, model.mean, 1, 2);
  for (std::size_t f = 0; f < others.size(); ++f) {
    cv::Mat gray = others[f].gray.clone();
    const std::vector<bool> hidden = draw_occlusion(gray, others[f].points, faces[f].gray, rng);
    const Eigen::Matrix2Xd fit = fit_descent(descent, gray, starts[f].points, fitting);
    const Visibility visibility = visibility_of(model, gray, fit, workspace);
    score.add(visibility, fit, others[f].points, hidden);
    for (std::size_t p = 0; p < hidden.size(); ++p)
      (hidden[p] ? of_hidden : of_visible) += visibility.visible[static_cast<Eigen::Index>(p)];
  }
  EXPECT_LT(of_hidden / score.hidden, 0.65);
  EXPECT_GT(of_visible / score.visible, 0.85);
  EXPECT_NEAR(score.coverage(), 0.68, 0.25);
}

TEST(Visibility, IsTheSameForAnyNumberOfThreads) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(12, 3);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const nlohmann::json one = to_json(trained_visibility(faces, 3));
  cv::setNumThreads(3);
  const nlohmann::json three = to_json(trained_visibility(faces, 3));
  cv::setNumThreads(threads);
  EXPECT_EQ(one, three);
}

TEST(Visibility, JsonRoundTrip) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(12, 3);
  const VisibilityModel model = trained_visibility(faces, 3);
  nlohmann::json written = to_json(model);
  const VisibilityModel again = visibility_from_json(written, "file.json");
  VisibilityWorkspace workspace;
  const Visibility before = visibility_of(model, faces[0].gray, faces[0].points, workspace);
  const Visibility after = visibility_of(again, faces[0].gray, faces[0].points, workspace);
  EXPECT_TRUE(before.visible.isApprox(after.visible, 1e-5));
  EXPECT_TRUE(before.sigma_px.isApprox(after.sigma_px, 1e-5));

  written["hidden_slope"] = 1e9;
  EXPECT_THROW((void)visibility_from_json(written, "file.json"), ModelError);
  written["hidden_slope"] = 1;
  written["network"] =
      linalg::network_to_json({{linalg::convolution(1, 18, 5, 5)}});  // 18 numbers for each pixel
  EXPECT_THROW((void)visibility_from_json(written, "file.json"), ModelError);
}

TEST(Visibility, ScoreComparesWithGroundTruth) {
  Visibility visibility;
  visibility.visible = Eigen::Vector4d(0.1, 0.9, 0.05, 0.8);
  visibility.sigma_px = Eigen::Vector4d(1, 1, 2, 2);
  Eigen::Matrix2Xd fitted = Eigen::Matrix2Xd::Zero(2, 4);
  Eigen::Matrix2Xd truth = fitted;
  truth(0, 0) = 0.9;
  truth(1, 2) = 2.1;
  VisibilityScore score;
  score.add(visibility, fitted, truth, {true, true, false, false});
  EXPECT_EQ(score.hidden, 2);
  EXPECT_EQ(score.hidden_flagged, 1);
  EXPECT_EQ(score.visible_flagged, 1);
  EXPECT_DOUBLE_EQ(score.recall(), 0.5);
  EXPECT_DOUBLE_EQ(score.precision(), 0.5);
  EXPECT_DOUBLE_EQ(score.coverage(), 0.75);
  EXPECT_THROW(score.add(visibility, fitted, truth, {true}), std::invalid_argument);
}

TEST(Visibility, CoincidingPointsAreHidden) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(12, 3);
  const VisibilityModel model = trained_visibility(faces, 3);
  VisibilityWorkspace workspace;
  const Visibility visibility =
      visibility_of(model, faces[0].gray, Eigen::Matrix2Xd::Constant(2, 9, 20), workspace);
  EXPECT_EQ(visibility.visible.maxCoeff(), 0);
}

TEST(Visibility, TrainingNeedsTenFaces) {
  EXPECT_THROW((void)trained_visibility(test_support::blob_faces(9, 1), 3), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::regression
