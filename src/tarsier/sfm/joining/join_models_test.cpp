// SPDX-License-Identifier: MIT
#include "tarsier/sfm/joining/join_models.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/joining/joined_mapper.h"
#include "tarsier/sfm/mapper/testing_centers.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap_binary.h"

#include <Eigen/Geometry>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

constexpr int kModelImages = 60;

// Images around a full circle, looking outwards at a rough wall. About nine images observe each
// point.
Model scene(double noise_px, double wall = 20, int images = kModelImages) {
  Rng rng(3);
  Model model;
  model.cameras = {{640, 480, 500, 500, 319.5, 239.5, {}, 0}};
  for (int i = 0; i < images; ++i) {
    const double angle = 2 * std::numbers::pi * i / images;
    const Eigen::Vector3d forward(std::cos(angle), std::sin(angle), 0);
    Image image;
    image.name = "image-" + std::to_string(i);
    image.registered = true;
    image.pose.rotation.row(0) = Eigen::Vector3d(-std::sin(angle), std::cos(angle), 0);
    image.pose.rotation.row(2) = forward;
    image.pose.rotation.row(1) = forward.cross(Eigen::Vector3d(image.pose.rotation.row(0)));
    image.pose.translation =
        -(image.pose.rotation * (8 * forward + Eigen::Vector3d(0, 0, 0.5 * std::sin(5 * angle))));
    model.images.push_back(image);
  }
  for (int p = 0; p < 3000; ++p) {
    const double angle = rng.uniform(0, 2 * std::numbers::pi);
    const double radius = wall * rng.uniform(0.9, 1.1);
    Point point;
    point.position = {radius * std::cos(angle), radius * std::sin(angle),
                      0.3 * wall * rng.uniform(-1, 1)};
    point.color = {10, 20, 30};
    for (int i = 0; i < images; ++i) {
      Image& image = model.images[static_cast<std::size_t>(i)];
      const auto pixel = model.cameras[0].project(image.pose * point.position);
      if (!pixel || pixel->x < 0 || pixel->y < 0 || pixel->x > 639 || pixel->y > 479) continue;
      point.track.push_back({i, static_cast<int>(image.features.size())});
      image.features.emplace_back(static_cast<float>(pixel->x + noise_px * rng.normal()),
                                  static_cast<float>(pixel->y + noise_px * rng.normal()));
    }
    if (point.track.size() < 3) {
      for (const Observation& seen : point.track)
        model.images[static_cast<std::size_t>(seen.image)].features.pop_back();
      continue;
    }
    model.points.push_back(point);
  }
  for (Image& image : model.images) image.points.assign(image.features.size(), -1);
  for (std::size_t p = 0; p < model.points.size(); ++p)
    for (const Observation& seen : model.points[p].track)
      model.images[static_cast<std::size_t>(seen.image)]
          .points[static_cast<std::size_t>(seen.feature)] = static_cast<int>(p);
  return model;
}

std::vector<int> range_of(int first, int last) {
  std::vector<int> images;
  for (int i = first; i < last; ++i) images.push_back(i % kModelImages);
  return images;
}

// The model that a mapper would make from some of the images: these images, and the points that
// three of them observe. It is adjusted, and has any position and scale.
Model piece(const Model& whole, const std::vector<int>& images, std::uint64_t seed) {
  Model model = whole;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    Image& image = model.images[i];
    image.points.assign(image.features.size(), -1);
    if (std::find(images.begin(), images.end(), static_cast<int>(i)) != images.end()) continue;
    Image empty;
    empty.name = image.name;
    image = empty;
  }
  model.points.clear();
  for (const Point& point : whole.points) {
    Point copy = point;
    std::erase_if(copy.track, [&](const Observation& seen) {
      return !model.images[static_cast<std::size_t>(seen.image)].registered;
    });
    if (copy.track.size() < 3) continue;
    for (const Observation& seen : copy.track)
      model.images[static_cast<std::size_t>(seen.image)]
          .points[static_cast<std::size_t>(seen.feature)] = static_cast<int>(model.points.size());
    model.points.push_back(copy);
  }
  (void)adjust(model, {});
  Rng rng(seed);
  geometry::Sim3 anywhere;
  anywhere.scale = std::exp(rng.uniform(-1, 1));
  anywhere.rotation = geometry::rotation_by(
      Eigen::Vector3d(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(-2, 2)));
  anywhere.translation = {rng.uniform(-50, 50), rng.uniform(-50, 50), rng.uniform(-50, 50)};
  transform(model, anywhere);
  return model;
}

