// SPDX-License-Identifier: MIT
#include "tarsier/synth/sfm_scene.h"

#include "tarsier/synth/sfm_scene_streets.h"
#include "tarsier/synth/testing_images.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>
#include <vector>

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

// The trajectories that a content supports.
std::vector<Trajectory> trajectories_of(Content content) {
  if (content == Content::kHouses) return {Trajectory::kWalk, Trajectory::kCity};
  std::vector<Trajectory> some{Trajectory::kArc, Trajectory::kRing, Trajectory::kLine};
  if (content == Content::kRelief || content == Content::kBoxes || content == Content::kPlane)
    some.push_back(Trajectory::kGrid);
  return some;
}

// Agreement of an object's colours in its first image with those at the point half a rotation
// around it, in the opposite image. It compares the share of red, which does not depend on the
// light.
double correlation_after_half_turn(const SfmScene& scene) {
  const int opposite = scene.count() / 2;
  const geometry::Camera camera = scene.camera();
  cv::Mat a;
  cv::Mat b;
  cv::blur(scene.render(0), a, {3, 3});
  cv::blur(scene.render(opposite), b, {3, 3});
  const auto red_share = [](const cv::Vec3b& pixel) {
    return static_cast<float>(pixel[2]) / static_cast<float>(1 + pixel[0] + pixel[1] + pixel[2]);
  };
  std::vector<float> here;
  std::vector<float> there;
  for (int v = 0; v < a.rows; v += 2) {
    for (int u = 0; u < a.cols; u += 2) {
      const auto depth = scene.depth(0, cv::Point2d(u, v));
      if (!depth) continue;
      Eigen::Vector3d at =
          scene.pose(0).inverse() * Eigen::Vector3d((u - camera.cx) / camera.fx * *depth,
                                                    (v - camera.cy) / camera.fy * *depth, *depth);
      if (at.z() < 0.05) continue;  // the ground
      const Eigen::Vector3d turned =
          scene.pose(opposite) * Eigen::Vector3d(-at.x(), -at.y(), at.z());
      const auto pixel = camera.project(turned);
      if (!pixel || !cv::Rect2d(1, 1, a.cols - 3, a.rows - 3).contains(*pixel)) continue;
      const auto visible = scene.depth(opposite, *pixel);
      if (!visible || std::abs(*visible - turned.z()) > 1e-3 * turned.z()) continue;
      here.push_back(red_share(a.at<cv::Vec3b>(v, u)));
      there.push_back(red_share(b.at<cv::Vec3b>(cvRound(pixel->y), cvRound(pixel->x))));
    }
  }
  EXPECT_GT(here.size(), 500U);
  cv::Mat correlation;
  cv::matchTemplate(cv::Mat(here), cv::Mat(there), correlation, cv::TM_CCOEFF_NORMED);
  return correlation.at<float>(0);
}

