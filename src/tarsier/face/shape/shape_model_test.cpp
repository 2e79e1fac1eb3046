// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/shape_model.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>

namespace tarsier::face::shape {
namespace {

using Eigen::Index;
using Eigen::Matrix2Xd;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::HasSubstr;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Similarity2d random_similarity(Rng& rng) {
  const double angle = rng.uniform(-std::numbers::pi, std::numbers::pi);
  const double scale = std::exp(rng.uniform(-3, 6));
  return {scale * std::cos(angle), scale * std::sin(angle), rng.uniform(-900, 900),
          rng.uniform(-900, 900)};
}

// A model of random modes, orthogonal to the four directions of the similarity.
ShapeModel random_model(Rng& rng, int points, const std::vector<double>& deviation) {
  ShapeModel model;
  model.mean.resize(2, points);
  for (Index i = 0; i < model.mean.size(); ++i) model.mean.data()[i] = rng.normal();
  model.mean.colwise() -= model.mean.rowwise().mean().eval();
  model.mean /= std::sqrt(model.mean.squaredNorm() / points);
  const auto m = static_cast<Index>(deviation.size());
  model.deviation = Eigen::Map<const VectorXd>(deviation.data(), m);
  MatrixXd all(2 * points, 4 + m);
  all.leftCols(4) = combined_basis(model).leftCols(4);
  for (Index c = 4; c < all.cols(); ++c)
    for (Index r = 0; r < all.rows(); ++r) all(r, c) = rng.normal();
  const MatrixXd q = linalg::orthonormal_basis(all);
  model.modes = q.rightCols(m);
  model.trained_on = 7;
  model.check();
  return model;
}

VectorXd random_b(Rng& rng, const ShapeModel& model, double sigmas) {
  VectorXd b(model.mode_count());
  for (Index k = 0; k < b.size(); ++k) b[k] = model.deviation[k] * rng.uniform(-sigmas, sigmas);
  return b;
}

double weighted_error(const ShapeModel& model, const ShapeFit& fit, const Matrix2Xd& points,
                      const VectorXd& weights = {}) {
  const Matrix2Xd shape = shape_of(model, fit);
  double sum = 0;
  for (Index i = 0; i < points.cols(); ++i) {
    if (std::isnan(points(0, i))) continue;
    sum += (weights.size() > 0 ? weights[i] : 1.0) * (shape.col(i) - points.col(i)).squaredNorm();
  }
  return sum;
}

TEST(Similarity, FitsExactlyForAnyRotation) {
  Rng rng(1);
  for (int k = 0; k < 50; ++k) {
    Matrix2Xd source(2, 5);
    for (Index i = 0; i < source.size(); ++i) source.data()[i] = rng.normal();
    const Similarity2d truth = random_similarity(rng);
    Matrix2Xd target = truth(source);
    // A missing point and a point of weight 0 do not count.
    target.col(1).setConstant(kNan);
    target.col(2) << 1e4, -1e4;
    VectorXd weights(5);
    weights << 1, 1, 0, 0.5, 3;
    const Similarity2d fit = fit_similarity(source, target, weights);
    EXPECT_NEAR(fit.a, truth.a, 1e-9 * truth.scale());
    EXPECT_NEAR(fit.b, truth.b, 1e-9 * truth.scale());
    EXPECT_NEAR(fit.tx, truth.tx, 1e-9 * (900 + truth.scale()));
    EXPECT_NEAR(fit.ty, truth.ty, 1e-9 * (900 + truth.scale()));
    const Eigen::Vector2d p(0.3, -2);
    EXPECT_LT((truth.inverse()(Eigen::Vector2d(truth(p))) - p).norm(), 1e-9);
    const Similarity2d other = random_similarity(rng);
    EXPECT_LT(((other * truth)(p)-other(Eigen::Vector2d(truth(p)))).norm(),
              1e-9 * (1000 + other.scale() * (2000 + truth.scale())));
  }
}

TEST(Similarity, PositiveAngleRotatesXTowardsY) {
  const Similarity2d quarter{0, 1, 0, 0};
  EXPECT_NEAR(quarter.angle(), std::numbers::pi / 2, 1e-12);
  EXPECT_LT((quarter(Eigen::Vector2d(1, 0)) - Eigen::Vector2d(0, 1)).norm(), 1e-12);
}

TEST(Similarity, RejectsDegenerateInput) {
  Matrix2Xd points(2, 3);
  points << 1, 2, 3, 4, 5, 7;
  Matrix2Xd one = points;
  one.rightCols(2).setConstant(kNan);
  EXPECT_THROW((void)fit_similarity(points, one), std::invalid_argument);
  EXPECT_THROW((void)fit_similarity(Matrix2Xd::Constant(2, 3, 5.1), points), std::invalid_argument);
  EXPECT_THROW((void)fit_similarity(points, points.leftCols(2)), std::invalid_argument);
  EXPECT_THROW((void)fit_similarity(points, points, VectorXd::Constant(3, -1)),
               std::invalid_argument);
  EXPECT_THROW((void)Similarity2d({0, 0, 1, 1}).inverse(), std::invalid_argument);
}

TEST(TrainShapeModel, RecoversTheGeneratingModel) {
  Rng rng(2);
  const ShapeModel truth = random_model(rng, 20, {0.8, 0.5, 0.25});
  std::vector<Matrix2Xd> shapes;
  for (int k = 0; k < 1500; ++k) {
    VectorXd b(3);
    for (Index i = 0; i < 3; ++i) b[i] = truth.deviation[i] * rng.normal();
    // Each shape with its opposite, so that the mean of the shapes is the model's mean.
    shapes.push_back(random_similarity(rng)(shape_of(truth, b)));
    shapes.push_back(random_similarity(rng)(shape_of(truth, VectorXd(-b))));
  }
  shapes.push_back(shapes[5]);
  shapes.back().col(2).setConstant(kNan);  // left out
  ShapeModelOptions options;
  options.variance = 1;
  options.iterations = 1000;
  const ShapeModel model = train_shape_model(shapes, options);
  model.check();
  EXPECT_EQ(model.trained_on, 3000);
  ASSERT_EQ(model.mode_count(), 3);  // exact data has no fourth
  EXPECT_NEAR(model.variance_kept, 1, 1e-9);
  // The rotation of the mean is arbitrary here.
  const Matrix2Xd mean = fit_similarity(model.mean, truth.mean)(model.mean);
  EXPECT_LT((mean - truth.mean).norm() / std::sqrt(20.0), 1e-9);
  for (Index k = 0; k < 3; ++k) EXPECT_NEAR(model.deviation[k] / truth.deviation[k], 1, 0.06) << k;
  // The model represents every true shape.
  for (int k = 0; k < 20; ++k) {
    const Matrix2Xd shape = random_similarity(rng)(shape_of(truth, random_b(rng, truth, 3)));
    const ShapeFit fit = fit_shape(model, shape, {}, 0);
    EXPECT_LT(std::sqrt(weighted_error(model, fit, shape)), 1e-6 * fit.image_from_model.scale());
  }
}

TEST(TrainShapeModel, HasTheMeanOrientationOfTheShapes) {
  Rng rng(3);
  const ShapeModel truth = random_model(rng, 12, {0.3});
  std::vector<Matrix2Xd> shapes;
  for (int k = 0; k < 40; ++k) {
    // The first shape, where alignment starts, has the largest rotation.
    const double angle = (k == 0 ? 1.0 : -1.0 / 39);
    shapes.push_back(Similarity2d{std::cos(angle), std::sin(angle), 5,
                                  6}(shape_of(truth, random_b(rng, truth, 1))));
  }
  const ShapeModel model = train_shape_model(shapes);
  EXPECT_NEAR(fit_similarity(model.mean, truth.mean).angle(), 0, 0.02);
}

TEST(TrainShapeModel, KeepsTheRequestedVariance) {
  Rng rng(4);
  const ShapeModel truth = random_model(rng, 15, {0.9, 0.3, 0.1, 0.03});
  std::vector<Matrix2Xd> shapes;
  for (int k = 0; k < 100; ++k) {
    const VectorXd b = random_b(rng, truth, 2);
    shapes.push_back(shape_of(truth, b));
    shapes.push_back(shape_of(truth, VectorXd(-b)));
  }
  ShapeModelOptions options;
  options.iterations = 1000;
  const auto modes = [&](double variance, int max_modes) {
    options.variance = variance;
    options.max_modes = max_modes;
    const ShapeModel model = train_shape_model(shapes, options);
    model.check();
    return std::pair(model.mode_count(), model.variance_kept);
  };
  EXPECT_EQ(modes(0.5, 20).first, 1);
  EXPECT_EQ(modes(0.95, 20).first, 2);
  EXPECT_EQ(modes(1, 20).first, 4);
  EXPECT_EQ(modes(1, 3).first, 3);
  EXPECT_LT(modes(1, 1).second, 0.95);
  EXPECT_GE(modes(0.95, 20).second, 0.95);
}

TEST(TrainShapeModel, MirroredShapesMakeASymmetricMean) {
  Rng rng(5);
  LandmarkSet set;
  set.mirror = {1, 0, 2, 4, 3};
  set.connections = {{0, 1}, {3, 4}};
  for (int k = 0; k < 6; ++k) {
    LandmarkSample sample;
    sample.points.resize(2, 5);
    sample.points << 10, 30, 20, 12, 27, 10, 11, 20, 30, 31;
    for (Index i = 0; i < 10; ++i) sample.points.data()[i] += rng.normal();
    set.samples.push_back(sample);
  }
  ShapeModelOptions options;
  options.mirror = true;
  const ShapeModel model = train_shape_model(set, options);
  EXPECT_EQ(model.trained_on, 12);
  EXPECT_EQ(model.mirror, set.mirror);
  EXPECT_EQ(model.connections, set.connections);
  for (int i = 0; i < 5; ++i) {
    const int other = set.mirror[static_cast<std::size_t>(i)];
    EXPECT_NEAR(model.mean(0, i), -model.mean(0, other), 1e-6) << i;
    EXPECT_NEAR(model.mean(1, i), model.mean(1, other), 1e-6) << i;
  }
  set.mirror.clear();
  EXPECT_THROW((void)train_shape_model(set, options), std::invalid_argument);
}

TEST(TrainShapeModel, EqualShapesHaveNoModes) {
  Rng rng(6);
  const ShapeModel truth = random_model(rng, 8, {0.1});
  std::vector<Matrix2Xd> shapes(3, truth.mean);
  shapes[1] = random_similarity(rng)(truth.mean);
  const ShapeModel model = train_shape_model(shapes);
  model.check();
  EXPECT_EQ(model.mode_count(), 0);
  EXPECT_EQ(model.variance_kept, 1);
  EXPECT_EQ(shape_model_from_json(to_json(model), "x").mode_count(), 0);
  EXPECT_LT((shape_of(model, fit_shape(model, shapes[1])) - shapes[1]).norm(),
            1e-9 * shapes[1].norm());
}

TEST(TrainShapeModel, RejectsInvalidShapes) {
  Matrix2Xd shape(2, 3);
  shape << 1, 2, 3, 4, 5, 7;
  Matrix2Xd missing = shape;
  missing(0, 0) = kNan;
  Matrix2Xd infinite = shape;
  infinite(0, 0) = std::numeric_limits<double>::infinity();
  using Shapes = std::vector<Matrix2Xd>;
  EXPECT_THROW((void)train_shape_model(Shapes{}), std::invalid_argument);
  EXPECT_THROW((void)train_shape_model(Shapes{shape}), std::invalid_argument);
  EXPECT_THROW((void)train_shape_model(Shapes{shape, missing}), std::invalid_argument);
  EXPECT_THROW((void)train_shape_model(Shapes{shape, infinite}), std::invalid_argument);
  EXPECT_THROW((void)train_shape_model(Shapes{shape, shape.leftCols(2)}), std::invalid_argument);
  EXPECT_THROW((void)train_shape_model(Shapes{shape, Matrix2Xd::Constant(2, 3, 4.2)}),
               std::invalid_argument);
}

TEST(FitShape, RecoversTheGeneratingParameters) {
  Rng rng(7);
  const ShapeModel model =
      random_model(rng, 40, {1.2, 0.9, 0.7, 0.4, 0.3, 0.2, 0.2, 0.1, 0.05, 0.02});
  for (int k = 0; k < 200; ++k) {
    const ShapeFit truth{random_similarity(rng), random_b(rng, model, 3)};
    Matrix2Xd points = shape_of(model, truth);
    const double scale = truth.image_from_model.scale();
    const auto expect_found = [&](const ShapeFit& fit) {
      EXPECT_LT((fit.b - truth.b).cwiseAbs().maxCoeff(), 1e-6);
      EXPECT_NEAR(fit.image_from_model.a, truth.image_from_model.a, 1e-6 * scale);
      EXPECT_NEAR(fit.image_from_model.b, truth.image_from_model.b, 1e-6 * scale);
      EXPECT_NEAR(fit.image_from_model.tx, truth.image_from_model.tx, 1e-6 * (900 + scale));
      EXPECT_NEAR(fit.image_from_model.ty, truth.image_from_model.ty, 1e-6 * (900 + scale));
    };
    expect_found(fit_shape(model, points));
    expect_found(fit_shape(model, points, {}, 0));
    VectorXd weights(40);
    for (Index i = 0; i < 40; ++i) weights[i] = rng.uniform(0.2, 2);
    for (const Index i : {3, 8, 21, 22, 23, 39}) {
      points(0, i) = kNan;
      points(1, i) = kNan;
    }
    weights[7] = 0;
    points.col(7) << 1e5, 3;
    expect_found(fit_shape(model, points, weights));
  }
}

TEST(FitShape, IsALocalMinimum) {
  Rng rng(8);
  const ShapeModel model = random_model(rng, 30, {0.8, 0.5, 0.3, 0.1});
  for (int k = 0; k < 60; ++k) {
    // Noise that the model cannot explain, and parameters beyond the bounds.
    const double sigmas = k % 2 == 0 ? 1.0 : 0.0;
    Matrix2Xd points = shape_of(model, random_b(rng, model, 2));
    for (Index i = 0; i < points.size(); ++i) points.data()[i] += 0.2 * rng.normal();
    const Similarity2d similarity = random_similarity(rng);
    points = similarity(points);
    VectorXd weights;
    if (k % 4 < 2) {
      weights.resize(30);
      for (Index i = 0; i < 30; ++i) weights[i] = rng.uniform(0.1, 1);
    }
    const ShapeFit fit = fit_shape(model, points, weights, sigmas);
    const double min_error = weighted_error(model, fit, points, weights);
    for (int trial = 0; trial < 40; ++trial) {
      ShapeFit other = fit;
      for (Index i = 0; i < other.b.size(); ++i)
        other.b[i] += 0.01 * model.deviation[i] * rng.normal();
      if (sigmas > 0) clamp(model, other.b, sigmas);
      other.image_from_model = fit_similarity(shape_of(model, other.b), points, weights);
      EXPECT_GE(weighted_error(model, other, points, weights), min_error * (1 - 1e-9));
    }
    if (sigmas > 0) {
      for (Index i = 0; i < fit.b.size(); ++i)
        EXPECT_LE(std::abs(fit.b[i]), sigmas * model.deviation[i] * (1 + 1e-12));
    }
  }
}

TEST(FitShape, EqualWeightsMatchNoWeights) {
  Rng rng(9);
  const ShapeModel model = random_model(rng, 25, {0.6, 0.4, 0.2});
  Matrix2Xd points = shape_of(model, random_b(rng, model, 2));
  for (Index i = 0; i < points.size(); ++i) points.data()[i] += 0.2 * rng.normal();
  const ShapeFit plain = fit_shape(model, points, {}, 0);
  const ShapeFit weighted = fit_shape(model, points, VectorXd::Constant(25, 0.3), 0);
  EXPECT_LT((plain.b - weighted.b).norm(), 1e-7);
  EXPECT_NEAR(plain.image_from_model.a, weighted.image_from_model.a, 1e-7);
}

TEST(FitShape, NoiseShrinksParametersTowardsZero) {
  Rng rng(10);
  const ShapeModel model = random_model(rng, 25, {0.6, 0.4, 0.2});
  const VectorXd b = model.deviation * 2;
  const Matrix2Xd points = shape_of(model, b);
  const VectorXd weights = VectorXd::Ones(25);
  double last = b.norm() + 1e-9;
  for (const double noise : {0.0, 0.1, 0.4, 2.0, 50.0}) {
    const double norm = fit_shape(model, points, weights, 0, noise).b.norm();
    EXPECT_LT(norm, last) << noise;
    last = norm;
  }
  EXPECT_LT(last, 1e-2);
  // One mode with a prior: b / (1 + noise^2 / deviation^2); the scale is fitted too.
  const ShapeModel one = random_model(rng, 25, {0.1});
  const ShapeFit fit = fit_shape(one, shape_of(one, VectorXd::Constant(1, 0.02)), weights, 0, 0.1);
  EXPECT_NEAR(fit.b[0], 0.01, 1e-5);
}

TEST(FitShape, FitsFewPoints) {
  Rng rng(11);
  const ShapeModel model = random_model(rng, 30, {0.6, 0.4, 0.2, 0.1, 0.1});
  Matrix2Xd points = random_similarity(rng)(model.mean);
  points.rightCols(27).setConstant(kNan);
  const ShapeFit fit = fit_shape(model, points);
  EXPECT_TRUE(fit.b.allFinite());
  EXPECT_LT(std::sqrt(weighted_error(model, fit, points)), 1e-3 * fit.image_from_model.scale());
  points.col(1).setConstant(kNan);
  points.col(2).setConstant(kNan);
  EXPECT_THROW((void)fit_shape(model, points), std::invalid_argument);
  EXPECT_THROW((void)fit_shape(model, points.leftCols(5)), std::invalid_argument);
  EXPECT_THROW((void)fit_shape(model, model.mean, VectorXd::Constant(30, kNan)),
               std::invalid_argument);
}

TEST(FitShape, StaysFiniteForCoincidingPoints) {
  Rng rng(12);
  const ShapeModel model = random_model(rng, 10, {0.3});
  const ShapeFit fit = fit_shape(model, Matrix2Xd::Constant(2, 10, 7.0));
  EXPECT_TRUE(fit.b.allFinite());
  EXPECT_LT((shape_of(model, fit).array() - 7).abs().maxCoeff(), 1e-9);
}

TEST(Clamp, ReportsWhetherItChangedValues) {
  Rng rng(13);
  const ShapeModel model = random_model(rng, 10, {0.3, 0.2});
  VectorXd b(2);
  b << 0.5, -0.7;
  EXPECT_TRUE(clamp(model, b));
  EXPECT_NEAR(b[0], 0.5, 1e-12);
  EXPECT_NEAR(b[1], -0.6, 1e-12);
  EXPECT_FALSE(clamp(model, b));
}

TEST(CombinedBasis, IsOrthonormalAndSpansSimilarities) {
  Rng rng(14);
  const ShapeModel model = random_model(rng, 12, {0.3, 0.2});
  const MatrixXd basis = combined_basis(model);
  EXPECT_LT((basis.transpose() * basis - MatrixXd::Identity(6, 6)).norm(), 1e-9);
  const Matrix2Xd moved = Similarity2d{1.3, 0.2, 0.5, -0.7}(model.mean);
  const Eigen::Map<const VectorXd> v(moved.data(), moved.size());
  EXPECT_LT((basis * (basis.transpose() * v) - v).norm(), 1e-9);
}

class ShapeModelFile : public FolderTest {};

TEST_F(ShapeModelFile, RoundTrip) {
  Rng rng(15);
  ShapeModel model = random_model(rng, 6, {0.3, 0.2});
  model.mirror = {1, 0, 2, 3, 5, 4};
  model.connections = {{0, 1}, {4, 5}};
  model.variance_kept = 0.75;
  write_shape_model(path("m.json"), model, {{"seed", 15}});
  const ShapeModel read = read_shape_model(path("m.json"));
  EXPECT_EQ(read.mean, model.mean);
  EXPECT_EQ(read.modes, model.modes);
  EXPECT_EQ(read.deviation, model.deviation);
  EXPECT_EQ(read.mirror, model.mirror);
  EXPECT_EQ(read.connections, model.connections);
  EXPECT_EQ(read.variance_kept, 0.75);
  EXPECT_EQ(read.trained_on, 7);
}

TEST_F(ShapeModelFile, RejectsInvalidModels) {
  Rng rng(16);
  const nlohmann::json good = to_json(random_model(rng, 6, {0.3, 0.2}));
  const auto refusal = [&](auto change) -> std::string {
    nlohmann::json bad = good;
    change(bad);
    try {
      (void)shape_model_from_json(bad, "some.json");
    } catch (const ModelError& error) {
      EXPECT_THAT(error.what(), HasSubstr("some.json"));
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.what();
    }
    return "accepted";
  };
  using nlohmann::json;
  const auto packed = [](std::vector<std::int64_t> shape, double value) {
    std::size_t count = 1;
    for (const std::int64_t size : shape) count *= static_cast<std::size_t>(size);
    return pack(PackedArray<double>{shape, std::vector<double>(count, value)});
  };
  EXPECT_THAT(refusal([](json& j) { j.erase("mean"); }), HasSubstr("mean"));
  EXPECT_THAT(refusal([](json& j) { j = 3; }), HasSubstr("expected an object"));
  EXPECT_THAT(refusal([&](json& j) { j["mean"] = packed({2, 1}, 0); }), HasSubstr("points"));
  EXPECT_THAT(refusal([&](json& j) { j["mean"] = packed({2, 6}, 1); }), HasSubstr("centred"));
  EXPECT_THAT(refusal([&](json& j) { j["modes"] = packed({11, 2}, 1); }), HasSubstr("shape"));
  EXPECT_THAT(refusal([&](json& j) { j["modes"] = packed({12, 2}, 1); }), HasSubstr("orthonormal"));
  EXPECT_THAT(refusal([&](json& j) { j["deviation"] = packed({3, 1}, 1); }), HasSubstr("shape"));
  EXPECT_THAT(refusal([&](json& j) {
                j["deviation"] = packed({2, 1}, -1);
              }),
              HasSubstr("deviation"));
  EXPECT_THAT(refusal([](json& j) { j["mirror"] = {0, 1, 2}; }), HasSubstr("mirror"));
  EXPECT_THAT(refusal([](json& j) { j["mirror"] = {1, 2, 0, 3, 4, 5}; }), HasSubstr("mirror"));
  EXPECT_THAT(refusal([](json& j) { j["connections"] = {{0, 6}}; }), HasSubstr("6 points"));
  EXPECT_THAT(refusal([](json& j) { j["connections"] = {{0, 1.5}}; }), HasSubstr("whole number"));
  EXPECT_THAT(refusal([](json& j) { j["variance_kept"] = 1.5; }), HasSubstr("variance_kept"));
}

}  // namespace
}  // namespace tarsier::face::shape
