// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/align.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <Eigen/LU>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

std::optional<geometry::Sim3> similarity_between(const std::vector<Eigen::Vector3d>& from,
                                                 const std::vector<Eigen::Vector3d>& to) {
  return geometry::similarity_between(geometry::columns_of(from), geometry::columns_of(to));
}

using ::testing::AllOf;
using ::testing::HasSubstr;

std::vector<Eigen::Vector3d> cloud(std::uint64_t seed, int count,
                                   const Eigen::Vector3d& center = {0, 0, 0},
                                   const Eigen::Vector3d& extent = {1, 1, 1}) {
  Rng rng(seed);
  std::vector<Eigen::Vector3d> points;
  for (int k = 0; k < count; ++k) {
    Eigen::Vector3d x = center;
    for (int i = 0; i < 3; ++i) x[i] += extent[i] * rng.uniform(-1, 1);
    points.push_back(x);
  }
  return points;
}

geometry::Sim3 some_similarity() {
  return {12.5, geometry::rotation_of({0.3, -0.5, 0.7, 0.2}), {100, -20, 3}};
}

std::vector<Eigen::Vector3d> moved(const geometry::Sim3& similarity,
                                   const std::vector<Eigen::Vector3d>& points) {
  std::vector<Eigen::Vector3d> result;
  for (const Eigen::Vector3d& x : points) result.push_back(similarity * x);
  return result;
}

double max_residual(const geometry::Sim3& similarity, const std::vector<Eigen::Vector3d>& from,
                    const std::vector<Eigen::Vector3d>& to) {
  return std::ranges::max(residuals_of(similarity, from, to));
}

void expect_near(const geometry::Sim3& a, const geometry::Sim3& b, double tolerance) {
  EXPECT_NEAR(a.scale / b.scale, 1, tolerance);
  EXPECT_LT((a.rotation - b.rotation).norm(), tolerance);
  EXPECT_LT((a.translation - b.translation).norm(), tolerance * (1 + b.translation.norm()));
}

TEST(Similarity, IsFoundExactly) {
  for (const int count : {3, 4, 50}) {
    const std::vector<Eigen::Vector3d> from = cloud(3, count);
    const auto found = similarity_between(from, moved(some_similarity(), from));
    ASSERT_TRUE(found);
    expect_near(*found, some_similarity(), 1e-9);
    EXPECT_LT(max_residual(*found, from, moved(some_similarity(), from)), 1e-9);
  }
}

TEST(Similarity, OfPointsInAPlaneIsARotation) {
  const std::vector<Eigen::Vector3d> from = cloud(4, 20, {5, 5, 7}, {1, 1, 0});
  const auto found = similarity_between(from, moved(some_similarity(), from));
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->rotation.determinant(), 1, 1e-9);
  expect_near(*found, some_similarity(), 1e-8);
}

TEST(Similarity, OfMirroredPointsIsNoReflection) {
  const std::vector<Eigen::Vector3d> from = cloud(5, 30, {0, 0, 0}, {3, 2, 1});
  std::vector<Eigen::Vector3d> to = from;
  for (Eigen::Vector3d& x : to) x[2] = -x[2];
  const auto found = similarity_between(from, to);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->rotation.determinant(), 1, 1e-9);
  EXPECT_GT(found->scale, 0);
  EXPECT_LT(found->scale, 1);
}

TEST(Similarity, InverseTakesBack) {
  const geometry::Sim3 s = some_similarity();
  const Eigen::Vector3d x(1, 2, 3);
  EXPECT_LT((s.inverse() * (s * x) - x).norm(), 1e-12);
}

TEST(Similarity, IsEmptyForDegeneratePoints) {
  const std::vector<Eigen::Vector3d> line{{0, 0, 0}, {1, 2, 3}, {2, 4, 6}, {-3, -6, -9}};
  const std::vector<Eigen::Vector3d> spread = cloud(6, 4);
  EXPECT_FALSE(similarity_between({}, {}));
  EXPECT_FALSE(similarity_between(cloud(1, 2), cloud(2, 2)));
  EXPECT_FALSE(similarity_between(line, moved(some_similarity(), line)));
  EXPECT_FALSE(similarity_between(line, spread));
  EXPECT_FALSE(similarity_between(spread, line));
  EXPECT_FALSE(similarity_between(spread, std::vector<Eigen::Vector3d>(4, {1, 2, 3})));
  EXPECT_FALSE(robust_similarity(line, spread, 0, 1));
  EXPECT_FALSE(robust_similarity(line, moved(some_similarity(), line), 0.1, 1));
  EXPECT_THROW((void)similarity_between(spread, cloud(1, 5)), std::invalid_argument);
  std::vector<Eigen::Vector3d> bad = spread;
  bad[2][1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)similarity_between(bad, spread), std::invalid_argument);
  EXPECT_THROW((void)robust_similarity(spread, bad, 0, 1), std::invalid_argument);
  EXPECT_THROW((void)robust_similarity(spread, spread, -1, 1), std::invalid_argument);
}

