// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/adapt.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/face/regression/trees.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <string>
#include <vector>

namespace tarsier::face::landmarks {
namespace {

// One person's disks differ from those of all others. The drawn disks follow the shape; the
// annotation is moved by a pattern of that person.
std::vector<regression::TrainingFace> person_faces(int count, std::uint64_t seed) {
  std::vector<regression::TrainingFace> faces = regression::test_support::blob_faces(count, seed);
  for (regression::TrainingFace& face : faces) {
    const double size = regression::shape_size(face.points);
    face.points.col(4).y() += 0.15 * size;
    face.points.col(0).x() -= 0.12 * size;
    face.points.col(8).x() += 0.10 * size;
  }
  return faces;
}

double error_of(const LandmarkModel& model, FitMethod method,
                const std::vector<regression::TrainingFace>& faces) {
  FitOptions options;
  options.method = method;
  FitWorkspace workspace;
  double sum = 0;
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, model.shape.mean, 3, 99);
  for (const regression::Start& start : starts) {
    const regression::TrainingFace& face = faces[static_cast<std::size_t>(start.face)];
    const Fit fit = fit_points(model, options, face.gray, start.points, workspace);
    sum += (fit.points - face.points).colwise().norm().mean() / regression::shape_size(face.points);
  }
  return sum / static_cast<double>(starts.size());
}

class AdaptTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    const std::vector<regression::TrainingFace> faces = regression::test_support::blob_faces(60, 3);
    std::vector<Eigen::Matrix2Xd> shapes;
    for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
    base_.shape = shape::train_shape_model(shapes);
    NoProgress silent;
    regression::TreesOptions trees;
    trees.levels = 4;
    trees.trees = 40;
    trees.depth = 3;
    const std::vector<regression::Start> starts =
        regression::scattered_starts(faces, base_.shape.mean, 8, 1);
    base_.trees = regression::train_trees(faces, starts, trees, silent, {});
    regression::DescentOptions descent;
    descent.stages = {{24, 0.36}, {32, 0.25}};
    descent.components = 8;
    base_.descent = regression::train_descent(faces, starts, descent, silent, {});
    regression::RegressionNetworkOptions network;
    network.steps = 60;
    base_.network = regression::train_regression_network(faces, network, silent, {});
  }

  // The person as a set of files.
  shape::LandmarkSet person_set(int count) {
    shape::LandmarkSet set;
    int number = 0;
    for (const regression::TrainingFace& face : person_faces(count, 11)) {
      shape::LandmarkSample sample;
      sample.image = folder_ / (std::to_string(number++) + ".png");
      write_image(sample.image, face.gray);
      sample.points = face.points;
      set.samples.push_back(sample);
    }
    return set;
  }

  static LandmarkModel base_;
  TemporaryFolder folder_;
  NoProgress silent_;
};
LandmarkModel AdaptTest::base_;

TEST_F(AdaptTest, OneImageReducesTheErrorOfEachPart) {
  const std::vector<regression::TrainingFace> others = person_faces(8, 50);
  LandmarkModel adapted = base_;
  const std::vector<regression::TrainingFace> one = person_faces(1, 7);
  const std::vector<regression::Start> starts =
      regression::scattered_starts(one, base_.shape.mean, 24, 1);
  adapted.trees = adapt_trees(*base_.trees, one, starts, 0.3, {});
  adapted.descent = adapt_descent(*base_.descent, one, starts, 0.3, {});
  adapted.network = adapt_network(*base_.network, one, starts, 0.3, {});
  for (const FitMethod method : {FitMethod::kTrees, FitMethod::kDescent, FitMethod::kNetwork}) {
    // The network was trained for a few steps only and is inaccurate.
    const double share = method == FitMethod::kNetwork ? 0.95 : 0.85;
    EXPECT_LT(error_of(adapted, method, others), share * error_of(base_, method, others))
        << name_of(method);
  }
}

