// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/descent.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/regression/least_squares.h"
#include "tarsier/face/regression/quality.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <nlohmann/json.hpp>

namespace tarsier::face::regression {
namespace {

Descent trained(const std::vector<TrainingFace>& faces, std::uint64_t seed = 1) {
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  const Eigen::Matrix2Xd mean = shape::train_shape_model(shapes).mean;
  DescentOptions options;
  options.stages = {{16, 0.4}, {24, 0.25}};
  options.components = 16;
  options.ridge = 0.1;
  options.seed = seed;
  NoProgress silent;
  return train_descent(faces, scattered_starts(faces, mean, 6, seed), options, silent, {});
}

double mean_error(const Eigen::Matrix2Xd& points, const TrainingFace& face) {
  return (points - face.points).colwise().norm().mean() / shape_size(face.points);
}

class DescentTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    faces_ = new std::vector<TrainingFace>(test_support::blob_faces(60, 3));
    model_ = new Descent(trained(*faces_));
  }
  static void TearDownTestSuite() {
    delete model_;
    delete faces_;
  }
  static std::vector<TrainingFace>* faces_;
  static Descent* model_;
};
std::vector<TrainingFace>* DescentTest::faces_ = nullptr;
Descent* DescentTest::model_ = nullptr;

TEST_F(DescentTest, FitsUnseenFaces) {
  const std::vector<TrainingFace> unseen = test_support::blob_faces(20, 99);
  DescentWorkspace workspace;
  double before = 0;
  double after = 0;
  for (const Start& start : scattered_starts(unseen, model_->mean, 3, 5)) {
    const TrainingFace& face = unseen[static_cast<std::size_t>(start.face)];
    before += mean_error(start.points, face);
    after += mean_error(fit_descent(*model_, face.gray, start.points, workspace), face);
  }
  EXPECT_LT(after, 0.25 * before);
}

TEST_F(DescentTest, FitDoesNotDependOnTheImageScale) {
  const TrainingFace& face = (*faces_)[0];
  cv::Mat large;
  cv::resize(face.gray, large, {}, 4, 4, cv::INTER_CUBIC);
  DescentWorkspace workspace;
  const Eigen::Matrix2Xd start = scattered_starts({face}, model_->mean, 1, 8)[0].points;
  const Eigen::Matrix2Xd small_fit = fit_descent(*model_, face.gray, start, workspace);
  const Eigen::Matrix2Xd large_start = ((start.array() + 0.5) * 4 - 0.5).matrix();
  const Eigen::Matrix2Xd large_fit = fit_descent(*model_, large, large_start, workspace);
  const Eigen::Matrix2Xd back = ((large_fit.array() + 0.5) / 4 - 0.5).matrix();
  EXPECT_LT((back - small_fit).colwise().norm().maxCoeff(), 0.05 * shape_size(face.points));
}

TEST_F(DescentTest, IsTheSameForAnyNumberOfThreads) {
  const std::vector<TrainingFace> few(faces_->begin(), faces_->begin() + 12);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const Descent one = trained(few);
  cv::setNumThreads(4);
  const Descent four = trained(few);
  cv::setNumThreads(threads);
  ASSERT_EQ(one.stages.size(), four.stages.size());
  for (std::size_t s = 0; s < one.stages.size(); ++s) {
    EXPECT_EQ(one.stages[s].weights, four.stages[s].weights);
  }
}

TEST_F(DescentTest, JsonRoundTrip) {
  const Descent read = descent_from_json(to_json(*model_), "m.json");
  const TrainingFace& face = (*faces_)[1];
  DescentWorkspace workspace;
  const Eigen::Matrix2Xd start = scattered_starts({face}, model_->mean, 1, 8)[0].points;
  const Eigen::Matrix2Xd before = fit_descent(*model_, face.gray, start, workspace);
  const Eigen::Matrix2Xd after = fit_descent(read, face.gray, start, workspace);
  EXPECT_LT((before - after).colwise().norm().maxCoeff(), 0.02);
}

TEST_F(DescentTest, RefusesBrokenFiles) {
  const nlohmann::json good = to_json(*model_);
  nlohmann::json bad = good;
  bad["stages"] = nlohmann::json::array();
  EXPECT_THROW((void)descent_from_json(bad, "m.json"), ModelError);
  bad = good;
  bad["stages"][0]["bias"] = good["stages"][0]["center"];
  EXPECT_THROW((void)descent_from_json(bad, "m.json"), ModelError);
  bad = good;
  bad["mean"]["shape"] = {3, 6};
  EXPECT_THROW((void)descent_from_json(bad, "m.json"), ModelError);
  bad = good;
  bad["stages"][1]["px_per_unit"] = 1e9;
  EXPECT_THROW((void)descent_from_json(bad, "m.json"), ModelError);
  bad = good;
  bad.erase("mean");
  EXPECT_THROW((void)descent_from_json(bad, "m.json"), ModelError);
}

