// SPDX-License-Identifier: MIT
#include "tarsier/synth/relief.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::synth {
namespace {

SceneOptions small(Content content = Content::kRelief, Trajectory trajectory = Trajectory::kArc) {
  SceneOptions options;
  options.size = {240, 180};
  options.images = 5;
  options.content = content;
  options.trajectory = trajectory;
  options.noise = 0;
  return options;
}

bool is_same(const cv::Mat& a, const cv::Mat& b) { return cv::norm(a, b, cv::NORM_INF) == 0; }

TEST(ReliefScene, DetailsAreAllThatTellTheSidesOfASymmetricBoxApart) {
  SceneOptions options = small(Content::kSymmetric, Trajectory::kRing);
  options.images = 4;  // one side each
  options.details = 0;
  const cv::Mat plain = ReliefScene(options).render(0);
  options.details = 0.1;
  const ReliefScene scene(options);
  cv::Mat differs;
  cv::absdiff(plain, scene.render(0), differs);
  cv::cvtColor(differs, differs, cv::COLOR_BGR2GRAY);
  cv::Mat side;
  cv::cvtColor(plain, side, cv::COLOR_BGR2GRAY);
  const double share = static_cast<double>(cv::countNonZero(differs > 3)) /
                       cv::countNonZero(side < 160);  // without white and top
  EXPECT_GT(share, 0.05);
  EXPECT_LT(share, 0.15);
  EXPECT_EQ(plain.at<cv::Vec3b>(2, 2), cv::Vec3b(250, 250, 250));
  options.details = 0.6;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

TEST(ReliefScene, DepthAndPosesFitTheImages) {
  for (const Content content : {Content::kRelief, Content::kBoxes, Content::kPlane, Content::kRoom,
                                Content::kThin, Content::kPatchy, Content::kSymmetric}) {
    for (const Trajectory trajectory : {Trajectory::kArc, Trajectory::kRing, Trajectory::kLine}) {
      const ReliefScene scene(small(content, trajectory));
      cv::Mat a;
      cv::Mat b;
      cv::blur(scene.render(0), a, {3, 3});
      cv::blur(scene.render(1), b, {3, 3});
      const geometry::Camera camera = scene.camera();
      std::vector<double> differences;
      for (int v = 10; v < a.rows - 10; v += 7) {
        for (int u = 10; u < a.cols - 10; u += 7) {
          const auto depth = scene.depth(0, cv::Point2d(u, v));
          if (!depth) continue;
          const Eigen::Vector3d in_a((u - camera.cx) / camera.fx * *depth,
                                     (v - camera.cy) / camera.fy * *depth, *depth);
          const Eigen::Vector3d in_b = scene.pose(1) * (scene.pose(0).inverse() * in_a);
          const cv::Point2d at(camera.fx * in_b[0] / in_b[2] + camera.cx,
                               camera.fy * in_b[1] / in_b[2] + camera.cy);
          if (at.x < 2 || at.y < 2 || at.x > b.cols - 3 || at.y > b.rows - 3) continue;
          const auto other = scene.depth(1, at);
          if (!other || std::abs(*other - in_b[2]) > 1e-3 * in_b[2]) continue;  // hidden there
          const cv::Vec3b x = a.at<cv::Vec3b>(v, u);
          const cv::Vec3b y = b.at<cv::Vec3b>(cvRound(at.y), cvRound(at.x));
          differences.push_back(std::abs(x[1] - y[1]));
        }
      }
      ASSERT_GT(differences.size(), 50U);
      std::nth_element(differences.begin(),
                       differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2),
                       differences.end());
      EXPECT_LT(differences[differences.size() / 2], 14);
    }
  }
}

TEST(ReliefScene, SeedsDecideAndThreadsDoNot) {
  const ReliefScene scene(small());
  cv::setNumThreads(1);
  const cv::Mat one = scene.render(2);
  cv::setNumThreads(3);
  EXPECT_TRUE(is_same(one, ReliefScene(small()).render(2)));
  cv::setNumThreads(-1);
  SceneOptions other = small();
  other.seed = 2;
  EXPECT_FALSE(is_same(one, ReliefScene(other).render(2)));
}

TEST(ReliefScene, ACameraThatOnlyTurnsStaysAtItsPlace) {
  SceneOptions options = small();
  options.pure_rotation = true;
  const ReliefScene scene(options);
  for (int i = 1; i < scene.count(); ++i) {
    EXPECT_LT((scene.pose(i).center() - scene.pose(0).center()).norm(), 1e-9);
    EXPECT_GT(geometry::angle_of(scene.pose(i).rotation * scene.pose(0).rotation.transpose()),
              0.05);
  }
}

TEST(ReliefScene, ARoomHasAFloorAndFinsAreThin) {
  const ReliefScene room(small(Content::kRoom));
  const ReliefScene boxes(small(Content::kBoxes));
  // Below the middle the floor is nearer than the wall.
  EXPECT_LT(*room.depth(2, {120, 175}), *boxes.depth(2, {120, 175}) - 1);
  const auto nearer = [](const ReliefScene& scene) {
    int count = 0;
    for (int v = 0; v < 180; v += 2)
      for (int u = 0; u < 240; u += 2)
        count += *scene.depth(2, cv::Point2d(u, v)) < *scene.depth(2, {0, 0}) - 0.5 ? 1 : 0;
    return count;
  };
  const int fins = nearer(ReliefScene(small(Content::kThin)));
  EXPECT_GT(fins, 10);
  EXPECT_LT(2 * fins, nearer(boxes));
}

TEST(ReliefScene, PatchesAreBareAndHighlightsAreBright) {
  const cv::Mat matt = ReliefScene(small()).render(2);
  const cv::Mat shiny = ReliefScene(small(Content::kShiny)).render(2);
  const cv::Mat patchy = ReliefScene(small(Content::kPatchy)).render(2);
  EXPECT_FALSE(is_same(matt, shiny));
  cv::Mat edges;
  cv::Laplacian(patchy, edges, CV_16S);
  cv::Mat flat;
  cv::inRange(edges, cv::Scalar::all(-2), cv::Scalar::all(2), flat);
  EXPECT_GT(cv::countNonZero(flat), 240 * 180 / 5);
}

TEST(ReliefScene, NothingIsOneColour) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(ReliefScene(small(Content::kNothing)).render(0), mean, deviation);
  EXPECT_LT(deviation[1], 8);
  cv::meanStdDev(ReliefScene(small()).render(0), mean, deviation);
  EXPECT_GT(deviation[1], 20);
}

