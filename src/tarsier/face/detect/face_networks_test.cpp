// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/face_networks.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/testing_long.h"
#include "tarsier/face/detect/face_training.h"
#include "tarsier/face/detect/training_views.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face {
namespace {

FaceNetworks random_networks(std::uint64_t seed) {
  FaceNetworks networks;
  Rng rng(seed);
  linalg::initialize(networks.scan, rng);
  linalg::initialize(networks.refine, rng);
  linalg::initialize(networks.verify, rng);
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

TEST_F(FaceNetworksTest, FileRoundTrip) {
  const FaceNetworks networks = random_networks(3);
  write_face_networks(path("n.json"), networks, {{"terms", "none"}});
  const FaceNetworks read = read_face_networks(path("n.json"));
  EXPECT_EQ(read.scan.layers[0].weights, networks.scan.layers[0].weights);
  EXPECT_EQ(read.refine.layers[2].weights, networks.refine.layers[2].weights);
  EXPECT_EQ(read.verify.layers[6].bias, networks.verify.layers[6].bias);
  EXPECT_EQ(read.confident_score, networks.confident_score);
}

TEST_F(FaceNetworksTest, RejectsInvalidFiles) {
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

TEST(FaceSearch, CostDependsOnMinFaceRelativeToTheImage) {
  const FaceNetworks networks = random_networks(5);
  FaceSearchWorkspace workspace;
  const cv::Mat small = noise({320, 200}, 1);
  (void)scan_faces(small, networks, {.min_face = 20}, workspace);
  const auto first = static_cast<double>(workspace.pixels);
  cv::Mat large;
  cv::resize(small, large, cv::Size(1280, 800), 0, 0, cv::INTER_LINEAR);
  (void)scan_faces(large, networks, {.min_face = 80}, workspace);
  EXPECT_NEAR(static_cast<double>(workspace.pixels) - first, first, 0.02 * first);
  // Pixels of the pyramid: 1 + 1/1.35^2 + .. times the finest level, plus the borders.
  EXPECT_LT(first, 3.2 * 256 * 160);
}

TEST(FaceSearch, BoundsWorkWhenEveryWindowPasses) {
  FaceNetworks networks = random_networks(5);
  networks.scan.layers.back().bias[0] = 20;  // every window scores as a face
  networks.refine.layers.back().bias[0] = 20;
  networks.verify.layers.back().bias[0] = 20;
  FaceSearchWorkspace workspace;
  const auto faces = search_faces(noise({320, 240}, 2), networks,
                                  {.min_face = 16, .max_candidates = 50}, workspace);
  EXPECT_LE(workspace.candidates, 50);
  EXPECT_LE(faces.size(), 50U);
  EXPECT_FALSE(faces.empty());
}

TEST(FaceSearch, AcceptsTinyImages) {
  FaceSearchWorkspace workspace;
  const FaceNetworks networks = random_networks(1);
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(3, 200), cv::Size(17, 16)}) {
    EXPECT_NO_THROW((void)search_faces(cv::Mat(size, CV_8UC1, cv::Scalar(9)), networks,
                                       {.min_face = 16}, workspace));
  }
}

TEST(FaceSearch, ScanInputIsLocallyNormalised) {
  cv::Mat gray = noise({44, 40}, 8);
  gray.colRange(20, 44).convertTo(gray.colRange(20, 44), CV_8U, 0.4, 90);
  FaceSearchWorkspace workspace;
  std::vector<float> input;
  scan_input(noise({64, 20}, 3), workspace, input);  // buffers are used again
  scan_input(gray, workspace, input);
  ASSERT_EQ(input.size(), gray.total());
  const int rows = gray.rows / 2;
  const int cols = gray.cols / 2;
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      double sum = 0;
      double square = 0;
      for (int v = y / 2 - 8; v <= y / 2 + 8; ++v) {
        for (int u = x / 2 - 8; u <= x / 2 + 8; ++u) {
          for (int k = 0; k < 4; ++k) {
            const double value = gray.at<std::uint8_t>(2 * std::clamp(v, 0, rows - 1) + k / 2,
                                                       2 * std::clamp(u, 0, cols - 1) + k % 2);
            sum += value;
            square += value * value;
          }
        }
      }
      const double mean = sum / 1156;
      const double deviation = std::sqrt(square / 1156 - mean * mean);
      const double expected = (gray.at<std::uint8_t>(y, x) - mean) / (deviation + 8);
      const int plane = y % 2 * 2 + x % 2;
      const auto at = static_cast<std::size_t>((plane * rows + y / 2) * cols + x / 2);
      ASSERT_NEAR(static_cast<double>(input[at]), expected, 1e-4) << x << ", " << y;
    }
  }
}

