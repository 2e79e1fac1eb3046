// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/model.h"

#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/face/regression/testing_distance.h"
#include "tarsier/face/regression/trees.h"

#include <gtest/gtest.h>

#include <vector>

namespace tarsier::face::landmarks {
namespace {

using regression::test_support::mean_distance;

// The mean of all parts moves towards the network, more if trees and descent disagree more.
TEST(FitPoints, TheMeanOfTheMethodsIncludesTheNetwork) {
  const std::vector<regression::TrainingFace> faces = regression::test_support::blob_faces(20, 5);
  LandmarkModel model;
  NoProgress silent;
  std::vector<Eigen::Matrix2Xd> shapes;
  shapes.reserve(faces.size());
  for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
  model.shape = shape::train_shape_model(shapes);
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, model.shape.mean, 2, 1);
  regression::DescentOptions descent;
  descent.folds = 2;
  model.descent = regression::train_descent(faces, starts, descent, silent, {});
  regression::TreesOptions trees;
  trees.levels = 2;
  trees.trees = 5;
  model.trees = regression::train_trees(faces, starts, trees, silent, {});
  FitWorkspace workspace;
  const Eigen::Matrix2Xd& start = starts[0].points;
  const Eigen::Matrix2Xd without = fit_points(model, {}, faces[0].gray, start, workspace).points;
  regression::RegressionNetworkOptions network;
  network.steps = 2;
  model.network = regression::train_regression_network(faces, network, silent, {});
  const Eigen::Matrix2Xd with = fit_points(model, {}, faces[0].gray, start, workspace).points;
  const Eigen::Matrix2Xd alone =
      regression::fit_network(*model.network, faces[0].gray, without, workspace.network);
  FitOptions by_trees;
  by_trees.method = FitMethod::kTrees;
  FitOptions by_descent;
  by_descent.method = FitMethod::kDescent;
  const double distance =
      mean_distance(fit_points(model, by_trees, faces[0].gray, start, workspace).points,
                    fit_points(model, by_descent, faces[0].gray, start, workspace).points) /
      regression::shape_size(without);
  ASSERT_GT(distance, 0.01);
  const double share = distance * distance / (distance * distance + 0.08 * 0.08);
  EXPECT_LT((with - (without + share * (alone - without))).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_GT((with - without).cwiseAbs().maxCoeff(), 1e-3);
}

}  // namespace
}  // namespace tarsier::face::landmarks
