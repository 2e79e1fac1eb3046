// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/regression_network.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/face/regression/testing_distance.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <nlohmann/json.hpp>

namespace tarsier::face::regression {
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

}  // namespace
}  // namespace tarsier::face::regression