std::vector<geometry::Rigid3> poses_of(const Model& model) {
  std::vector<geometry::Rigid3> poses;
  for (const Image& image : model.images) poses.push_back(image.pose);
  return poses;
}

int registered(const Model& model) {
  return static_cast<int>(std::count_if(model.images.begin(), model.images.end(),
                                        [](const Image& image) { return image.registered; }));
}

JoinedModels join(const std::vector<Model>& pieces) {
  std::vector<std::string> names;
  for (std::size_t m = 0; m < pieces.size(); ++m) names.push_back("part " + std::to_string(m));
  return join_models(pieces, names, {}, {});
}

TEST(ModelJoin, JoinsTwoPiecesExactly) {
  const Model whole = scene(0);
  const JoinedModels joined =
      join({piece(whole, range_of(0, 25), 1), piece(whole, range_of(18, 45), 2)});
  ASSERT_EQ(joined.joins.size(), 1U);
  const ModelJoin& found = joined.joins[0];
  EXPECT_EQ(found.refusal, "");
  EXPECT_EQ(found.images, 7);
  EXPECT_EQ(found.agreeing, 7);
  EXPECT_GT(found.points, 300);
  EXPECT_EQ(found.inliers, found.points);
  EXPECT_LT(found.rotation_deg, 1e-4);
  ASSERT_EQ(joined.models.size(), 1U);
  const Model& model = joined.models[0];
  EXPECT_EQ(registered(model), 45);
  EXPECT_LT(worst_center(model, poses_of(whole)), 1e-5);
  check_model(model);
  EXPECT_EQ(model.points[0].color, cv::Vec3b(10, 20, 30));
  EXPECT_THAT(joined.log, Contains(HasSubstr("joined: part 0 and part 1: 7 images")));
  // A point of both pieces becomes one point with the observations of both.
  std::size_t max_track = 0;
  for (const Point& point : model.points) max_track = std::max(max_track, point.track.size());
  std::size_t true_max_track = 0;
  for (const Point& point : whole.points)
    true_max_track = std::max(true_max_track, point.track.size());
  EXPECT_EQ(max_track, true_max_track);
}

TEST(ModelJoin, ErrorIsThatOfWholeModel) {
  const Model whole = scene(0.5);
  const std::vector<geometry::Rigid3> truth = poses_of(whole);
  std::vector<Model> pieces;
  for (int k = 0; k < 3; ++k)
    pieces.push_back(
        piece(whole, range_of(15 * k, 15 * k + 22), 10 + static_cast<std::uint64_t>(k)));
  const JoinedModels joined = join(pieces);
  ASSERT_EQ(joined.models.size(), 1U);
  EXPECT_EQ(registered(joined.models[0]), 52);
  EXPECT_EQ(joined.joined_in, (std::vector<int>{0, 0, 0}));
  check_model(joined.models[0]);
  Model all = piece(whole, range_of(0, 52), 4);
  EXPECT_LT(worst_center(joined.models[0], truth), 1.2 * worst_center(all, truth));
}