TEST(SuppressOverlaps, KeepsBestOfOverlappingBoxesAndNeighbours) {
  const std::vector<ScoredFace> kept = suppress_overlaps({{{0, 0, 40, 40}, 0.8},
                                                          {{4, 2, 40, 40}, 0.9},     // the same
                                                          {{12, 12, 18, 18}, 0.85},  // inside it
                                                          {{45, 0, 40, 40}, 0.5}});
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_EQ(kept[0].score, 0.9);
  EXPECT_EQ(kept[1].box.x, 45);
}

TEST(SuppressOverlaps, RemovesExactlyTheBoxesThatOverlapABetterOne) {
  Rng rng(12);
  std::vector<ScoredFace> faces;
  for (int i = 0; i < 600; ++i) {
    const double width = training::log_uniform(rng, 16, i % 50 == 0 ? 400 : 40);
    const double x = rng.uniform(-20, 900);
    const double y = rng.uniform(-20, 300);
    faces.push_back({{x, y, width, width}, rng.uniform()});
  }
  const auto is_same_face = [](const cv::Rect2d& a, const cv::Rect2d& b) {
    const double common = (a & b).area();
    return common > 0.35 * (a.area() + b.area() - common) ||
           common > 0.75 * std::min(a.area(), b.area());
  };
  const std::vector<ScoredFace> kept = suppress_overlaps(faces);
  EXPECT_LT(kept.size(), faces.size());
  for (const ScoredFace& face : faces) {
    int better = 0;
    int itself = 0;
    for (const ScoredFace& other : kept) {
      itself += other.box == face.box ? 1 : 0;
      better += other.score > face.score && is_same_face(other.box, face.box) ? 1 : 0;
    }
    EXPECT_EQ(itself, better == 0 ? 1 : 0);
  }
}

// --- training ---

// A simple face: two dark eyes and a mouth on a bright area.
void draw_mask(cv::Mat& image, const cv::Rect2d& box) {
  const auto at = [&](double x, double y) {
    return cv::Point(cvRound(box.x + x * box.width), cvRound(box.y + y * box.width));
  };
  const auto size = [&](double x, double y) {
    return cv::Size(cvRound(x * box.width), cvRound(y * box.width));
  };
  cv::ellipse(image, at(0.5, 0.55), size(0.52, 0.68), 0, 0, 360, cv::Scalar(200), -1);
  for (const double x : {0.28, 0.72}) {
    cv::ellipse(image, at(x, 0.35), size(0.12, 0.08), 0, 0, 360, cv::Scalar(40), -1);
  }
  cv::ellipse(image, at(0.5, 0.85), size(0.2, 0.06), 0, 0, 360, cv::Scalar(70), -1);
}

class FaceTrainingTest : public FolderTest {
 protected:
  FaceTrainingTest() {
    for (int i = 0; i < 3; ++i) {
      cv::Mat image = noise({80, 80}, static_cast<std::uint64_t>(i) + 20);
      const cv::Rect2d box(22 + 3 * i, 20 + 2 * i, 30 + i, 30 + i);
      draw_mask(image, box);
      const std::string name = path("face" + std::to_string(i) + ".png");
      write_image(name, image);
      images_.push_back({name, {box}, {}});
    }
    for (int i = 0; i < 2; ++i) {
      const std::string name = path("none" + std::to_string(i) + ".png");
      write_image(name, noise({80, 64}, static_cast<std::uint64_t>(i) + 50));
      images_.push_back({name, {}, {}});
    }
  }
  std::vector<FaceImage> images_;
  NoProgress silent_;
};