TEST(ReliefScene, TheTrianglesLieOnTheSurfaceThatIsDrawn) {
  for (const Content content :
       {Content::kRelief, Content::kBoxes, Content::kRoom, Content::kThin}) {
    for (const Trajectory trajectory : {Trajectory::kArc, Trajectory::kRing, Trajectory::kLine}) {
      const ReliefScene scene(small(content, trajectory));
      const SceneSurface surface = scene.surface(0.07);
      const geometry::Camera camera = scene.camera();
      const auto corner = [&](const std::array<int, 3>& triangle, std::size_t k) {
        return surface.vertices[static_cast<std::size_t>(triangle[k])].cast<double>().eval();
      };
      int seen = 0;
      int facing = 0;
      cv::Mat1b covered(camera.height, camera.width, static_cast<unsigned char>(0));
      for (const std::array<int, 3>& triangle : surface.triangles) {
        const Eigen::Vector3d middle =
            (corner(triangle, 0) + corner(triangle, 1) + corner(triangle, 2)) / 3;
        const Eigen::Vector3d normal = (corner(triangle, 1) - corner(triangle, 0))
                                           .cross(corner(triangle, 2) - corner(triangle, 0));
        const Eigen::Vector3d at = scene.pose(1) * middle;
        const auto pixel = camera.project(at);
        if (!pixel || !cv::Rect2d(0, 0, camera.width - 1, camera.height - 1).contains(*pixel))
          continue;
        // Nothing that is drawn lies behind a triangle, but for the sag between its corners.
        const auto depth = scene.depth(1, *pixel);
        ASSERT_TRUE(depth.has_value());
        if (*depth < at[2] - 0.05) continue;  // hidden
        ++seen;
        facing += normal.dot(scene.pose(1).center() - middle) > 0 ? 1 : 0;
        EXPECT_NEAR(*depth, at[2], 0.05);
        covered(cvRound(pixel->y), cvRound(pixel->x)) = 255;
      }
      ASSERT_GT(seen, 1000);
      EXPECT_GT(facing, 0.97 * seen);
      // And it leaves out nothing of what is seen.
      cv::dilate(covered, covered, cv::Mat::ones(5, 5, CV_8U));
      EXPECT_GT(cv::countNonZero(covered), 0.99 * static_cast<double>(covered.total()));
    }
  }
}

TEST(ReliefScene, ImpossibleOptionsAreRefused) {
  SceneOptions options = small();
  options.images = 0;
  EXPECT_THROW(ReliefScene{options}, std::invalid_argument);
  EXPECT_THROW((void)ReliefScene(small()).render(5), std::invalid_argument);
  EXPECT_THROW((void)ReliefScene(small()).surface(0), std::invalid_argument);
}

TEST(PointProblem, WithoutNoiseItReprojectsExactly) {
  const PointProblem problem = make_point_problem(3, 5, 100, 0, 0);
  ASSERT_GT(problem.seen.size(), 200U);
  for (const auto& seen : problem.seen) {
    const auto pixel = problem.camera.project(problem.poses[static_cast<std::size_t>(seen.image)] *
                                              problem.points[static_cast<std::size_t>(seen.point)]);
    ASSERT_TRUE(pixel.has_value());
    EXPECT_LT(cv::norm(*pixel - seen.pixel), 1e-9);
    EXPECT_FALSE(seen.outlier);
  }
}

TEST(PointProblem, OutliersAreFarFromTheTruth) {
  const PointProblem problem = make_point_problem(3, 5, 200, 0.5, 0.2);
  int outliers = 0;
  for (const auto& seen : problem.seen) {
    const auto pixel = problem.camera.project(problem.poses[static_cast<std::size_t>(seen.image)] *
                                              problem.points[static_cast<std::size_t>(seen.point)]);
    ASSERT_TRUE(pixel.has_value());
    const double away = cv::norm(*pixel - seen.pixel);
    outliers += seen.outlier;
    EXPECT_EQ(seen.outlier, away > 9) << away;
  }
  EXPECT_NEAR(static_cast<double>(outliers) / static_cast<double>(problem.seen.size()), 0.2, 0.06);
}

}  // namespace
}  // namespace tarsier::synth