// Each piece drifts from one end to the other. So the ends of the chain do not meet.
TEST(ModelJoin, ClosesCycleOpenedByDrift) {
  constexpr double kBend = 0.01;
  const Model whole = scene(0.5);
  std::vector<Model> pieces;
  for (int k = 0; k < 6; ++k) {
    Model made = piece(whole, range_of(10 * k, 10 * k + 15), 20 + static_cast<std::uint64_t>(k));
    // The scale grows with the distance from the first image.
    const auto center = [&](int i) {
      return made.images[static_cast<std::size_t>(i % kModelImages)].pose.center();
    };
    const Eigen::Vector3d origin = center(10 * k);
    const double length = (center(10 * k + 14) - origin).norm();
    const auto bent = [&](const Eigen::Vector3d& x) -> Eigen::Vector3d {
      return origin + (1 + kBend * (x - origin).norm() / length) * (x - origin);
    };
    for (Image& image : made.images)
      if (image.registered)
        image.pose.translation = -(image.pose.rotation * bent(image.pose.center()));
    for (Point& point : made.points) point.position = bent(point.position);
    pieces.push_back(std::move(made));
  }
  const JoinedModels joined = join(pieces);
  EXPECT_EQ(joined.joins.size(), 6U);
  for (const ModelJoin& found : joined.joins) EXPECT_EQ(found.refusal, "");
  ASSERT_EQ(joined.models.size(), 1U);
  EXPECT_EQ(registered(joined.models[0]), kModelImages);
  check_model(joined.models[0]);
  const std::vector<geometry::Rigid3> truth = poses_of(whole);
  EXPECT_LT(worst_center(joined.models[0], truth),
            1.2 * worst_center(piece(whole, range_of(0, kModelImages), 4), truth));
}

TEST(ModelJoin, RefusesTwoCommonImages) {
  const Model whole = scene(0.3);
  const JoinedModels joined =
      join({piece(whole, range_of(0, 20), 1), piece(whole, range_of(18, 45), 2)});
  ASSERT_EQ(joined.joins.size(), 1U);
  EXPECT_EQ(joined.joins[0].refusal, "2 images in common, 3 are needed");
  ASSERT_EQ(joined.models.size(), 2U);
  EXPECT_EQ(registered(joined.models[0]), 27);  // the largest model first
  EXPECT_EQ(registered(joined.models[1]), 20);
  EXPECT_EQ(joined.joined_in, (std::vector<int>{1, 0}));
  EXPECT_THAT(joined.log, Contains(HasSubstr("not joined: part 0 and part 1")));
}

TEST(ModelJoin, RefusesFewCommonPoints) {
  const Model whole = scene(0.3);
  const Model first = piece(whole, range_of(0, 25), 1);
  Model second = piece(whole, range_of(18, 45), 2);
  JoinOptions options;
  options.min_points = 100'000;
  EXPECT_THAT(find_join(first, second, options).refusal, HasSubstr("points in common, 100000"));
  // Images without points.
  for (Image& image : second.images) std::fill(image.points.begin(), image.points.end(), -1);
  second.points.clear();
  EXPECT_EQ(find_join(first, second).refusal, "0 points in common, 30 are needed");
}

TEST(ModelJoin, RefusesMirroredPiece) {
  const Model whole = scene(0.3);
  Model second = piece(whole, range_of(15, 45), 2);
  const Eigen::Vector3d mirror(1, 1, -1);
  for (Point& point : second.points) point.position = mirror.cwiseProduct(point.position);
  for (Image& image : second.images) {
    if (!image.registered) continue;
    const Eigen::Vector3d center = mirror.cwiseProduct(image.pose.center());
    image.pose.rotation =
        Eigen::Vector3d(1, -1, 1).asDiagonal() * image.pose.rotation * mirror.asDiagonal();
    image.pose.translation = -(image.pose.rotation * center);
  }
  const JoinedModels joined = join({piece(whole, range_of(0, 30), 1), second});
  EXPECT_THAT(joined.joins[0].refusal, HasSubstr("points in common coincide after alignment"));
  EXPECT_EQ(joined.models.size(), 2U);
}