// 40 % of the pairs are far off, the others have noise.
TEST(RobustSimilarity, IgnoresOutliers) {
  for (const double tolerance : {0.0, 0.3}) {
    for (const int count : {10, 15, 100}) {
      const std::vector<Eigen::Vector3d> from = cloud(7, count);
      std::vector<Eigen::Vector3d> to = moved(some_similarity(), from);
      std::vector<Eigen::Vector3d> good_from;
      std::vector<Eigen::Vector3d> good_to;
      Rng rng(8);
      for (std::size_t k = 0; k < to.size(); ++k) {
        const double sigma = k % 5 < 2 ? 40 : 0.05;
        for (int i = 0; i < 3; ++i) to[k][i] += rng.normal(0, sigma);
        if (k % 5 < 2) continue;
        good_from.push_back(from[k]);
        good_to.push_back(to[k]);
      }
      const auto found = robust_similarity(from, to, tolerance, 9);
      const auto best = similarity_between(good_from, good_to);
      ASSERT_TRUE(found && best);
      expect_near(*found, *best, 0.01);
      EXPECT_LT(max_residual(*found, good_from, good_to), 0.3);
      const auto again = robust_similarity(from, to, tolerance, 9);
      ASSERT_TRUE(again);
      EXPECT_EQ(found->scale, again->scale);
    }
  }
}

TEST(RobustSimilarity, FindsOneWrongOfFive) {
  const std::vector<Eigen::Vector3d> from = cloud(10, 5);
  std::vector<Eigen::Vector3d> to = moved(some_similarity(), from);
  to[1][2] += 30;
  const auto found = robust_similarity(from, to, 0, 1);
  ASSERT_TRUE(found);
  expect_near(*found, some_similarity(), 1e-9);
  const std::vector<double> residuals = residuals_of(*found, from, to);
  EXPECT_NEAR(residuals[1], 30, 1e-6);
}

// With few pairs and noise it must be close to the plain fit, which uses all pairs.
TEST(RobustSimilarity, RejectsFewInliers) {
  int close = 0;
  for (std::uint64_t seed = 20; seed < 40; ++seed) {
    const std::vector<Eigen::Vector3d> from = cloud(seed, 8);
    std::vector<Eigen::Vector3d> to = moved(some_similarity(), from);
    Rng rng(seed);
    for (Eigen::Vector3d& x : to) {
      for (int i = 0; i < 3; ++i) x[i] += rng.normal(0, 0.05);
    }
    const auto plain = similarity_between(from, to);
    const auto robust = robust_similarity(from, to, 0, seed);
    ASSERT_TRUE(plain && robust);
    if ((plain->translation - robust->translation).norm() < 0.01) ++close;
  }
  EXPECT_GE(close, 15);
}

TEST(RobustSimilarity, KeepsAllExactPairs) {
  const std::vector<Eigen::Vector3d> from = cloud(11, 30, {1e6, 2e6, 3e6});
  const auto found = robust_similarity(from, moved(some_similarity(), from), 0, 1);
  ASSERT_TRUE(found);
  EXPECT_LT(max_residual(*found, from, moved(some_similarity(), from)), 1e-5);
}