TEST(SfmScene, SymmetricBoxSidesDifferOnlyInDetails) {
  SceneOptions options = small(Content::kSymmetric, Trajectory::kRing);
  options.images = 4;  // one side each
  options.details = 0;
  const cv::Mat plain = SfmScene(options).render(0);
  options.details = 0.1;
  const SfmScene scene(options);
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

TEST(SfmScene, DepthAndPosesMatchImages) {
  for (const Content content :
       {Content::kRelief, Content::kBoxes, Content::kPlane, Content::kRoom, Content::kThin,
        Content::kPatchy, Content::kSymmetric, Content::kTemple, Content::kToy, Content::kHouses}) {
    for (const Trajectory trajectory : trajectories_of(content)) {
      SceneOptions options = small(content, trajectory);
      // All of it, even with few images.
      if (trajectory == Trajectory::kCity) options.images = 100;
      const SfmScene scene(options);
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

TEST(SfmScene, DependsOnSeedNotThreads) {
  for (const SceneOptions& options :
       {small(), small(Content::kRelief, Trajectory::kGrid),
        small(Content::kHouses, Trajectory::kWalk), small(Content::kHouses, Trajectory::kCity),
        small(Content::kTemple, Trajectory::kRing), small(Content::kToy, Trajectory::kRing)}) {
    const SfmScene scene(options);
    cv::setNumThreads(1);
    const cv::Mat one = scene.render(2);
    cv::setNumThreads(3);
    EXPECT_TRUE(is_same(one, SfmScene(options).render(2)));
    cv::setNumThreads(-1);
    SceneOptions other = options;
    other.seed = 2;
    EXPECT_FALSE(is_same(one, SfmScene(other).render(2)));
  }
}

TEST(SfmScene, TempleAndToyAreSymmetricUnderHalfTurnExceptDetails) {
  for (const Content content : {Content::kTemple, Content::kToy}) {
    SceneOptions options = small(content, Trajectory::kRing);
    options.size = {480, 360};
    options.focal_px = 800;
    options.images = 4;
    options.details = 0;
    const double plain = correlation_after_half_turn(SfmScene(options));
    options.details = 0.5;
    const double detailed = correlation_after_half_turn(SfmScene(options));
    EXPECT_GT(plain, 0.85);
    EXPECT_LT(detailed, plain - 0.2);
  }
}

TEST(SfmScene, StreetCamerasFaceHouses) {
  for (const Trajectory trajectory : {Trajectory::kWalk, Trajectory::kCity}) {
    SceneOptions options = small(Content::kHouses, trajectory);
    options.images = 60;
    const SfmScene scene(options);
    const geometry::Camera camera = scene.camera();
    int near = 0;
    for (int i = 0; i < scene.count(); ++i) {
      // Nothing is close to the camera, and mostly there is a house front ahead.
      for (const double u : {5.0, camera.cx, camera.width - 5.0}) {
        const auto depth = scene.depth(i, {u, camera.cy});
        EXPECT_GT(depth.value_or(99), 1.5) << i;
      }
      const auto ahead = scene.depth(i, {camera.cx, camera.cy});
      near += ahead && *ahead < 25 ? 1 : 0;
    }
    EXPECT_GT(near, 45);
    // The route through a city returns to its start; the one along a street does not.
    double nearest = 1e9;
    for (int i = 30; i < scene.count(); ++i)
      nearest = std::min(nearest, (scene.pose(i).center() - scene.pose(0).center()).norm());
    if (trajectory == Trajectory::kCity)
      EXPECT_LT(nearest, 15);
    else
      EXPECT_GT(nearest, 30);
  }
}

TEST(SfmScene, GridCamerasLookDownInRows) {
  SceneOptions options = small(Content::kRelief, Trajectory::kGrid);
  options.images = 9;
  const SfmScene scene(options);
  for (int i = 0; i < 9; ++i) {
    EXPECT_LT(scene.pose(i).rotation(2, 2), -0.98);  // the axis looks down
    EXPECT_NEAR(scene.pose(i).center().z(), 10, 0.3);
  }
  // The flight goes back and forth: the first position of a row is above the last of the previous
  // row.
  EXPECT_LT(std::abs(scene.pose(3).center().x() - scene.pose(2).center().x()), 0.5);
  EXPECT_NEAR(scene.pose(3).center().y() - scene.pose(2).center().y(), 2, 0.8);
}

TEST(DrawnStreets, RepeatedHousesHaveSixDesigns) {
  const auto designs = [](const Streets& streets) {
    std::set<std::uint64_t> distinct;
    int count = 0;
    for (const House& house : streets.houses) {
      if (!house.has_windows) continue;  // a bay
      distinct.insert(house.design);
      ++count;
    }
    return std::pair(distinct.size(), count);
  };
  const auto [all, houses] = designs(make_city(100, 0, Rng(1)));
  EXPECT_EQ(static_cast<int>(all), houses);
  EXPECT_EQ(designs(make_city(100, 1, Rng(1))).first, 6U);
  EXPECT_EQ(designs(make_city(100, 1, Rng(1))).second, houses);
}

TEST(SfmScene, PureRotationKeepsCenter) {
  SceneOptions options = small();
  options.pure_rotation = true;
  const SfmScene scene(options);
  for (int i = 1; i < scene.count(); ++i) {
    EXPECT_LT((scene.pose(i).center() - scene.pose(0).center()).norm(), 1e-9);
    EXPECT_GT(geometry::angle_of(scene.pose(i).rotation * scene.pose(0).rotation.transpose()),
              0.05);
  }
}

TEST(SfmScene, ARoomHasAFloorAndFinsAreThin) {
  const SfmScene room(small(Content::kRoom));
  const SfmScene boxes(small(Content::kBoxes));
  // Below the middle, the floor is nearer than the wall.
  EXPECT_LT(*room.depth(2, {120, 175}), *boxes.depth(2, {120, 175}) - 1);
  const auto nearer = [](const SfmScene& scene) {
    int count = 0;
    for (int v = 0; v < 180; v += 2)
      for (int u = 0; u < 240; u += 2)
        count += *scene.depth(2, cv::Point2d(u, v)) < *scene.depth(2, {0, 0}) - 0.5 ? 1 : 0;
    return count;
  };
  const int fins = nearer(SfmScene(small(Content::kThin)));
  EXPECT_GT(fins, 10);
  EXPECT_LT(2 * fins, nearer(boxes));
}

TEST(SfmScene, PatchesAreUntexturedAndHighlightsAreBright) {
  const cv::Mat matt = SfmScene(small()).render(2);
  const cv::Mat shiny = SfmScene(small(Content::kShiny)).render(2);
  const cv::Mat patchy = SfmScene(small(Content::kPatchy)).render(2);
  EXPECT_FALSE(is_same(matt, shiny));
  cv::Mat edges;
  cv::Laplacian(patchy, edges, CV_16S);
  cv::Mat flat;
  cv::inRange(edges, cv::Scalar::all(-2), cv::Scalar::all(2), flat);
  EXPECT_GT(cv::countNonZero(flat), 240 * 180 / 5);
}

TEST(SfmScene, ContentNothingHasOneColor) {
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(SfmScene(small(Content::kNothing)).render(0), mean, deviation);
  EXPECT_LT(deviation[1], 8);
  cv::meanStdDev(SfmScene(small()).render(0), mean, deviation);
  EXPECT_GT(deviation[1], 20);
}

TEST(SfmScene, TrianglesMatchRenderedSurface) {
  for (const Content content : {Content::kRelief, Content::kBoxes, Content::kRoom, Content::kThin,
                                Content::kTemple, Content::kToy}) {
    for (const Trajectory trajectory : trajectories_of(content)) {
      // From a ring, temple and toy stand on an unbounded ground.
      const bool is_tall = content == Content::kTemple || content == Content::kToy;
      if (is_tall && trajectory == Trajectory::kRing) continue;
      const SfmScene scene(small(content, trajectory));
      const SceneSurface surface = scene.surface(0.07);
      const geometry::Camera camera = scene.camera();
      const auto corner = [&](const std::array<int, 3>& triangle, std::size_t k) {
        return surface.vertices[static_cast<std::size_t>(triangle[k])].cast<double>().eval();
      };
      int seen = 0;
      int facing = 0;
      int missed = 0;
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
        // No rendered point lies behind a triangle, except for the sag between its corners.
        const auto depth = scene.depth(1, *pixel);
        if (!depth) {  // beside an edge in front of the sky
          ++missed;
          continue;
        }
        if (*depth < at[2] - 0.05) continue;  // hidden
        ++seen;
        facing += normal.dot(scene.pose(1).center() - middle) > 0 ? 1 : 0;
        EXPECT_NEAR(*depth, at[2], 0.05);
        covered(cvRound(pixel->y), cvRound(pixel->x)) = 255;
      }
      ASSERT_GT(seen, 1000);
      EXPECT_GT(facing, 0.97 * seen);
      EXPECT_LT(missed, 0.002 * seen);
      // And the surface contains everything that is visible.
      cv::dilate(covered, covered, cv::Mat::ones(5, 5, CV_8U));
      int shown = 0;
      int left_out = 0;
      for (int v = 0; v < covered.rows; v += 2) {
        for (int u = 0; u < covered.cols; u += 2) {
          if (!scene.depth(1, cv::Point2d(u, v))) continue;
          ++shown;
          left_out += covered(v, u) == 0 ? 1 : 0;
        }
      }
      EXPECT_LT(left_out, 0.01 * shown);
    }
  }
}

TEST(SfmScene, RejectsInvalidOptions) {
  SceneOptions options = small();
  options.images = 0;
  EXPECT_THROW(SfmScene{options}, std::invalid_argument);
  EXPECT_THROW((void)SfmScene(small()).render(5), std::invalid_argument);
  EXPECT_THROW((void)SfmScene(small()).surface(0), std::invalid_argument);
  EXPECT_THROW(SfmScene{small(Content::kHouses, Trajectory::kRing)}, std::invalid_argument);
  EXPECT_THROW(SfmScene{small(Content::kRelief, Trajectory::kWalk)}, std::invalid_argument);
  EXPECT_THROW(SfmScene{small(Content::kRoom, Trajectory::kGrid)}, std::invalid_argument);
  options = small(Content::kHouses, Trajectory::kCity);
  options.repeats = 1.5;
  EXPECT_THROW(SfmScene{options}, std::invalid_argument);
}

TEST(PointProblem, WithoutNoiseItReprojectsExactly) {
  const PointProblem problem = make_point_problem(3, 5, 100, 0, 0);
  ASSERT_GT(problem.observations.size(), 200U);
  for (const auto& seen : problem.observations) {
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
  for (const auto& seen : problem.observations) {
    const auto pixel = problem.camera.project(problem.poses[static_cast<std::size_t>(seen.image)] *
                                              problem.points[static_cast<std::size_t>(seen.point)]);
    ASSERT_TRUE(pixel.has_value());
    const double away = cv::norm(*pixel - seen.pixel);
    outliers += seen.outlier;
    EXPECT_EQ(seen.outlier, away > 9) << away;
  }
  EXPECT_NEAR(static_cast<double>(outliers) / static_cast<double>(problem.observations.size()), 0.2,
              0.06);
}

}  // namespace
}  // namespace tarsier::synth