// Half of the common images and their points lie elsewhere in the second piece. This happens if one
// facade is taken for another.
TEST(ModelJoin, RefusesFoldedPiece) {
  const Model whole = scene(0.3);
  Model second = piece(whole, range_of(10, 40), 2);
  const geometry::Sim3 fold{1, geometry::rotation_by(Eigen::Vector3d(0.3, 0.2, 0.4)), {3, 1, 2}};
  for (int i = 10; i < 19; ++i) {
    Image& image = second.images[static_cast<std::size_t>(i)];
    image.pose = geometry::moved_camera(image.pose, fold);
  }
  for (Point& point : second.points)
    if (point.track.front().image < 16) point.position = fold * point.position;
  const ModelJoin found = find_join(piece(whole, range_of(0, 25), 1), second);
  EXPECT_NE(found.refusal, "");
  // If the points belong to few images, the check of the poses finds the fold.
  JoinOptions options;
  options.min_inlier_share = 0.2;
  EXPECT_THAT(find_join(piece(whole, range_of(0, 25), 1), second, options).refusal,
              HasSubstr("have the same pose in both models"));
}

TEST(ModelJoin, RefusesOtherFeaturesAndNonFiniteNumbers) {
  const Model whole = scene(0.3);
  const Model first = piece(whole, range_of(0, 25), 1);
  const Model good = piece(whole, range_of(18, 45), 2);
  Model second = good;
  second.images[20].features[5].x += 0.5F;
  EXPECT_EQ(find_join(first, second).refusal,
            "'image-20' has different features in the two models");
  second = good;
  second.images[20].features.pop_back();
  second.images[20].points.pop_back();
  EXPECT_EQ(find_join(first, second).refusal,
            "'image-20' has different features in the two models");
  second = good;
  second.images[21].pose.translation.x() = NAN;
  EXPECT_EQ(find_join(first, second).refusal, "the pose of 'image-21' is not finite");
  second = good;
  for (Point& point : second.points) point.position.x() = NAN;
  EXPECT_EQ(find_join(first, second).refusal, "0 points in common, 30 are needed");
}

// The wall is 150 times as far away as the distance between the images. Three images do not
// determine the scale.
TEST(ModelJoin, RefusesUndeterminedScale) {
  const Model whole = scene(0.5, 2000, 60);
  Model first = piece(whole, range_of(0, 12), 1);
  Model second = piece(whole, range_of(9, 21), 2);
  JoinOptions options;
  options.max_center_share = 1;
  const ModelJoin found = find_join(first, second, options);
  EXPECT_NE(found.refusal, "") << found.scale_error;
}

// The third piece has the first piece's images at a wrong place. Its join with the second piece has
// more points.
TEST(ModelJoin, RefusesJoinThatContradictsOthers) {
  const Model whole = scene(0.3);
  std::vector<int> images = range_of(20, 40);
  for (int i = 0; i < 6; ++i) images.push_back(i);
  Model third = piece(whole, images, 3);
  const geometry::Sim3 moved{1, geometry::rotation_by(Eigen::Vector3d(0, 0, 0.6)), {3, 1, 2}};
  for (int i = 0; i < 6; ++i) {
    Image& image = third.images[static_cast<std::size_t>(i)];
    image.pose = geometry::moved_camera(image.pose, moved);
  }
  for (Point& point : third.points)
    if (point.track.front().image < 6) point.position = moved * point.position;
  const JoinedModels joined =
      join({piece(whole, range_of(0, 15), 1), piece(whole, range_of(5, 32), 2), third});
  ASSERT_EQ(joined.joins.size(), 3U);
  EXPECT_EQ(joined.joins[0].refusal, "");
  EXPECT_THAT(joined.joins[1].refusal, HasSubstr("contradicts joins with more common points"));
  EXPECT_EQ(joined.joins[2].refusal, "");
  ASSERT_EQ(joined.models.size(), 1U);
  // Nothing determines the poses of the images of both the first and the third piece.
  EXPECT_EQ(registered(joined.models[0]), 34);
  EXPECT_EQ(joined.left_out.size(), 6U);
  EXPECT_THAT(joined.left_out.at(3), HasSubstr("its camera pose in part"));
  const std::vector<geometry::Rigid3> truth = poses_of(whole);
  EXPECT_LT(worst_center(joined.models[0], truth),
            1.2 * worst_center(piece(whole, range_of(6, 40), 4), truth));
}

