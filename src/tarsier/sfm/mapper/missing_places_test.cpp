// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/missing_places.h"

#include "tarsier/core/at.h"
#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <optional>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr int kCameras = 21;      // at x = -10, -9 .. 10
constexpr int kJoint = kCameras;  // index of the image that shows the joint
constexpr double kEnd = 10;       // x, of either end of the house

// A house along the x axis that cameras pass at a distance of 10. Two such houses stand side by
// side. The last image shows the end of the first and the beginning of the second, and it is
// matched with the images of the one house that the model has.
struct House {
  Model model;
  std::vector<Image> images;
  std::vector<Pair> pairs;

  // `low`, `high`: x of the points that the model has.
  explicit House(double low = -20, double high = 20) {
    model.cameras = {geometry::Camera{640, 480, 500, 500, 320, 240, {}, 0}};
    Rng rng(3);
    for (int p = 0; p < 900; ++p) {
      Point point;
      point.position = {40 * rng.uniform() - 20, 8 * rng.uniform() - 4, rng.uniform()};
      if (point.position.x() >= low && point.position.x() <= high) model.points.push_back(point);
    }
    for (int i = 0; i < kCameras; ++i) {
      model.images.push_back(image_at(i - kEnd));
      for (std::size_t p = 0; p < model.points.size(); ++p)
        if (const auto pixel = pixel_of(p, model.images.back().pose)) see(i, p, *pixel);
    }
    model.images.emplace_back();
    images = model.images;
    // Left half: the end of the house. Right half: its beginning.
    for (const auto& [x, side] : {std::pair(kEnd, -1), std::pair(-kEnd, 1)}) {
      Pair pair;
      pair.first = x > 0 ? kCameras - 1 : 0;
      pair.second = kJoint;
      std::vector<Match> inliers;
      const Image& from = model.images[at(pair.first)];
      for (std::size_t f = 0; f < from.features.size(); ++f) {
        const auto pixel = pixel_of(at(from.points[f]), image_at(x).pose);
        if (!pixel || side * (pixel->x - 320) < 0) continue;
        inliers.push_back({static_cast<int>(f), static_cast<int>(images[kJoint].features.size())});
        images[kJoint].features.emplace_back(*pixel);
      }
      pair.view.inliers = std::move(inliers);
      pairs.push_back(pair);
    }
  }

  [[nodiscard]] std::vector<MissingPlace> found() const {
    return missing_places(images, pairs, {model}, {});
  }

 private:
  static Image image_at(double x) {
    Image image;
    image.registered = true;
    image.pose.translation = {-x, 0, 10};
    return image;
  }

  [[nodiscard]] std::optional<cv::Point2d> pixel_of(std::size_t point,
                                                    const geometry::Rigid3& pose) const {
    const auto pixel = model.cameras[0].project(pose * model.points[point].position);
    if (!pixel || pixel->x < 0 || pixel->x > 640 || pixel->y < 0 || pixel->y > 480)
      return std::nullopt;
    return cv::Point2d(*pixel);
  }

  void see(int image, std::size_t point, const cv::Point2d& pixel) {
    Image& by = model.images[at(image)];
    model.points[point].track.push_back({image, static_cast<int>(by.features.size())});
    by.features.emplace_back(pixel);
    by.points.push_back(static_cast<int>(point));
  }
};

TEST(MissingPlaces, ImageOfTheJointShowsThatASecondHouseIsMissing) {
  const std::vector<MissingPlace> places = House().found();
  ASSERT_EQ(places.size(), 1U);
  EXPECT_EQ(places[0].image, kJoint);
  EXPECT_EQ(places[0].model, 0);
  EXPECT_GE(places[0].first_features, places[0].second_features);
  EXPECT_GT(places[0].second_features, 40);
}

TEST(MissingPlaces, ModelThatEndsThereLacksNothing) {
  EXPECT_TRUE(House(-20, kEnd).found().empty());
  EXPECT_TRUE(House(-kEnd, 20).found().empty());
}

TEST(MissingPlaces, ImageThatFitsInOneWayIsNoEvidence) {
  House house;
  house.pairs.pop_back();
  EXPECT_TRUE(house.found().empty());
}

TEST(MissingPlaces, RegisteredImageIsNoEvidence) {
  House house;
  house.model.images[kJoint] = house.images[kJoint];
  Image& image = house.model.images[kJoint];
  image.registered = true;
  image.pose = house.model.images[0].pose;
  image.points.assign(image.features.size(), 0);  // enough points to be trusted
  EXPECT_TRUE(house.found().empty());
}

TEST(MissingPlaces, ImageThatContinuesAnotherModelIsNoEvidence) {
  const House house;
  const House other(-20, kEnd);
  std::vector<Image> images = house.images;
  std::vector<Pair> pairs = house.pairs;
  std::vector<Model> models = {house.model, other.model};
  // The images of the other model follow; each model contains all images.
  for (Model& model : models) model.images.resize(kJoint + 1 + kCameras);
  for (int i = 0; i < kCameras; ++i) {
    std::swap(models[1].images[at(i)], models[1].images[at(kJoint + 1 + i)]);
    images.push_back(models[1].images[at(kJoint + 1 + i)]);
  }
  for (Point& point : models[1].points)
    for (Observation& seen : point.track) seen.image += kJoint + 1;
  const auto joint = static_cast<int>(images[kJoint].features.size());
  for (Pair pair : other.pairs) {
    pair.first += kJoint + 1;
    std::vector<Match> inliers = pair.view.inliers.copy();
    for (Match& inlier : inliers) inlier.second += joint;
    pair.view.inliers = std::move(inliers);
    pairs.push_back(pair);
  }
  const std::vector<cv::Point2f>& more = other.images[kJoint].features;
  images[kJoint].features.insert(images[kJoint].features.end(), more.begin(), more.end());
  EXPECT_EQ(missing_places(images, house.pairs, models, {}).size(), 1U);
  EXPECT_TRUE(missing_places(images, pairs, models, {}).empty());
}

}  // namespace
}  // namespace tarsier::sfm