TEST_F(AdaptTest, AStrongPriorKeepsTheBase) {
  const std::vector<regression::TrainingFace> faces = person_faces(3, 7);
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, base_.shape.mean, 8, 1);
  LandmarkModel kept = base_;
  kept.trees = adapt_trees(*base_.trees, faces, starts, 1e6, {});
  kept.descent = adapt_descent(*base_.descent, faces, starts, 1e6, {});
  kept.network = adapt_network(*base_.network, faces, starts, 1e6, {});
  FitWorkspace workspace;
  for (const FitMethod method : {FitMethod::kTrees, FitMethod::kDescent, FitMethod::kNetwork}) {
    FitOptions options;
    options.method = method;
    const Fit before = fit_points(base_, options, faces[0].gray, starts[0].points, workspace);
    const Fit after = fit_points(kept, options, faces[0].gray, starts[0].points, workspace);
    EXPECT_LT((before.points - after.points).cwiseAbs().maxCoeff(), 0.02) << name_of(method);
  }
}

TEST_F(AdaptTest, ChoosesRidgeByCrossValidation) {
  AdaptOptions options;
  options.choices = {0.1, 10};
  options.starts = 8;
  const AdaptedModel adapted = adapt_landmark_model(base_, person_set(4), "", options, silent_, {});
  EXPECT_TRUE(adapted.ridge_chosen);
  EXPECT_FALSE(adapted.base_kept);
  EXPECT_EQ(adapted.faces, 4);
  EXPECT_GT(adapted.base_error, 0.03);
  EXPECT_LT(adapted.adapted_error, 0.75 * adapted.base_error);
  const std::vector<regression::TrainingFace> others = person_faces(8, 50);
  EXPECT_LT(error_of(adapted.model, FitMethod::kMean, others),
            0.75 * error_of(base_, FitMethod::kMean, others));
}

TEST_F(AdaptTest, KeepsTheBaseWithoutImprovement) {
  // Each image has its own annotation offset. So no ridge improves the held out images.
  shape::LandmarkSet set = person_set(3);
  Rng rng(5);
  for (shape::LandmarkSample& sample : set.samples) {
    for (Eigen::Index p = 0; p < sample.points.cols(); ++p) {
      sample.points.col(p) += Eigen::Vector2d(8 * rng.normal(), 8 * rng.normal());
    }
  }
  AdaptOptions options;
  options.choices = {0.03};
  options.starts = 8;
  const AdaptedModel adapted = adapt_landmark_model(base_, set, "", options, silent_, {});
  EXPECT_TRUE(adapted.base_kept);
  EXPECT_EQ(adapted.model.descent->stages[0].weights, base_.descent->stages[0].weights);
}

TEST_F(AdaptTest, SameForAnyNumberOfThreads) {
  const std::vector<regression::TrainingFace> faces = person_faces(2, 7);
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, base_.shape.mean, 6, 1);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const regression::Descent one = adapt_descent(*base_.descent, faces, starts, 0.3, {});
  cv::setNumThreads(4);
  const regression::Descent four = adapt_descent(*base_.descent, faces, starts, 0.3, {});
  cv::setNumThreads(threads);
  EXPECT_EQ(one.stages.back().weights, four.stages.back().weights);
  EXPECT_EQ(one.stages.back().bias, four.stages.back().bias);
}

TEST_F(AdaptTest, RejectsOtherMarkupsAndCanBeInterrupted) {
  shape::LandmarkSet set = person_set(1);
  set.samples[0].points = Eigen::Matrix2Xd(set.samples[0].points.leftCols(5));
  EXPECT_THROW((void)adapt_landmark_model(base_, set, "", {}, silent_, {}), InputError);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)adapt_landmark_model(base_, person_set(1), "", {}, silent_, stop.get_token()),
               Interrupted);
}

}  // namespace
}  // namespace tarsier::face::landmarks