TEST(TransformModel, PreservesTheProjections) {
  const Model before = synthetic_model();
  Model after = before;
  transform(after, some_similarity());
  int checked = 0;
  for (std::size_t p = 0; p < before.points.size(); ++p) {
    EXPECT_LT((after.points[p].position - some_similarity() * before.points[p].position).norm(),
              1e-9);
    for (const auto& [i, f] : before.points[p].track) {
      const Image& image = after.images[static_cast<std::size_t>(i)];
      const auto pixel = after.cameras[static_cast<std::size_t>(image.camera)].project(
          image.pose * after.points[p].position);
      ASSERT_TRUE(pixel);
      const cv::Point2f& feature = image.features[static_cast<std::size_t>(f)];
      EXPECT_NEAR(pixel->x, feature.x, 1e-3);
      EXPECT_NEAR(pixel->y, feature.y, 1e-3);
      ++checked;
    }
  }
  EXPECT_GT(checked, 200);
  for (std::size_t i = 0; i < before.images.size(); ++i) {
    if (!before.images[i].registered) continue;
    const Eigen::Vector3d expected = some_similarity() * before.images[i].pose.center();
    EXPECT_LT((after.images[i].pose.center() - expected).norm(), 1e-9);
  }
  transform(after, some_similarity().inverse());
  EXPECT_LT((after.points[0].position - before.points[0].position).norm(), 1e-9);
}

TEST(TransformModel, RefusesInvalidSimilarities) {
  Model model = synthetic_model();
  EXPECT_THROW(transform(model, {0, Eigen::Matrix3d::Identity(), {0, 0, 0}}),
               std::invalid_argument);
  EXPECT_THROW(transform(model, {1, Eigen::Vector3d(1, 1, -1).asDiagonal(), {0, 0, 0}}),
               std::invalid_argument);
  EXPECT_THROW(transform(model, {1, Eigen::Matrix3d::Identity(), {0, 0, 1 / 0.0}}),
               std::invalid_argument);
}

class PositionsTest : public FolderTest {
 protected:
  std::map<std::string, Eigen::Vector3d> read(const std::string& text) {
    write_file_atomically(path("positions.csv"), text);
    return read_positions_csv(path("positions.csv"));
  }
  std::string refusal(const std::string& text) {
    try {
      (void)read(text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
};

TEST_F(PositionsTest, AreReadWithAndWithoutHeader) {
  const std::map<std::string, Eigen::Vector3d> expected{{"a b.jpg", {1, -2.5, 3e2}},
                                                        {"c,\"d\".jpg", {0, 0, 1}}};
  const std::string lines = " a b.jpg , 1,\t-2.5,3e2\r\n\n\"c,\"\"d\"\".jpg\" ,0,+0,1";
  EXPECT_EQ(read(lines), expected);
  EXPECT_EQ(read("\xEF\xBB\xBFname, x, y, z\r\n" + lines + "\n\n"), expected);
}

TEST_F(PositionsTest, ErrorsNameTheLine) {
  EXPECT_THAT(refusal("name,x,y,z\na,1,2,3\n\nb,1,2\n"),
              AllOf(HasSubstr("positions.csv"), HasSubstr("line 4"), HasSubstr("name,x,y,z")));
  EXPECT_THAT(refusal("a,1,2,3,4\n"), AllOf(HasSubstr("line 1"), HasSubstr("more than")));
  EXPECT_THAT(refusal("a,1,x,3\n"), AllOf(HasSubstr("line 1"), HasSubstr("'x'")));
  EXPECT_THAT(refusal("a,1,2,3\nname,x,y,z\n"), HasSubstr("line 2"));
  EXPECT_THAT(refusal("a,1,2,nan\n"), HasSubstr("'nan'"));
  EXPECT_THAT(refusal("a,1,2,inf\n"), HasSubstr("'inf'"));
  EXPECT_THAT(refusal("a,1,2,1e13\n"), HasSubstr("'1e13'"));
  EXPECT_THAT(refusal("a,1,2,\n"), HasSubstr("line 1"));
  EXPECT_THAT(refusal(" ,1,2,3\n"), HasSubstr("empty"));
  EXPECT_THAT(refusal("a,1,2,3\na,1,2,4\n"), AllOf(HasSubstr("line 2"), HasSubstr("twice")));
  EXPECT_THAT(refusal("\"a,1,2,3\n"), HasSubstr("\" is missing"));
  EXPECT_THAT(refusal("\"a\"b,1,2,3\n"), HasSubstr("comma"));
  EXPECT_THAT(refusal(""), HasSubstr("no position"));
  EXPECT_THAT(refusal("name,x,y,z\n"), HasSubstr("no position"));
  EXPECT_THROW((void)read_positions_csv(path("missing.csv")), InputError);
  EXPECT_THROW((void)read_positions_csv(folder_), InputError);
}

}  // namespace
}  // namespace tarsier::sfm
