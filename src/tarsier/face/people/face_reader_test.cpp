// SPDX-License-Identifier: MIT
#include "tarsier/face/people/face_reader.h"

#include "tarsier/media/image_file.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cstdlib>
#include <filesystem>
#include <memory>
#include <vector>

namespace tarsier::face::people {
namespace {

constexpr const char* kImage = "/usr/share/doc/opencv-doc/examples/data/messi5.jpg";

TEST(EyeMethodTest, ParsesItsNames) {
  for (const EyeMethod method : {EyeMethod::kLandmarks, EyeMethod::kCascades, EyeMethod::kSplits})
    EXPECT_EQ(parse_eye_method(name_of(method)), method);
  EXPECT_ANY_THROW((void)parse_eye_method("nose"));
}

TEST(EyeMethodTest, RegionsMatchTheCascades) {
  EXPECT_DOUBLE_EQ(eye_region(EyeMethod::kCascades).x, 0.16);
  EXPECT_DOUBLE_EQ(eye_region(EyeMethod::kSplits).height, 0.36);
}

TEST(FaceReaderTest, RequiresALandmarkModel) {
  EXPECT_THROW(FaceReader({}, nullptr), std::invalid_argument);
}

TEST(FaceReaderTest, FaceProbabilityCombinesDetectorAndLandmarkScores) {
  // With well-fitted points the detector may be uncertain. For a covered face, a certain detector
  // and half-fitted points are enough. Neither is enough alone.
  EXPECT_GT(face_probability(0.9, 0.7), 0.7);
  EXPECT_GT(face_probability(0.1, 0.95), 0.5);
  EXPECT_GT(face_probability(0.99, 0.4), 0.5);
  EXPECT_LT(face_probability(0.5, 0.4), 0.5);
  EXPECT_LT(face_probability(1, 0), 0.5);
  EXPECT_LT(face_probability(0, 0.6), 0.5);
  for (double p = 0; p < 1; p += 0.1) {
    EXPECT_LE(face_probability(p, 0.4), face_probability(p + 0.1, 0.4));
    EXPECT_LT(face_probability(0.9, p), face_probability(0.9, p + 0.1));
  }
}

TEST(FaceReaderTest, ReturnsAnUncertainFaceOnRequest) {
  if (!std::filesystem::exists(kImage)) GTEST_SKIP() << "needs the package opencv-doc";
  const cv::Mat gray = read_gray_image(kImage);
  const auto model = std::make_shared<const landmarks::LandmarkModel>(
      landmarks::read_landmark_model(TARSIER_SOURCE_MODELS "/landmarks68.json"));
  const auto networks = std::make_shared<const FaceNetworks>(
      read_face_networks(TARSIER_SOURCE_MODELS "/face-detector.json"));
  FaceReaderOptions options;
  ASSERT_FALSE(FaceReader(options, model, networks).read(gray).empty());
  EXPECT_TRUE(FaceReader(options, model, networks).read(gray).front().trusted);
  options.min_trust = 0.999;  // so that no face is trusted
  EXPECT_TRUE(FaceReader(options, model, networks).read(gray).empty());
  options.min_uncertain = kMinUncertain;
  const std::vector<Face> faces = FaceReader(options, model, networks).read(gray);
  ASSERT_EQ(faces.size(), 1U);
  EXPECT_FALSE(faces.front().trusted);
  EXPECT_TRUE(faces.front().box.contains({245, 93}));  // the face of the image
  EXPECT_EQ(faces.front().crop.size(), options.crop.size);
  // No face either in an image with nothing like a face.
  EXPECT_TRUE(FaceReader(options, model, networks)
                  .read(cv::Mat(240, 320, CV_8UC1, cv::Scalar(90)))
                  .empty());
}

TEST(FaceReaderTest, FindsNoFaceInAFlatImage) {
  FaceReaderOptions options;
  options.eyes = EyeMethod::kSplits;
  FaceReader reader(options, nullptr);
  EXPECT_TRUE(reader.read(cv::Mat(240, 320, CV_8UC1, cv::Scalar(90))).empty());
}

TEST(FaceReaderTest, BothCascadeMethodsFindTheEyes) {
  if (!std::filesystem::exists(kImage)) GTEST_SKIP() << "needs the package opencv-doc";
  cv::Mat gray = read_gray_image(kImage);
  cv::resize(gray, gray, {}, 2, 2, cv::INTER_CUBIC);
  for (const EyeMethod method : {EyeMethod::kCascades, EyeMethod::kSplits}) {
    FaceReaderOptions options;
    options.eyes = method;
    FaceReader reader(options, nullptr);
    const auto faces = reader.read(gray);
    // Their number is measured by `bench eyes`; here only their positions are checked.
    if (faces.empty()) continue;
    EXPECT_GT(faces[0].eyes.left.x, 2 * 215);
    EXPECT_LT(faces[0].eyes.right.x, 2 * 275);
    EXPECT_EQ(faces[0].crop.size(), options.crop.size);
  }
}

}  // namespace
}  // namespace tarsier::face::people
