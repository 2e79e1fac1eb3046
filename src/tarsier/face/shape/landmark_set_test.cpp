// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/landmark_set.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/shape/show.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <numeric>
#include <stdexcept>

namespace tarsier::face::shape {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

// Both coordinates of a missing point.
constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

LandmarkSet small_set() {
  LandmarkSet set;
  set.mirror = {1, 0, 2};
  set.connections = {{0, 2}, {2, 1}};
  LandmarkSample sample;
  sample.image = "a.png";
  sample.points.resize(2, 3);
  sample.points << 10.25, 30, 1.0 / 3, 5, 6, 7;
  sample.person = "p1";
  sample.box = cv::Rect2d(4, 3, 20.5, 10);
  set.samples.push_back(sample);
  sample.image = "below/b.png";
  sample.points.col(1).setConstant(kMissing);
  sample.person.clear();
  sample.box.reset();
  set.samples.push_back(sample);
  return set;
}

TEST(LandmarkSet, ChecksNumbersAndSymmetry) {
  EXPECT_NO_THROW(small_set().check());
  EXPECT_NO_THROW(LandmarkSet().check());
  const auto refused = [](auto change) {
    LandmarkSet set = small_set();
    change(set);
    EXPECT_THROW(set.check(), std::invalid_argument);
  };
  refused([](LandmarkSet& s) { s.samples[1].points.conservativeResize(2, 2); });
  refused([](LandmarkSet& s) { s.samples[1].points(0, 0) = 1 / 0.0; });
  refused([](LandmarkSet& s) { s.mirror = {1, 2, 0}; });
  refused([](LandmarkSet& s) { s.mirror = {1, 0}; });
  refused([](LandmarkSet& s) { s.mirror = {1, 0, 3}; });
  refused([](LandmarkSet& s) { s.connections = {{0, 3}}; });
  refused([](LandmarkSet& s) { s.connections = {{-1, 0}}; });
  refused([](LandmarkSet& s) { s.samples[0].box = cv::Rect2d(0, 0, 0, 5); });
}

TEST(LandmarkSet, ReportsMissingPoints) {
  const LandmarkSet set = small_set();
  EXPECT_TRUE(set.samples[0].is_complete());
  EXPECT_FALSE(set.samples[1].is_complete());
  EXPECT_TRUE(set.samples[1].is_missing(1));
  EXPECT_FALSE(set.samples[1].is_missing(0));
  const LandmarkSet complete = complete_samples(set);
  ASSERT_EQ(complete.samples.size(), 1U);
  EXPECT_EQ(complete.samples[0].image, "a.png");
  EXPECT_EQ(complete.mirror, set.mirror);
  EXPECT_EQ(complete.connections, set.connections);
}

TEST(Mirrored, MovesPointsAndBoxWithThePixels) {
  // An image whose pixel values give their position.
  cv::Mat image(20, 60, CV_8UC1);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      image.at<unsigned char>(y, x) = static_cast<unsigned char>(x);
  cv::Mat flipped;
  cv::flip(image, flipped, 1);
  LandmarkSample sample = small_set().samples[0];
  sample.points(0, 0) = 10;
  sample.box = cv::Rect2d(4, 3, 20, 10);
  const LandmarkSample other = mirrored(sample, {1, 0, 2}, 60);
  EXPECT_EQ(other.points(0, 1), 49);  // point 0 is point 1 there
  EXPECT_EQ(flipped.at<unsigned char>(5, static_cast<int>(other.points(0, 1))), 10);
  EXPECT_EQ(other.points(1, 1), sample.points(1, 0));
  const cv::Rect box = *sample.box;
  const cv::Rect mirrored_box = *other.box;
  cv::Mat crop;
  cv::flip(flipped(mirrored_box), crop, 1);
  EXPECT_EQ(cv::norm(crop, image(box), cv::NORM_INF), 0);

  const LandmarkSample again = mirrored(other, {1, 0, 2}, 60);
  EXPECT_LT((again.points - sample.points).norm(), 1e-12);
  EXPECT_EQ(*again.box, *sample.box);
  EXPECT_TRUE(mirrored(small_set().samples[1], {1, 0, 2}, 60).is_missing(0));
  EXPECT_THROW((void)mirrored(sample, {1, 0}, 60), std::invalid_argument);
  EXPECT_THROW((void)mirrored(sample, {1, 0, 7}, 60), std::invalid_argument);
}

TEST(KnownMarkup, IsCompleteAndSymmetric) {
  for (const int points : {68, 73, 76}) {
    const auto markup = known_markup(points);
    ASSERT_TRUE(markup.has_value()) << points;
    LandmarkSet set;
    set.samples.resize(1);
    set.samples[0].points = Eigen::Matrix2Xd::Zero(2, points);
    set.mirror = markup->mirror;
    set.connections = markup->connections;
    EXPECT_NO_THROW(set.check()) << points;
    ASSERT_EQ(markup->mirror.size(), static_cast<std::size_t>(points));
    const auto [left, right] = markup->outer_eyes;
    EXPECT_EQ(markup->mirror[static_cast<std::size_t>(left)], right) << points;
    // The mirrored drawing has the same lines.
    std::vector<std::array<int, 2>> lines;
    std::vector<std::array<int, 2>> mirrored_lines;
    for (const auto& [a, b] : markup->connections) {
      const int ma = markup->mirror[static_cast<std::size_t>(a)];
      const int mb = markup->mirror[static_cast<std::size_t>(b)];
      lines.push_back({std::min(a, b), std::max(a, b)});
      mirrored_lines.push_back({std::min(ma, mb), std::max(ma, mb)});
    }
    EXPECT_THAT(mirrored_lines, ::testing::UnorderedElementsAreArray(lines)) << points;
  }
  EXPECT_FALSE(known_markup(67).has_value());
  EXPECT_FALSE(known_markup(0).has_value());
}

class LandmarkFile : public FolderTest {
 protected:
  [[nodiscard]] std::string refusal(const json& payload) const {
    write_archive(path("s.json"), {"landmark-set", 1, json::object(), payload});
    try {
      (void)read_landmark_set(path("s.json"));
    } catch (const InputError& error) {
      EXPECT_EQ(error.path(), path("s.json"));
      const std::string what = error.what();
      EXPECT_EQ(what.find('\n'), std::string::npos) << what;
      EXPECT_EQ(what.rfind(path("s.json")), 0U) << what;  // the path appears once
      EXPECT_EQ(what.find(path("s.json")), what.rfind(path("s.json")));
      return what;
    }
    return "accepted";
  }
};

TEST_F(LandmarkFile, RoundTrip) {
  const LandmarkSet set = small_set();
  write_landmark_set(path("s.json"), set, folder_);
  const LandmarkSet read = read_landmark_set(path("s.json"));
  ASSERT_EQ(read.samples.size(), 2U);
  EXPECT_EQ(read.samples[0].points, set.samples[0].points);
  EXPECT_EQ(read.samples[0].image, "a.png");
  EXPECT_EQ(read.samples[0].person, "p1");
  EXPECT_EQ(read.samples[0].box, set.samples[0].box);
  EXPECT_TRUE(read.samples[1].is_missing(1));
  EXPECT_EQ(read.samples[1].points.col(2), set.samples[1].points.col(2));
  EXPECT_EQ(read.samples[1].image, "below/b.png");
  EXPECT_FALSE(read.samples[1].box.has_value());
  EXPECT_EQ(read.mirror, set.mirror);
  EXPECT_EQ(read.connections, set.connections);
}

TEST_F(LandmarkFile, PathsReferToTheSameImages) {
  LandmarkSet set = small_set();
  std::filesystem::create_directories(path("sets"));
  // Beside the images: relative paths, also if the images were given from another folder.
  set.samples[1].image = path("below/b.png");
  write_landmark_set(path("s.json"), set, folder_ + "/.");
  EXPECT_EQ(read_landmark_set(path("s.json")).samples[1].image, "below/b.png");
  // From another folder: absolute.
  write_landmark_set(path("sets/s.json"), set, folder_);
  const LandmarkSet read = read_landmark_set(path("sets/s.json"));
  EXPECT_EQ(image_path(path("sets/s.json"), read.samples[0]), path("a.png"));
  // A folder whose name only begins with this folder's name is not below it.
  set.samples[0].image = "../" + std::filesystem::path(folder_).filename().string() + "x/a.png";
  write_landmark_set(path("s.json"), set, folder_);
  EXPECT_EQ(read_landmark_set(path("s.json")).samples[0].image, folder_ + "x/a.png");
}

TEST_F(LandmarkFile, RejectsInvalidFiles) {
  const auto sample = [](const json& points, const json& image = "a.png") {
    return json{{"samples", {{{"image", image}, {"points", points}}}}};
  };
  EXPECT_EQ(refusal(sample({{1, 2}, nullptr})), "accepted");
  EXPECT_EQ(refusal({{"samples", json::array()}}), "accepted");
  EXPECT_THAT(refusal(json::object()), HasSubstr("samples"));
  EXPECT_THAT(refusal({{"samples", 3}}), HasSubstr("samples"));
  EXPECT_THAT(refusal({{"samples", {3}}}), HasSubstr("not a JSON object"));
  EXPECT_THAT(refusal(sample({{1, 2, 3}})), HasSubstr("point 0"));
  EXPECT_THAT(refusal(sample({{1, "2"}})), HasSubstr("point 0"));
  EXPECT_THAT(refusal(sample({{1, 1e300}})), HasSubstr("point 0"));
  EXPECT_THAT(refusal(sample("none")), HasSubstr("points"));
  EXPECT_THAT(refusal(sample({{1, 2}}, "")), HasSubstr("path"));
  EXPECT_THAT(refusal(sample({{1, 2}}, std::string("a\0b", 3))), HasSubstr("zero"));
  EXPECT_THAT(refusal(sample({{1, 2}}, 7)), HasSubstr("image"));
  json two = sample({{1, 2}});
  two["samples"].push_back({{"image", "b.png"}, {"points", json::array()}});
  EXPECT_THAT(refusal(two), HasSubstr("0 points"));
  json box = sample({{1, 2}});
  box["samples"][0]["box"] = {1, 2, -3, 4};
  EXPECT_THAT(refusal(box), HasSubstr("box"));
  json mirror = sample({{1, 2}});
  mirror["mirror"] = {1};
  EXPECT_THAT(refusal(mirror), HasSubstr("mirror"));
  json connections = sample({{1, 2}});
  connections["connections"] = {{0, 1}};
  EXPECT_THAT(refusal(connections), HasSubstr("connections"));
  EXPECT_THROW((void)read_landmark_set(path("none.json")), InputError);
}

TEST_F(LandmarkFile, SheetShowsImagesPointsAndReasons) {
  cv::Mat image(40, 60, CV_8UC3, cv::Scalar(200, 30, 30));
  write_image(path("a.png"), image);
  LandmarkSet set = small_set();
  set.samples[0].points << 20, 40, 30, 15, 15, 25;
  LandmarkStyle style;
  style.radius_px = 4;
  const cv::Mat sheet = contact_sheet(set, path("s.json"), 100, 2, 10, style);
  ASSERT_EQ(sheet.size(), cv::Size(202, 100));
  // The corner of the first cell is the image's background; the second has none.
  EXPECT_EQ(sheet.at<cv::Vec3b>(30, 10), cv::Vec3b(200, 30, 30));
  EXPECT_NE(sheet.at<cv::Vec3b>(30, 112), cv::Vec3b(200, 30, 30));
  // Point 0 lies 10 px left of the middle of a cut 30 px wide.
  const cv::Vec3b at_point = sheet.at<cv::Vec3b>(34, 18);
  EXPECT_GT(at_point[2], 200);
  EXPECT_THROW((void)contact_sheet({}, "", 100, 2, 10, {}), std::invalid_argument);
}

TEST(DrawLandmarks, ColoursLeftAndRightPoints) {
  cv::Mat image = cv::Mat::zeros(60, 100, CV_8UC3);
  Eigen::Matrix2Xd points(2, 4);
  points << 20, 80, 50, kMissing, 30, 30, 30, kMissing;
  LandmarkStyle style;
  style.symmetry = true;
  style.radius_px = 5;
  draw_landmarks(image, points, {{0, 2}, {1, 3}}, {1, 0, 2, 3}, style);
  const cv::Vec3b left = image.at<cv::Vec3b>(30, 20);
  const cv::Vec3b right = image.at<cv::Vec3b>(30, 80);
  EXPECT_GT(left[1], left[2]);                                 // green
  EXPECT_GT(right[2], right[1]);                               // red
  EXPECT_NE(image.at<cv::Vec3b>(30, 35), cv::Vec3b(0, 0, 0));  // the line from 0 to 2
  EXPECT_EQ(image.at<cv::Vec3b>(30, 65), cv::Vec3b(0, 0, 0));  // no line from 1 to a missing point
  // With the points numbered in reverse, the sides keep their colours.
  cv::Mat again = cv::Mat::zeros(60, 100, CV_8UC3);
  points.col(0).swap(points.col(1));
  draw_landmarks(again, points, {{1, 2}}, {1, 0, 2, 3}, style);
  EXPECT_EQ(cv::norm(image, again, cv::NORM_INF), 0);
}

}  // namespace
}  // namespace tarsier::face::shape