TEST(ModelJoin, ResultDoesNotDependOnNumberOfThreads) {
  const Model whole = scene(0.5);
  std::vector<Model> pieces;
  for (int k = 0; k < 6; ++k)
    pieces.push_back(
        piece(whole, range_of(10 * k, 10 * k + 15), 30 + static_cast<std::uint64_t>(k)));
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const JoinedModels one = join(pieces);
  cv::setNumThreads(3);
  const JoinedModels three = join(pieces);
  cv::setNumThreads(threads);
  EXPECT_EQ(one.log, three.log);
  ASSERT_EQ(one.models.size(), three.models.size());
  ASSERT_EQ(one.models[0].points.size(), three.models[0].points.size());
  for (std::size_t p = 0; p < one.models[0].points.size(); ++p)
    ASSERT_EQ(one.models[0].points[p].position, three.models[0].points[p].position);
  for (std::size_t i = 0; i < one.models[0].images.size(); ++i)
    EXPECT_EQ(one.models[0].images[i].pose.translation, three.models[0].images[i].pose.translation);
}

TEST(ModelJoin, CanBeInterruptedAndRefusesOtherImages) {
  const Model whole = scene(0.3);
  std::stop_source stop;
  stop.request_stop();
  const std::vector<Model> pieces{piece(whole, range_of(0, 25), 1),
                                  piece(whole, range_of(18, 45), 2)};
  EXPECT_THROW((void)join_models(pieces, {"a", "b"}, {}, {}, stop.get_token()), Interrupted);
  Model other = pieces[1];
  other.images[3].name = "another";
  EXPECT_THROW((void)join_models({pieces[0], other}, {"a", "b"}, {}, {}), std::invalid_argument);
  EXPECT_TRUE(join_models({}, {}, {}, {}).models.empty());
}

// As read from files: only registered images, in any order, with their own cameras.
TEST(ModelJoin, IdentifiesImagesByName) {
  const Model whole = scene(0);
  std::vector<Model> files;
  for (int k = 0; k < 2; ++k) {
    Model made = piece(whole, range_of(18 * k, 25 + 20 * k), 1 + static_cast<std::uint64_t>(k));
    std::vector<int> to(made.images.size(), -1);
    Model file;
    file.cameras = made.cameras;
    file.cameras.insert(file.cameras.begin(), {100, 100, 90, 90, 50, 50, {}, 0});
    for (int i = kModelImages - 1; i >= 0; --i) {
      const Image& image = made.images[static_cast<std::size_t>(i)];
      if (!image.registered) continue;
      to[static_cast<std::size_t>(i)] = static_cast<int>(file.images.size());
      file.images.push_back(image);
      file.images.back().camera = 1;
    }
    file.points = made.points;
    for (Point& point : file.points)
      for (Observation& seen : point.track) seen.image = to[static_cast<std::size_t>(seen.image)];
    check_model(file);
    files.push_back(std::move(file));
  }
  const std::vector<Model> same = with_same_images(files);
  for (const Model& model : same) check_model(model);
  EXPECT_EQ(same[0].images.size(), 45U);
  // Two of the small pieces, and the common one of all images.
  EXPECT_EQ(same[0].cameras.size(), 3U);
  const JoinedModels joined = join(same);
  ASSERT_EQ(joined.models.size(), 1U);
  check_model(joined.models[0]);
  std::vector<geometry::Rigid3> truth;
  for (const Image& image : joined.models[0].images)
    for (const Image& known : whole.images)
      if (known.name == image.name) truth.push_back(known.pose);
  EXPECT_LT(worst_center(joined.models[0], truth), 1e-5);
}