TEST_F(FaceTrainingTest, IsTheSameForAnyNumberOfThreads) {
  const FaceTrainingOptions options{
      .scan_steps = 4, .refine_steps = 3, .verify_steps = 3, .drawings = 0};
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const FaceTraining one = train_face_networks(images_, "set", options, silent_, {});
  cv::setNumThreads(3);
  const FaceTraining three = train_face_networks(images_, "set", options, silent_, {});
  cv::setNumThreads(threads);
  EXPECT_EQ(one.faces, 3);
  EXPECT_EQ(one.without_faces, 2);
  for (std::size_t i = 0; i < one.networks.scan.layers.size(); ++i) {
    EXPECT_EQ(one.networks.scan.layers[i].weights, three.networks.scan.layers[i].weights);
  }
  EXPECT_EQ(one.networks.verify.layers[0].weights, three.networks.verify.layers[0].weights);
}

TEST_F(FaceTrainingTest, ThresholdComesFromHeldOutImages) {
  TARSIER_LONG_TEST();
  for (int i = 2; i < 8; ++i) {
    const std::string name = path("none" + std::to_string(i) + ".png");
    write_image(name, noise({80, 64}, static_cast<std::uint64_t>(i) + 50));
    images_.push_back({name, {}, {}});
  }
  // Networks with little training take anything for a face.
  FaceTrainingOptions options{.scan_steps = 3, .refine_steps = 3, .verify_steps = 3, .drawings = 0};
  options.false_alarms = 0;
  const FaceTraining strict = train_face_networks(images_, "set", options, silent_, {});
  EXPECT_EQ(strict.without_faces, 6);
  EXPECT_EQ(strict.held_out, 2);
  EXPECT_LE(strict.held_out_alarms, strict.held_out_likely);
  options.false_alarms = 10'000;
  const FaceTraining loose = train_face_networks(images_, "set", options, silent_, {});
  EXPECT_EQ(strict.held_out_alarms, 0);
  EXPECT_NEAR(loose.networks.confident_score, 0.5, 0.05);
  EXPECT_GT(loose.held_out_alarms, 0);
  EXPECT_GT(strict.networks.confident_score, loose.networks.confident_score);
  FaceSearchWorkspace workspace;
  // Every third image without faces.
  for (const int number : {2, 5}) {
    const auto faces = search_faces(
        read_gray_image(path("none" + std::to_string(number) + ".png")), strict.networks,
        {.min_face = 24, .threshold = strict.networks.confident_score}, workspace);
    EXPECT_TRUE(faces.empty()) << number;
  }
}

TEST_F(FaceTrainingTest, UsesGivenPixelsInsteadOfTheFile) {
  const FaceTrainingOptions options{
      .scan_steps = 3, .refine_steps = 3, .verify_steps = 3, .drawings = 0};
  const FaceTraining files = train_face_networks(images_, "set", options, silent_, {});
  for (FaceImage& image : images_) {
    image.gray = read_gray_image(image.image);
    image.image = "no such file";
  }
  const FaceTraining pixels = train_face_networks(images_, "set", options, silent_, {});
  EXPECT_TRUE(pixels.skipped.empty());
  EXPECT_EQ(pixels.networks.scan.layers[0].weights, files.networks.scan.layers[0].weights);
}

