// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/trees.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/regression/testing_distance.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/media/archive.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <utility>
#include <vector>

namespace tarsier::face::regression {
namespace {

using nlohmann::json;
using test_support::mean_distance;
using testing::HasSubstr;

constexpr double kRadius = 16;

// A bright disc with a dark dot towards its upper left, rotated by `angle`. Its points are a ring
// of eight around the disc and one on the dot.
TrainingFace disc(const cv::Size& size, const Eigen::Vector2d& centre, double radius,
                  double angle = 0, int noise = 0, std::uint64_t seed = 1) {
  TrainingFace face;
  face.name = "disc";
  face.gray = cv::Mat(size, CV_8UC1, cv::Scalar(60));
  const auto at = [&](double turn, double share) {
    return Eigen::Vector2d(centre +
                           share * radius * Eigen::Vector2d(std::cos(turn), std::sin(turn)));
  };
  const Eigen::Vector2d dot = at(angle - 2.4, 0.5);
  constexpr int kBits = 6;
  constexpr double kOne = 1 << kBits;
  const auto draw = [&](const Eigen::Vector2d& position, double r, int value) {
    cv::circle(face.gray, cv::Point(cvRound(position.x() * kOne), cvRound(position.y() * kOne)),
               cvRound(r * kOne), cv::Scalar(value), cv::FILLED, cv::LINE_AA, kBits);
  };
  draw(centre, radius, 200);
  draw(dot, 0.3 * radius, 30);
  Rng random(seed);
  for (int y = 0; y < face.gray.rows && noise > 0; ++y)
    for (int x = 0; x < face.gray.cols; ++x)
      face.gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(
          face.gray.at<std::uint8_t>(y, x) + random.normal(0, noise));
  face.points.resize(2, 9);
  for (int k = 0; k < 8; ++k) face.points.col(k) = at(angle + k * std::numbers::pi / 4, 1);
  face.points.col(8) = dot;
  return face;
}

struct Problem {
  std::vector<TrainingFace> faces;
  std::vector<Start> starts;
};

// Discs at random places in images. Each start is the shape of another disc, shifted and scaled.
Problem problem(int count, int starts_each, std::uint64_t seed) {
  Problem result;
  Rng random(seed);
  for (int i = 0; i < count; ++i) {
    const double x = random.uniform(40, 80);
    const double y = random.uniform(35, 65);
    const double radius = kRadius * random.uniform(0.85, 1.15);
    result.faces.push_back(disc({120, 100}, {x, y}, radius, random.uniform(-0.15, 0.15), 4,
                                seed + static_cast<std::uint64_t>(i)));
  }
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector2d centre =
        result.faces[static_cast<std::size_t>(i)].points.leftCols(8).rowwise().mean();
    for (int k = 0; k < starts_each; ++k) {
      const double dx = random.uniform(-6, 6);
      const double dy = random.uniform(-6, 6);
      const TrainingFace upright =
          disc({1, 1}, centre + Eigen::Vector2d(dx, dy), kRadius * random.uniform(0.9, 1.1));
      result.starts.push_back({i, upright.points});
    }
  }
  return result;
}

TreesOptions small() {
  TreesOptions options;
  options.levels = 6;
  options.trees = 40;
  options.depth = 3;
  options.features = 150;
  options.tests = 20;
  options.nearness = 0.5;
  return options;
}

Trees trained_trees(const Problem& data, const TreesOptions& options) {
  NoProgress progress;
  return train_trees(data.faces, data.starts, options, progress, {});
}

// Mean error of the starts and of the fits from them.
std::pair<double, double> errors(const Trees& model, const Problem& data) {
  std::pair<double, double> sum;
  for (const Start& start : data.starts) {
    const TrainingFace& face = data.faces[static_cast<std::size_t>(start.face)];
    sum.first += mean_distance(start.points, face.points);
    sum.second += mean_distance(fit_trees(model, face.gray, start.points), face.points);
  }
  const auto count = static_cast<double>(data.starts.size());
  return {sum.first / count, sum.second / count};
}

const Problem& lesson() {
  static const Problem data = problem(150, 8, 1);
  return data;
}

const Trees& learnt() {
  static const Trees model = trained_trees(lesson(), small());
  return model;
}

bool same(const Trees& a, const Trees& b) {
  if (a.mean != b.mean || a.depth != b.depth || a.smoothing != b.smoothing ||
      a.levels.size() != b.levels.size())
    return false;
  for (std::size_t l = 0; l < a.levels.size(); ++l) {
    const Trees::Level& p = a.levels[l];
    const Trees::Level& q = b.levels[l];
    if (p.anchor != q.anchor || p.offset != q.offset || p.first != q.first ||
        p.second != q.second || p.threshold != q.threshold || p.leaves != q.leaves ||
        p.basis != q.basis)
      return false;
  }
  return true;
}

TEST(Trees, FitUnseenDiscs) {
  learnt().check();
  const auto [before, after] = errors(learnt(), problem(60, 3, 1000));
  EXPECT_GT(before, 4);
  EXPECT_LT(after, 1.0);
  EXPECT_LT(after, before / 5);
}

// The residual that training reports equals that of the fit: the same pixels, rounding and frames.
TEST(Trees, FitTrainingDataExactly) {
  Problem data = problem(12, 1, 5);
  TreesOptions options = small();
  options.levels = 10;
  options.depth = 4;
  const auto [before, after] = errors(trained_trees(data, options), data);
  EXPECT_GT(before, 3);
  EXPECT_LT(after, 1e-3 * before);
}

TEST(Trees, FitRotatedAndScaledImage) {
  // The same disc at twice the size in an image rotated by 90 degrees. The start is transformed in
  // the same way.
  const TrainingFace face = disc({240, 200}, {110, 95}, 2 * kRadius, std::numbers::pi / 2);
  const TrainingFace start = disc({1, 1}, {118, 88}, 1.9 * kRadius, std::numbers::pi / 2 + 0.1);
  const double before = mean_distance(start.points, face.points);
  const double after = mean_distance(fit_trees(learnt(), face.gray, start.points), face.points);
  EXPECT_GT(before, 8);
  EXPECT_LT(after, before / 4);
}

TEST(Trees, AreTheSameForAnyNumberOfThreads) {
  const Problem data = problem(100, 25, 3);  // more starts than one piece of work
  TreesOptions options = small();
  options.levels = 2;
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const Trees one = trained_trees(data, options);
  cv::setNumThreads(2);
  const Trees two = trained_trees(data, options);
  cv::setNumThreads(threads);
  EXPECT_TRUE(same(one, two));
  options.seed = 2;
  EXPECT_FALSE(same(one, trained_trees(data, options)));
}

TEST(Trees, FitAtTheBorderAndOutside) {
  const TrainingFace face = disc({50, 40}, {3, 37}, kRadius);
  for (const double shift : {0.0, -60.0, 1e7, -1e15}) {
    Eigen::Matrix2Xd start = face.points;
    start.array() += shift;
    const Eigen::Matrix2Xd fit = fit_trees(learnt(), face.gray, start);
    EXPECT_TRUE(fit.allFinite()) << shift;
    EXPECT_LT(mean_distance(fit, start), 4 * kRadius) << shift;
  }
  const cv::Mat dot(1, 1, CV_8UC1, cv::Scalar(9));
  EXPECT_TRUE(fit_trees(learnt(), dot, face.points).allFinite());
}

TEST(Trees, FitSubImageWithoutCopy) {
  const TrainingFace face = disc({120, 100}, {60, 50}, kRadius);
  const cv::Rect part(20, 10, 80, 80);
  Eigen::Matrix2Xd start = face.points;
  start.colwise() -= Eigen::Vector2d(part.x - 4.0, part.y + 3.0);
  const Eigen::Matrix2Xd fit = fit_trees(learnt(), face.gray(part), start);
  EXPECT_EQ(fit, fit_trees(learnt(), face.gray(part).clone(), start));
}

// The leaves that a fit reports are those that the last level adds.
TEST(Trees, ReportTheLeavesOfTheLastLevel) {
  const Problem data = problem(5, 2, 40);
  Trees before = learnt();
  before.levels.pop_back();
  const Eigen::MatrixXf moves = learnt().levels.back().moves();
  const Eigen::Index leaf_count = Eigen::Index{1} << learnt().depth;
  std::vector<int> leaves = {-1};
  for (const Start& start : data.starts) {
    const cv::Mat& gray = data.faces[static_cast<std::size_t>(start.face)].gray;
    const Eigen::Matrix2Xd fit = fit_trees(learnt(), gray, start.points, &leaves);
    EXPECT_EQ(fit, fit_trees(learnt(), gray, start.points));
    ASSERT_EQ(leaves.size(), static_cast<std::size_t>(small().trees));
    Eigen::VectorXf sum = Eigen::VectorXf::Zero(moves.rows());
    for (std::size_t t = 0; t < leaves.size(); ++t)
      sum += moves.col(static_cast<Eigen::Index>(t) * leaf_count + leaves[t]);
    const shape::Similarity2d mean_from_px =
        shape::fit_similarity(learnt().mean, start.points).inverse();
    const Eigen::Matrix2Xd step =
        mean_from_px(fit) - mean_from_px(fit_trees(before, gray, start.points));
    EXPECT_LT((step.reshaped() - sum.cast<double>()).cwiseAbs().maxCoeff(), 1e-5);
  }
}

// Moves along few directions are kept up to rounding. Of more directions, the strongest are kept.
TEST(Trees, CompressLeaves) {
  Rng random(7);
  Eigen::MatrixXf directions(18, 3);
  Eigen::MatrixXf numbers(3, 40);
  for (float& value : directions.reshaped()) value = static_cast<float>(random.normal());
  for (float& value : numbers.reshaped()) value = static_cast<float>(random.normal(0, 0.01));
  const Eigen::MatrixXf moves = directions * numbers;
  Trees::Level level;
  level.set_leaves(moves, 3);
  EXPECT_EQ(level.components(), 3U);
  EXPECT_EQ(level.leaves.size(), 120U);
  EXPECT_LT((level.moves() - moves).norm(), 0.01 * moves.norm());
  level.set_leaves(moves, 100);  // no more than there are numbers
  EXPECT_EQ(level.components(), 18U);
  EXPECT_LT((level.moves() - moves).norm(), 0.01 * moves.norm());
  level.set_leaves(moves, 2);
  const double left = (level.moves() - moves).norm() / moves.norm();
  EXPECT_GT(left, 0.05);
  EXPECT_LT(left, 0.7);
  level.set_leaves(Eigen::MatrixXf::Zero(18, 8), 4);
  EXPECT_EQ(level.moves(), Eigen::MatrixXf(Eigen::MatrixXf::Zero(18, 8)));
}

TEST(Trees, JsonRoundTrip) {
  const Trees read = trees_from_json(to_json(learnt()), "m.json");
  EXPECT_TRUE(same(learnt(), read));
  const TrainingFace face = disc({120, 100}, {60, 50}, kRadius);
  const Eigen::Matrix2Xd start = disc({1, 1}, {57, 53}, kRadius).points;
  EXPECT_EQ(fit_trees(learnt(), face.gray, start), fit_trees(read, face.gray, start));
}

TEST(Trees, RefuseBrokenFiles) {
  Problem data = problem(5, 2, 9);
  TreesOptions options = small();
  options.levels = 2;
  options.trees = 3;
  const json good = to_json(trained_trees(data, options));
  const Trees model = trees_from_json(good, "m.json");
  ASSERT_EQ(model.levels.size(), 2U);

  const auto refused = [&](const char* what, const std::function<void(json&)>& spoil) {
    json bad = good;
    spoil(bad);
    try {
      (void)trees_from_json(bad, "m.json");
      ADD_FAILURE() << what << ": accepted";
    } catch (const ModelError& e) {
      EXPECT_THAT(e.what(), HasSubstr("m.json")) << what;
      EXPECT_THAT(e.what(), HasSubstr(what));
    }
  };
  const auto set_pair = [](json& packed, std::size_t at, int value) {
    PackedArray<std::uint8_t> bytes = unpack<std::uint8_t>(packed, "", "", {-1, -1, 2});
    bytes.values[2 * at] = static_cast<std::uint8_t>(value & 0xFF);
    bytes.values[2 * at + 1] = static_cast<std::uint8_t>((value >> 8) & 0xFF);
    packed = pack(bytes);
  };
  refused("mean", [](json& m) { m.erase("mean"); });
  refused("mean", [](json& m) { m["mean"] = pack(PackedArray<double>{{1, 2}, {0, 0}}); });
  refused("mean", [](json& m) { m["mean"] = pack(PackedArray<double>{{0, 2}, {}}); });
  const auto moved = [&](double scale, double shift) {
    std::vector<double> values(model.mean.data(), model.mean.data() + model.mean.size());
    for (double& v : values) v = scale * v + shift;
    return pack(PackedArray<double>{{model.mean.cols(), 2}, values});
  };
  refused("size", [&](json& m) { m["mean"] = moved(2, 0); });
  refused("centred", [&](json& m) { m["mean"] = moved(1, 0.5); });
  refused("basis", [](json& m) { m["mean"] = pack(PackedArray<double>{{2, 2}, {-1, 0, 1, 0}}); });
  refused("depth", [](json& m) { m["depth"] = 40; });
  refused("first", [](json& m) { m["depth"] = 4; });
  refused("smoothing", [](json& m) { m["smoothing"] = -0.1; });
  refused("levels", [](json& m) { m["levels"] = json::array(); });
  refused("levels", [](json& m) { m["levels"] = 3; });
  refused("levels", [](json& m) {
    for (int i = 0; i < 30; ++i) m["levels"].push_back(m["levels"][0]);
  });
  refused("compares a pixel", [&](json& m) { set_pair(m["levels"][1]["second"], 4, 150); });
  refused("compares a pixel", [&](json& m) { set_pair(m["levels"][0]["first"], 0, -1); });
  refused("anchor", [&](json& m) {
    json& packed = m["levels"][0]["anchor"];
    PackedArray<std::int32_t> anchor = unpack<std::int32_t>(packed, "", "", {-1});
    anchor.values.back() = 9;
    packed = pack(anchor);
  });
  refused("offset", [](json& m) {
    m["levels"][0]["offset"] = pack(PackedArray<float>{{2, 2}, {0, 0, 0, 0}});
  });
  refused("offset", [](json& m) {
    m["levels"][0]["offset"] = pack(PackedArray<float>{{150, 2}, std::vector<float>(300, 1e30F)});
  });
  refused("threshold", [](json& m) { m["levels"][0]["threshold"] = m["levels"][0]["leaves"]; });
  refused("leaves", [](json& m) { m["levels"][0]["leaves"] = m["levels"][0]["threshold"]; });
  refused("basis", [](json& m) { m["levels"][0].erase("basis"); });
  refused("basis", [](json& m) {
    m["levels"][0]["basis"] = pack(PackedArray<float>{{18, 19}, std::vector<float>(18 * 19, 0)});
    m["levels"][0]["leaves"] =
        pack(PackedArray<std::uint8_t>{{3, 8, 19}, std::vector<std::uint8_t>(3 * 8 * 19, 0)});
  });
  refused("basis", [](json& m) {
    m["levels"][0]["basis"] = pack(PackedArray<float>{{18, 18}, std::vector<float>(18 * 18, 2)});
  });
  refused("first", [](json& m) {
    m["levels"][0]["first"] = pack(PackedArray<std::uint8_t>{{0, 7, 2}, {}});
    m["levels"][0]["second"] = m["levels"][0]["first"];
    m["levels"][0]["threshold"] = pack(PackedArray<std::uint8_t>{{0, 7, 2}, {}});
    m["levels"][0]["leaves"] = pack(PackedArray<std::uint8_t>{{0, 8, 18}, {}});
    m["levels"][0]["first"]["dtype"] = "i8";
  });
  refused("trees", [](json& m) {
    m["levels"][0]["first"] = pack(PackedArray<std::uint8_t>{{0, 7, 2}, {}});
    m["levels"][0]["second"] = m["levels"][0]["first"];
    m["levels"][0]["threshold"] = pack(PackedArray<std::uint8_t>{{0, 7, 2}, {}});
    m["levels"][0]["leaves"] = pack(PackedArray<std::uint8_t>{{0, 8, 18}, {}});
  });
  EXPECT_THROW((void)trees_from_json(json::array(), "m.json"), ModelError);
}

TEST(Trees, RejectInvalidInput) {
  const TrainingFace face = disc({120, 100}, {60, 50}, kRadius);
  const cv::Mat colour(100, 120, CV_8UC3, cv::Scalar::all(0));
  EXPECT_THROW((void)fit_trees(learnt(), colour, face.points), std::invalid_argument);
  EXPECT_THROW((void)fit_trees(learnt(), cv::Mat(), face.points), std::invalid_argument);
  EXPECT_THROW((void)fit_trees(learnt(), face.gray, face.points.leftCols(5)),
               std::invalid_argument);
  EXPECT_THROW((void)fit_trees(learnt(), face.gray, Eigen::Matrix2Xd::Zero(2, 9)),
               std::invalid_argument);
  EXPECT_THROW((void)fit_trees(learnt(), face.gray, Eigen::Matrix2Xd::Constant(2, 9, NAN)),
               std::invalid_argument);

  Problem data = problem(3, 1, 4);
  TreesOptions options = small();
  options.depth = 9;
  EXPECT_THROW((void)trained_trees(data, options), std::invalid_argument);
  data.starts[0].face = 3;
  EXPECT_THROW((void)trained_trees(data, small()), std::invalid_argument);
  data = problem(3, 1, 4);
  data.faces[1].points(0, 0) = NAN;
  EXPECT_THROW((void)trained_trees(data, small()), std::invalid_argument);
  EXPECT_THROW((void)trained_trees({}, small()), std::invalid_argument);
}

// Requests a stop after some trees.
class StopAt final : public Progress {
 public:
  explicit StopAt(int count) : count_(count) {}
  void begin(std::string_view stage, std::int64_t total, std::string_view unit) override {
    EXPECT_EQ(stage, "trees");
    EXPECT_EQ(total, 240);
    EXPECT_EQ(unit, "trees");
  }
  void advance(std::int64_t count) override {
    if ((done_ += count) == count_) source.request_stop();
  }
  void end() override {}
  std::int64_t done_ = 0;
  std::stop_source source;

 private:
  int count_;
};

TEST(Trees, CanBeInterruptedAndReportProgress) {
  const Problem data = problem(6, 2, 4);
  StopAt early(3);
  EXPECT_THROW((void)train_trees(data.faces, data.starts, small(), early, early.source.get_token()),
               Interrupted);
  EXPECT_EQ(early.done_, 3);
  StopAt never(-1);
  (void)train_trees(data.faces, data.starts, small(), never, never.source.get_token());
  EXPECT_EQ(never.done_, 240);
}

}  // namespace
}  // namespace tarsier::face::regression
