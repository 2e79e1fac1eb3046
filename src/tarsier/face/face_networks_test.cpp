// SPDX-License-Identifier: MIT
#include "tarsier/face/face_networks.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/face_training.h"
#include "tarsier/io/archive.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier {
namespace {

FaceNetworks random_networks(std::uint64_t seed) {
  FaceNetworks networks;
  Rng rng(seed);
  nn::initialize(networks.scan, rng);
  nn::initialize(networks.judge, rng);
  nn::initialize(networks.check, rng);
  return networks;
}

cv::Mat noise(cv::Size size, std::uint64_t seed) {
  cv::Mat gray(size, CV_8UC1);
  cv::RNG random(seed);
  random.fill(gray, cv::RNG::UNIFORM, 0, 256);
  cv::GaussianBlur(gray, gray, cv::Size(0, 0), 2);
  return gray;
}

class FaceNetworksTest : public FolderTest {};

TEST_F(FaceNetworksTest, SurviveTheirFile) {
  const FaceNetworks networks = random_networks(3);
  write_face_networks(path("n.json"), networks, {{"terms", "none"}});
  const FaceNetworks read = read_face_networks(path("n.json"));
  EXPECT_EQ(read.scan.layers[0].weights, networks.scan.layers[0].weights);
  EXPECT_EQ(read.judge.layers[2].weights, networks.judge.layers[2].weights);
  EXPECT_EQ(read.check.layers[6].bias, networks.check.layers[6].bias);
  EXPECT_EQ(read.sure, networks.sure);
}

TEST_F(FaceNetworksTest, OtherNetworksAreRefused) {
  write_face_networks(path("n.json"), random_networks(3), nlohmann::json::object());
  const Archive right = read_archive(path("n.json"), kFaceNetworksType, 1);
  const auto expect_refused = [&](const Archive& wrong) {
    write_archive(path("bad.json"), wrong);
    EXPECT_THROW((void)read_face_networks(path("bad.json")), ModelError);
  };
  Archive swapped = right;
  std::swap(swapped.payload["judge"], swapped.payload["scan"]);
  expect_refused(swapped);
  Archive unsure = right;
  unsure.payload["sure"] = 0.2;  // below `likely`
  expect_refused(unsure);
  Archive half = right;
  half.payload.erase("check");
  expect_refused(half);
}

TEST(FaceSearch, RefusesOptionsOutOfRange) {
  EXPECT_THROW((FaceSearchOptions{.min_face = 8}.check()), std::invalid_argument);
  EXPECT_THROW((FaceSearchOptions{.min_face = 40, .max_face = 30}.check()), std::invalid_argument);
  EXPECT_THROW((FaceSearchOptions{.threshold = 1}.check()), std::invalid_argument);
}

TEST(FaceSearch, TheCostDependsOnTheSmallestFaceAndNotOnTheScale) {
  const FaceNetworks networks = random_networks(5);
  FaceSearchWorkspace workspace;
  const cv::Mat small = noise({320, 200}, 1);
  (void)scan_faces(small, networks, {.min_face = 20}, workspace);
  const auto first = static_cast<double>(workspace.pixels);
  cv::Mat large;
  cv::resize(small, large, cv::Size(1280, 800), 0, 0, cv::INTER_LINEAR);
  (void)scan_faces(large, networks, {.min_face = 80}, workspace);
  EXPECT_NEAR(static_cast<double>(workspace.pixels) - first, first, 0.02 * first);
  // The pyramid: 1 + 1/1.35^2 + .. of the finest level, and the borders.
  EXPECT_LT(first, 3.2 * 256 * 160);
}

TEST(FaceSearch, TheWorkHasAnEndWhateverThePictureHolds) {
  FaceNetworks networks = random_networks(5);
  networks.scan.layers.back().bias[0] = 20;  // everything looks like a face
  networks.judge.layers.back().bias[0] = 20;
  networks.check.layers.back().bias[0] = 20;
  FaceSearchWorkspace workspace;
  const auto faces =
      search_faces(noise({320, 240}, 2), networks, {.min_face = 16, .max_places = 50}, workspace);
  EXPECT_LE(workspace.places, 50);
  EXPECT_LE(faces.size(), 50U);
  EXPECT_FALSE(faces.empty());
}

TEST(FaceSearch, TinyPicturesAreNoTrouble) {
  FaceSearchWorkspace workspace;
  const FaceNetworks networks = random_networks(1);
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(3, 200), cv::Size(17, 16)}) {
    EXPECT_NO_THROW((void)search_faces(cv::Mat(size, CV_8UC1, cv::Scalar(9)), networks,
                                       {.min_face = 16}, workspace));
  }
}