TEST(ConfidentScore, MatchesAllowedFalseAlarms) {
  // Logits above 0 (score above 0.5), exponentially distributed with mean 1.5.
  std::vector<double> scores;
  constexpr int kCount = 400;
  for (int i = 0; i < kCount; ++i) {
    const double logit = -1.5 * std::log((i + 0.5) / kCount);
    scores.push_back(1 / (1 + std::exp(-logit)));
    scores.push_back(0.1);  // below the min score: does not count
  }
  for (const double allowed : {200.0, 40.0, 30.0}) {
    const double confident = choose_confident_score(scores, 0.5, allowed);
    const double logit = std::log(confident / (1 - confident));
    EXPECT_NEAR(logit, 1.5 * std::log(kCount / allowed), 0.02 * logit) << allowed;
  }
  EXPECT_EQ(choose_confident_score(scores, 0.5, 400), 0.5);  // all are allowed
  EXPECT_EQ(choose_confident_score({}, 0.5, 0), 0.5);
  EXPECT_EQ(choose_confident_score(scores, 0.5, 0.001), 0.98);
  const double none = choose_confident_score({0.6, 0.8, 0.7}, 0.5, 0);
  EXPECT_NEAR(none, 0.9, 1e-9);  // above the max score
  EXPECT_THROW((void)choose_confident_score(scores, 0.5, -1), std::invalid_argument);
}

TEST(FaceTrainingViews, TransformMatchesRenderedView) {
  Rng rng(4);
  for (int round = 0; round < 20; ++round) {
    cv::Mat gray(200, 240, CV_8UC1, cv::Scalar(20));
    const cv::Point2d dot(100.5, 120.5);
    cv::circle(gray, cv::Point(100, 120), 3, cv::Scalar(250), cv::FILLED);
    training::Image image;
    make_halves(gray, 0.2, image.halves);
    const double scale = training::log_uniform(rng, 0.4, 2);
    const training::ViewTransform transform = training::view_transform(
        {110, 110}, {32, 32}, scale, training::random_orientation(false, rng));
    const cv::Mat view = training::render_view(image, transform, 64);
    cv::Mat weights;
    view.convertTo(weights, CV_32F, 1, -20);
    const cv::Moments moments = cv::moments(weights);
    const cv::Point2d at = transform(dot);
    EXPECT_NEAR(moments.m10 / moments.m00 + 0.5, at.x, 0.25);
    EXPECT_NEAR(moments.m01 / moments.m00 + 0.5, at.y, 0.25);
  }
}

TEST(FaceTrainingViews, ShowsBackgroundOutsideTheImage) {
  training::Image image;
  make_halves(cv::Mat(20, 20, CV_8UC1, cv::Scalar(200)), 0.5, image.halves);
  const cv::Mat background(64, 64, CV_8UC1, cv::Scalar(10));
  const training::ViewTransform transform = training::view_transform({10, 10}, {32, 32}, 1, {});
  const cv::Mat view = training::render_view(image, transform, 64, &background);
  EXPECT_EQ(view.at<std::uint8_t>(32, 32), 200);
  EXPECT_EQ(view.at<std::uint8_t>(5, 5), 10);
  EXPECT_EQ(training::render_view(image, transform, 64).at<std::uint8_t>(5, 5), 200);
}

TEST(FaceTrainingViews, DrawingsAreDeterministicBySeed) {
  Rng one(7);
  Rng same(7);
  cv::Mat last;
  for (int i = 0; i < 12; ++i) {
    const cv::Mat drawing = training::draw_without_faces(one);
    EXPECT_EQ(cv::norm(drawing, training::draw_without_faces(same), cv::NORM_INF), 0);
    cv::Scalar mean;
    cv::Scalar deviation;
    cv::meanStdDev(drawing, mean, deviation);
    EXPECT_GT(deviation[0], 1);
    if (!last.empty()) {
      EXPECT_GT(cv::norm(drawing, last, cv::NORM_INF), 0);
    }
    last = drawing;
  }
}

TEST_F(FaceTrainingTest, NeedsImagesWithAndWithoutFaces) {
  std::vector<FaceImage> faces(images_.begin(), images_.begin() + 3);
  EXPECT_THROW((void)train_face_networks(faces, "set", {}, silent_, {}), InputError);
  std::vector<FaceImage> without(images_.begin() + 3, images_.end());
  EXPECT_THROW((void)train_face_networks(without, "set", {}, silent_, {}), InputError);
}

}  // namespace
}  // namespace tarsier::face