TEST_F(DescentTest, AFitAtTheEdgeOfTheImageStaysFinite) {
  const TrainingFace& face = (*faces_)[2];
  DescentWorkspace workspace;
  const Eigen::Matrix2Xd start = (model_->mean * 30).colwise() + Eigen::Vector2d(-20, 150);
  EXPECT_TRUE(fit_descent(*model_, face.gray, start, workspace).allFinite());
}

TEST_F(DescentTest, QualitySeparatesGoodFromBadFits) {
  std::vector<RatedFit> fits;
  Rng rng(4);
  for (int f = 0; f < static_cast<int>(faces_->size()); ++f) {
    const Eigen::Matrix2Xd& truth = (*faces_)[static_cast<std::size_t>(f)].points;
    fits.push_back({f, truth});
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector2d displacement(rng.normal(0, 25), rng.normal(0, 25));
      fits.push_back({f, truth.colwise() + displacement});
    }
  }
  NoProgress silent;
  const Quality quality = train_quality(*faces_, fits, QualityOptions{}, silent, {});
  const std::vector<TrainingFace> unseen = test_support::blob_faces(10, 50);
  DescentWorkspace workspace;
  for (const TrainingFace& face : unseen) {
    const double right = quality_of(quality, face.gray, face.points, workspace);
    const double wrong =
        quality_of(quality, face.gray, face.points.colwise() + Eigen::Vector2d(25, -20), workspace);
    EXPECT_GT(right, 0.5);
    EXPECT_LT(wrong, 0.45);
    EXPECT_GT(right, wrong + 0.15);
  }
}

TEST(MirrorShift, MeasuresOffsetOfOneBasedPixels) {
  // Symmetric objects; only the order of their points is not symmetric.
  Rng rng(6);
  const std::vector<int> mirror{2, 1, 0, 5, 4, 3, 8, 7, 6};
  std::vector<TrainingFace> faces;
  for (int i = 0; i < 80; ++i) {
    TrainingFace face = test_support::blob_face(rng);
    TrainingFace turned;
    cv::flip(face.gray, turned.gray, 1);
    face.points.row(0).array() += 1.0;
    shape::LandmarkSample sample;
    sample.points = face.points;
    turned.points = shape::mirrored(sample, mirror, face.gray.cols).points;
    turned.mirrored = true;
    faces.push_back(face);
    faces.push_back(turned);
  }
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const TrainingFace& face : faces) shapes.push_back(face.points);
  const Eigen::Matrix2Xd mean = shape::train_shape_model(shapes).mean;
  DescentOptions options;
  options.stages = {{16, 0.4}, {24, 0.25}};
  options.components = 16;
  options.ridge = 0.1;
  DescentReport report;
  NoProgress silent;
  (void)train_descent(faces, scattered_starts(faces, mean, 4, 1), options, silent, {}, &report);
  EXPECT_NEAR(report.to_the_right, 1.0, 0.25);
}

TEST(LeastSquares, SolvesAKnownProblem) {
  Rng rng(2);
  Rows x;
  x.columns = 7;
  Rows y;
  y.columns = 2;
  Eigen::MatrixXf truth(7, 2);
  for (Eigen::Index i = 0; i < truth.size(); ++i) truth(i) = static_cast<float>(rng.normal());
  for (int r = 0; r < 700; ++r) {
    Eigen::VectorXf row(7);
    for (int c = 0; c < 6; ++c) row[c] = static_cast<float>(rng.normal());
    row[6] = 1;
    const Eigen::VectorXf value = truth.transpose() * row;
    x.values.insert(x.values.end(), row.data(), row.data() + 7);
    y.values.insert(y.values.end(), value.data(), value.data() + 2);
  }
  const Eigen::MatrixXf squares = cross_products(x, x, 0, 700);
  EXPECT_LT((squares - squares.transpose()).cwiseAbs().maxCoeff(), 1e-3F);
  const Eigen::MatrixXf found = ridge(squares, cross_products(x, y, 0, 700), 1e-3F);
  EXPECT_LT((found - truth).cwiseAbs().maxCoeff(), 1e-3F);
}

}  // namespace
}  // namespace tarsier::face::regression
