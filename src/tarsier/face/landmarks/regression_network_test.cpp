// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/regression_network.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/testing_blobs.h"
#include "tarsier/face/landmarks/testing_distance.h"
#include "tarsier/face/landmarks/train_model.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <nlohmann/json.hpp>

namespace tarsier::face::landmarks {
namespace {

using test_support::mean_distance;

RegressionNetwork trained_network(const std::vector<TrainingFace>& faces, int steps) {
  RegressionNetworkOptions options;
  options.steps = steps;
  NoProgress silent;
  return train_regression_network(faces, options, silent, {});
}

TEST(RegressionNetwork, FitsUnseenFaces) {
  TARSIER_LONG_TEST();
  const RegressionNetwork model = trained_network(test_support::blob_faces(40, 7), 90);
  const std::vector<TrainingFace> others = test_support::blob_faces(20, 99);
  const std::vector<Start> starts = scattered_starts(others, model.mean, 1, 2);
  RegressionNetworkWorkspace workspace;
  double before = 0;
  double after = 0;
  for (std::size_t f = 0; f < others.size(); ++f) {
    const Eigen::Matrix2Xd fit = fit_network(model, others[f].gray, starts[f].points, workspace);
    before += mean_distance(starts[f].points, others[f].points);
    after += mean_distance(fit, others[f].points);
  }
  EXPECT_LT(after, 0.5 * before);
}

// The result depends on the position of the start, not on its shape.
TEST(RegressionNetwork, UsesOnlyTheSimilarityOfTheStart) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(6, 3);
  const RegressionNetwork model = trained_network(faces, 2);
  RegressionNetworkWorkspace workspace;
  const shape::Similarity2d similarity = shape::fit_similarity(model.mean, faces[0].points);
  const Eigen::Matrix2Xd a = fit_network(model, faces[0].gray, faces[0].points, workspace);
  const Eigen::Matrix2Xd b = fit_network(model, faces[0].gray, similarity(model.mean), workspace);
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), 1e-6);
}

TEST(RegressionNetwork, IsTheSameForAnyNumberOfThreads) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(6, 3);
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const nlohmann::json one = to_json(trained_network(faces, 3));
  cv::setNumThreads(4);
  const nlohmann::json four = to_json(trained_network(faces, 3));
  cv::setNumThreads(before);
  EXPECT_EQ(one, four);
}

TEST(RegressionNetwork, JsonRoundTrip) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(6, 3);
  const RegressionNetwork model = trained_network(faces, 2);
  const nlohmann::json written = to_json(model);
  const RegressionNetwork read = regression_network_from_json(written, "file");
  RegressionNetworkWorkspace workspace;
  const Eigen::Matrix2Xd a = fit_network(model, faces[0].gray, faces[0].points, workspace);
  const Eigen::Matrix2Xd b = fit_network(read, faces[0].gray, faces[0].points, workspace);
  EXPECT_LT((a - b).cwiseAbs().maxCoeff(), 1e-4);
  nlohmann::json broken = written;
  broken.erase("network");
  EXPECT_THROW((void)regression_network_from_json(broken, "file"), ModelError);
}

TEST(RegressionNetwork, RejectsInvalidInput) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(6, 3);
  EXPECT_THROW((void)trained_network({faces.front()}, 2), std::invalid_argument);
  const RegressionNetwork model = trained_network(faces, 2);
  RegressionNetworkWorkspace workspace;
  const Eigen::Matrix2Xd few = faces[0].points.leftCols(4);
  EXPECT_THROW((void)fit_network(model, faces[0].gray, few, workspace), std::invalid_argument);
  const Eigen::Matrix2Xd one_place = Eigen::Matrix2Xd::Constant(2, 9, 50);
  EXPECT_THROW((void)fit_network(model, faces[0].gray, one_place, workspace),
               std::invalid_argument);
}

// The mean of all parts moves towards the network, more if trees and descent disagree more.
TEST(RegressionNetwork, IsIncludedInTheMeanOfTheMethods) {
  const std::vector<TrainingFace> faces = test_support::blob_faces(20, 5);
  LandmarkModel model;
  NoProgress silent;
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  model.shape = shape::train_shape_model(shapes);
  const std::vector<Start> starts = scattered_starts(faces, model.shape.mean, 2, 1);
  DescentOptions descent;
  descent.folds = 2;
  model.descent = train_descent(faces, starts, descent, silent, {});
  TreesOptions trees;
  trees.levels = 2;
  trees.trees = 5;
  model.trees = train_trees(faces, starts, trees, silent, {});
  FitWorkspace workspace;
  const Eigen::Matrix2Xd& start = starts[0].points;
  const Eigen::Matrix2Xd without = fit_points(model, {}, faces[0].gray, start, workspace).points;
  model.network = trained_network(faces, 2);
  const Eigen::Matrix2Xd with = fit_points(model, {}, faces[0].gray, start, workspace).points;
  const Eigen::Matrix2Xd alone =
      fit_network(*model.network, faces[0].gray, without, workspace.network);
  FitOptions by_trees;
  by_trees.method = FitMethod::kTrees;
  FitOptions by_descent;
  by_descent.method = FitMethod::kDescent;
  const double distance =
      mean_distance(fit_points(model, by_trees, faces[0].gray, start, workspace).points,
                    fit_points(model, by_descent, faces[0].gray, start, workspace).points) /
      shape_size(without);
  ASSERT_GT(distance, 0.01);
  const double share = distance * distance / (distance * distance + 0.08 * 0.08);
  EXPECT_LT((with - (without + share * (alone - without))).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT((with - without).cwiseAbs().maxCoeff(), 1e-3);
}

}  // namespace
}  // namespace tarsier::face::landmarks