// Pairs of neighbouring images, with all points that both observe.
std::vector<Pair> pairs_of(const Model& whole) {
  std::vector<Pair> pairs;
  for (int a = 0; a < kModelImages; ++a) {
    for (int d = 1; d <= 4; ++d) {
      Pair pair;
      pair.first = std::min(a, (a + d) % kModelImages);
      pair.second = std::max(a, (a + d) % kModelImages);
      const Image& first = whole.images[static_cast<std::size_t>(pair.first)];
      const Image& second = whole.images[static_cast<std::size_t>(pair.second)];
      std::vector<Match> inliers;
      for (const Point& point : whole.points) {
        Match match{-1, -1};
        for (const Observation& seen : point.track) {
          if (seen.image == pair.first) match.first = seen.feature;
          if (seen.image == pair.second) match.second = seen.feature;
        }
        if (match.first >= 0 && match.second >= 0) inliers.push_back(match);
      }
      pair.matches = pair.view.in_front = static_cast<int>(inliers.size());
      pair.view.inliers = std::move(inliers);
      pair.view.second_from_first = second.pose * first.pose.inverse();
      pair.view.second_from_first.translation.normalize();
      pair.view.median_angle = 0.1;
      pairs.push_back(std::move(pair));
    }
  }
  std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) {
    return std::pair(a.first, a.second) < std::pair(b.first, b.second);
  });
  return pairs;
}

// Images of no part are added to the joined model. Points of no part are made from all pairs.
TEST(JoinedMapper, ExtendsJoinedModel) {
  const Model whole = scene(0.5);
  std::vector<Image> images = whole.images;
  std::vector<std::vector<cv::Vec3b>> colors;
  for (Image& image : images) {
    image.registered = false;
    image.points.clear();
    colors.emplace_back(image.features.size(), cv::Vec3b(1, 2, 3));
  }
  const std::vector<Pair> pairs = pairs_of(whole);
  const std::vector<cv::Mat> none;
  MappedParts mapped;
  mapped.parts = {{"left", piece(whole, range_of(0, 20), 1)},
                  {"right", piece(whole, range_of(14, 40), 2)}};
  mapped.refused_pairs = {0};
  mapped.reasons.assign(kModelImages, "of before");
  mapped.log = {"before"};
  NoProgress progress;
  const MapperInput input{.cameras = whole.cameras,
                          .images = images,
                          .colors = colors,
                          .descriptors = none,
                          .pairs = pairs};
  const Reconstruction made = map_joined(input, {}, mapped, progress, {});
  ASSERT_EQ(made.models.size(), 1U);
  EXPECT_EQ(registered(made.models[0]), kModelImages);
  check_model(made.models[0]);
  const std::vector<geometry::Rigid3> truth = poses_of(whole);
  EXPECT_LT(worst_center(made.models[0], truth),
            1.5 * worst_center(piece(whole, range_of(0, kModelImages), 4), truth));
  EXPECT_EQ(made.parts, (std::vector<std::string>{"left", "right"}));
  ASSERT_EQ(made.joins.size(), 1U);
  EXPECT_EQ(made.joins[0].refusal, "");
  ASSERT_EQ(made.refused.size(), 1U);
  EXPECT_EQ(made.refused[0].second, pairs[0].second);
  EXPECT_GT(made.trust.at(0), 0.9);
  EXPECT_EQ(made.log.front(), "before");
  for (const Outcome& outcome : made.outcomes) {
    EXPECT_TRUE(outcome.registered);
    EXPECT_EQ(outcome.reason, "");
  }
  // If the parts stay apart, they keep their images.
  mapped.parts = {{"left", piece(whole, range_of(0, 20), 1)},
                  {"right", piece(whole, range_of(19, 45), 2)}};
  const Reconstruction apart = map_joined(input, {}, mapped, progress, {});
  ASSERT_EQ(apart.models.size(), 2U);
  EXPECT_EQ(apart.joins[0].refusal, "1 image in common, 3 are needed");
  EXPECT_FALSE(apart.models[0].images[5].registered);
  EXPECT_TRUE(apart.models[1].images[5].registered);
  mapped.refused_pairs = {pairs.size()};
  EXPECT_THROW((void)map_joined(input, {}, mapped, progress, {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