TEST(SuppressOverlaps, TheBetterOfTwoOnOneFaceStaysAndNeighboursDo) {
  const std::vector<ScoredFace> kept = suppress_overlaps({{{0, 0, 40, 40}, 0.8},
                                                          {{4, 2, 40, 40}, 0.9},     // the same
                                                          {{12, 12, 18, 18}, 0.85},  // inside it
                                                          {{45, 0, 40, 40}, 0.5}});
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_EQ(kept[0].score, 0.9);
  EXPECT_EQ(kept[1].box.x, 45);
}

// --- training ---

// A face of a kind: two dark eyes and a mouth on something bright.
void draw_mask(cv::Mat& picture, const cv::Rect2d& box) {
  const auto at = [&](double x, double y) {
    return cv::Point(cvRound(box.x + x * box.width), cvRound(box.y + y * box.width));
  };
  const auto size = [&](double x, double y) {
    return cv::Size(cvRound(x * box.width), cvRound(y * box.width));
  };
  cv::ellipse(picture, at(0.5, 0.55), size(0.52, 0.68), 0, 0, 360, cv::Scalar(200), -1);
  for (const double x : {0.28, 0.72}) {
    cv::ellipse(picture, at(x, 0.35), size(0.12, 0.08), 0, 0, 360, cv::Scalar(40), -1);
  }
  cv::ellipse(picture, at(0.5, 0.85), size(0.2, 0.06), 0, 0, 360, cv::Scalar(70), -1);
}

class FaceTrainingTest : public FolderTest {
 protected:
  FaceTrainingTest() {
    for (int i = 0; i < 3; ++i) {
      cv::Mat picture = noise({80, 80}, static_cast<std::uint64_t>(i) + 20);
      const cv::Rect2d box(22 + 3 * i, 20 + 2 * i, 30 + i, 30 + i);
      draw_mask(picture, box);
      const std::string name = path("face" + std::to_string(i) + ".png");
      write_image(name, picture);
      pictures_.push_back({name, {box}, {}});
    }
    for (int i = 0; i < 2; ++i) {
      const std::string name = path("none" + std::to_string(i) + ".png");
      write_image(name, noise({80, 64}, static_cast<std::uint64_t>(i) + 50));
      pictures_.push_back({name, {}, {}});
    }
  }
  std::vector<FacePicture> pictures_;
  NoProgress silent_;
};

TEST_F(FaceTrainingTest, IsTheSameForAnyNumberOfThreads) {
  const FaceTrainingOptions options{.scan_steps = 4, .judge_steps = 2, .check_steps = 2};
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const FaceTraining one = train_face_networks(pictures_, "set", options, silent_, {});
  cv::setNumThreads(3);
  const FaceTraining three = train_face_networks(pictures_, "set", options, silent_, {});
  cv::setNumThreads(threads);
  EXPECT_EQ(one.faces, 3);
  EXPECT_EQ(one.without, 2);
  for (std::size_t i = 0; i < one.networks.scan.layers.size(); ++i) {
    EXPECT_EQ(one.networks.scan.layers[i].weights, three.networks.scan.layers[i].weights);
  }
  EXPECT_EQ(one.networks.check.layers[0].weights, three.networks.check.layers[0].weights);
}

TEST_F(FaceTrainingTest, NeedsFacesAndPicturesWithout) {
  std::vector<FacePicture> faces(pictures_.begin(), pictures_.begin() + 3);
  EXPECT_THROW((void)train_face_networks(faces, "set", {}, silent_, {}), InputError);
  std::vector<FacePicture> without(pictures_.begin() + 3, pictures_.end());
  EXPECT_THROW((void)train_face_networks(without, "set", {}, silent_, {}), InputError);
}

}  // namespace
}  // namespace tarsier
