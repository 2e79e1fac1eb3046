// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/anchor_detector.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/detect/testing_anchors.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::face {
namespace {

using linalg::NamedTensors;
using nlohmann::json;

const AnchorDetector& bright() {
  static const AnchorDetector detector = build_anchor_detector(bright_anchors(), "drawn");
  return detector;
}

// A white square of one cell on black, and the detections on it.
cv::Mat one_cell(cv::Size size, cv::Point corner, int side) {
  cv::Mat image(size, CV_8UC1, cv::Scalar(0));
  image(cv::Rect(corner, cv::Size(side, side))) = 255;
  return image;
}

std::vector<ScoredFace> found(const cv::Mat& image, const AnchorSearchOptions& options = {}) {
  AnchorWorkspace workspace;
  return search_anchors(image, bright(), options, workspace);
}

TEST(AnchorDetector, DetectsBrightCellAtAnyImageSize) {
  for (const double scale : {0.5, 1.0, 3.0}) {
    const auto px = [&](double at416) { return static_cast<int>(std::lround(at416 * scale)); };
    const cv::Mat image = one_cell({px(416), px(300)}, {px(160), px(96)}, px(32));
    const std::vector<ScoredFace> faces = found(image);
    ASSERT_FALSE(faces.empty()) << scale;
    for (const ScoredFace& face : faces) {
      EXPECT_GT(face.score, 0.5);
      EXPECT_NEAR(face.box.width, 1.603231 * 32 * scale, 1);
      EXPECT_NEAR(face.box.height, 2.094468 * 32 * scale, 1);
      EXPECT_NEAR(face.box.x + face.box.width / 2, 176 * scale, 70 * scale);
      EXPECT_NEAR(face.box.y + face.box.height / 2, 112 * scale, 70 * scale);
    }
  }
  EXPECT_TRUE(found(cv::Mat(200, 300, CV_8UC1, cv::Scalar(0))).empty());
}

TEST(AnchorDetector, MarginDoesNotShiftBoxes) {
  const cv::Mat image = one_cell({416, 416}, {0, 0}, 64);
  const std::vector<ScoredFace> faces = found(image, {.margin = 0.25});
  ASSERT_FALSE(faces.empty());
  for (const ScoredFace& face : faces) {
    EXPECT_NEAR(face.box.x + face.box.width / 2, 32, 80);
    EXPECT_NEAR(face.box.y + face.box.height / 2, 32, 80);
  }
}

TEST(AnchorDetector, IsTheSameForAnyNumberOfThreads) {
  Rng rng(4);
  cv::Mat image(300, 500, CV_8UC1);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      image.at<unsigned char>(y, x) = static_cast<unsigned char>(rng.uniform(0, 255.9));
  cv::GaussianBlur(image, image, {}, 20);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const std::vector<ScoredFace> alone = found(image);
  cv::setNumThreads(4);
  const std::vector<ScoredFace> many = found(image);
  cv::setNumThreads(before);
  ASSERT_EQ(alone.size(), many.size());
  for (std::size_t i = 0; i < alone.size(); ++i) {
    EXPECT_EQ(alone[i].box, many[i].box);
    EXPECT_EQ(alone[i].score, many[i].score);
  }
}

TEST(AnchorDetector, RejectsInvalidTensors) {
  const auto broken = [](auto change) {
    NamedTensors tensors = bright_anchors();
    change(tensors);
    EXPECT_THROW((void)build_anchor_detector(tensors, "x"), ModelError);
  };
  broken([](NamedTensors& t) { t.clear(); });
  broken([](NamedTensors& t) { t.pop_back(); });
  broken([](NamedTensors& t) { t.push_back(t.back()); });
  broken([](NamedTensors& t) { t.push_back(tensor_of("more", {1})); });
  broken([](NamedTensors& t) { t[0].values[3] = NAN; });
  broken([](NamedTensors& t) { t[0] = tensor_of("conv0/filters", {5, 5, 3, 2}); });
  broken([](NamedTensors& t) { t[2] = tensor_of("conv1/depthwise_filter", {3, 3, 3, 1}); });
  broken([](NamedTensors& t) { t[3] = tensor_of("conv1/pointwise_filter", {1, 1, 2, 3}); });
  broken([](NamedTensors& t) { t[3] = tensor_of("conv1/pointwise_filter", {3, 3, 2, 2}); });
  broken([](NamedTensors& t) {
    t[t.size() - 2] = tensor_of("conv8/filters", {1, 1, 2, 24});
    t.back() = tensor_of("conv8/bias", {24});
  });
  EXPECT_TRUE(has_anchor_tensors(bright_anchors()));
  EXPECT_FALSE(has_anchor_tensors({}));
  AnchorSearchOptions options;
  options.side = 10;
  EXPECT_THROW((void)found(cv::Mat(9, 9, CV_8UC1, cv::Scalar(0)), options), std::invalid_argument);
}

class AnchorFiles : public FolderTest {};

TEST_F(AnchorFiles, RoundTrip) {
  const std::string file = path("face-anchors.json");
  write_anchor_detector(file, bright_anchors(), {{"data", "drawn"}});
  const AnchorDetector read = read_anchor_detector(file);
  ASSERT_EQ(read.network.stages.size(), bright().network.stages.size());
  for (std::size_t i = 0; i < read.network.stages.size(); ++i) {
    EXPECT_EQ(read.network.stages[i].depthwise, bright().network.stages[i].depthwise);
    EXPECT_EQ(read.network.stages[i].mix.weights, bright().network.stages[i].mix.weights);
    EXPECT_EQ(read.network.stages[i].mix.bias, bright().network.stages[i].mix.bias);
  }
  std::filesystem::resize_file(file, 200);
  EXPECT_THROW((void)read_anchor_detector(file), ModelError);
  EXPECT_THROW((void)read_anchor_detector(path("none.json")), ModelError);
}

// The real network against the package that it comes from, run in Node: bench/peers/face_boxes.mjs.
TEST_F(AnchorFiles, MatchesFaceApi) {
  const char* folder = std::getenv("TARSIER_FACE_API");
  if (folder == nullptr || !std::filesystem::exists(std::string(folder) + "/model"))
    GTEST_SKIP() << "needs the npm package @vladmandic/face-api: $TARSIER_FACE_API is its folder";
  if (std::system("node --version >/dev/null 2>&1") != 0) GTEST_SKIP() << "needs node";
  const std::string package = folder;
  const std::string manifest = package + "/model/tiny_face_detector_model-weights_manifest.json";
  const AnchorDetector detector =
      build_anchor_detector(linalg::read_weights_manifest(manifest), manifest);
  // Images similar to faces: light ovals with two dark spots and a bar. At 416 x 416 px neither
  // program scales them.
  cv::Mat image(416, 416, CV_8UC1, cv::Scalar(90));
  for (int k = 0; k < 4; ++k) {
    const cv::Point center(100 + 210 * (k % 2), 110 + 200 * (k / 2));
    const double s = 0.7 + 0.2 * k;
    const auto part = [&](double dx, double dy, double w, double h, int grey) {
      cv::ellipse(image, center + cv::Point(cvRound(dx * s), cvRound(dy * s)),
                  cv::Size(cvRound(w * s), cvRound(h * s)), 0, 0, 360, cv::Scalar(grey), -1,
                  cv::LINE_AA);
    };
    part(0, 0, 50, 65, 190);
    part(0, -50, 50, 25, 50);
    part(-20, -10, 9, 5, 40);
    part(20, -10, 9, 5, 40);
    part(0, 10, 6, 10, 160);
    part(0, 32, 20, 6, 90);
  }
  cv::GaussianBlur(image, image, {}, 1.5);
  std::ofstream out(path("drawn.ppm"), std::ios::binary);
  out << "P6\n416 416\n255\n";
  for (int y = 0; y < 416; ++y)
    for (int x = 0; x < 416; ++x)
      for (int c = 0; c < 3; ++c) out.put(static_cast<char>(image.at<unsigned char>(y, x)));
  out.close();
  const std::string command = std::string("node '") + TARSIER_SOURCE_MODELS +
                              "/../bench/peers/face_boxes.mjs' '" + package + "' '" +
                              path("drawn.ppm") + "' >'" + path("out.jsonl") + "' 2>'" +
                              path("err.txt") + "'";
  ASSERT_EQ(std::system(command.c_str()), 0) << contents(path("err.txt")).substr(0, 500);
  const json peer = json::parse(contents(path("out.jsonl")))["faces"];
  AnchorWorkspace workspace;
  const std::vector<ScoredFace> own = search_anchors(image, detector, {}, workspace);
  ASSERT_EQ(own.size(), peer.size());
  EXPECT_FALSE(own.empty());
  for (std::size_t i = 0; i < own.size(); ++i) {
    const json& box = peer[i]["box"];
    EXPECT_NEAR(own[i].score, peer[i]["score"].get<double>(), 1e-4);
    EXPECT_NEAR(own[i].box.x, box[0].get<double>(), 0.02);
    EXPECT_NEAR(own[i].box.y, box[1].get<double>(), 0.02);
    EXPECT_NEAR(own[i].box.width, box[2].get<double>(), 0.02);
    EXPECT_NEAR(own[i].box.height, box[3].get<double>(), 0.02);
  }
}

}  // namespace
}  // namespace tarsier::face
