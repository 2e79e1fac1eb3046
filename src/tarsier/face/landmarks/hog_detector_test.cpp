// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/hog_detector.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::face::landmarks {
namespace {

// "Faces": a bright square frame with a dark cross in it, on noise with other objects.
cv::Rect2d draw_object(cv::Mat& gray, cv::Point center, int side) {
  const cv::Rect box(center.x - side / 2, center.y - side / 2, side, side);
  cv::rectangle(gray, box, cv::Scalar(210), cv::FILLED);
  const int width = std::max(2, side / 8);
  cv::line(gray, box.tl() + cv::Point(side / 5, side / 5), box.br() - cv::Point(side / 5, side / 5),
           cv::Scalar(40), width);
  cv::line(gray, {box.x + side / 5, box.br().y - side / 5},
           {box.br().x - side / 5, box.y + side / 5}, cv::Scalar(40), width);
  return box;
}

// A disk with a line: no object.
void draw_other(cv::Mat& gray, cv::Point center, int side) {
  cv::circle(gray, center, side / 2, cv::Scalar(200), cv::FILLED);
  cv::line(gray, center - cv::Point(side / 3, 0), center + cv::Point(side / 3, 0), cv::Scalar(50),
           std::max(2, side / 8));
}

cv::Mat ground(cv::Size size, Rng& rng) {
  cv::Mat gray(size, CV_8UC1);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      gray.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(rng.integer(90, 120));
    }
  }
  return gray;
}

class HogDetectorTest : public ::testing::Test {
 protected:
  void SetUp() override {
    Rng rng(4);
    for (int k = 0; k < 10; ++k) {
      cv::Mat gray = ground({220, 180}, rng);
      const int side = rng.integer(50, 70);
      draw_other(gray, {170, 130}, 60);
      shape::BoxedImage image;
      image.image = folder_ / (std::to_string(k) + ".png");
      if (k < 8) {
        const cv::Rect2d box = draw_object(gray, {rng.integer(55, 90), rng.integer(55, 110)}, side);
        image.boxes.push_back(box);
        // Two "eyes" and a "mouth", right of the box's middle, so that the box model can be
        // checked.
        Eigen::Matrix2Xd shape(2, 3);
        shape << 0.4, 0.8, 0.6, 0.3, 0.3, 0.6;
        shape *= side;
        shape.row(0).array() += box.x;
        shape.row(1).array() += box.y;
        image.shapes.push_back(shape);
      }
      write_image(image.image, gray);
      images_.push_back(image);
    }
    options_.window = 48;
    options_.c = 10;
    options_.epsilon = 0.1;
  }
  HogTraining trained() { return train_hog_detector(images_, "set", options_, silent_, {}); }

  TemporaryFolder folder_;
  std::vector<shape::BoxedImage> images_;
  HogOptions options_;
  NoProgress silent_;
};

TEST_F(HogDetectorTest, FindsTrainedObjectsOnly) {
  const HogTraining training = trained();
  EXPECT_EQ(training.boxes, 8);
  EXPECT_EQ(training.images, 10);
  Rng rng(90);
  cv::Mat gray = ground({400, 300}, rng);
  const cv::Rect2d small = draw_object(gray, {90, 80}, 60);
  const cv::Rect2d large = draw_object(gray, {280, 170}, 130);
  draw_other(gray, {100, 220}, 80);
  HogFinder finder(training.detector);
  const std::vector<ScoredBox> found = finder.find(gray, 48);
  ASSERT_EQ(found.size(), 2U);
  for (const cv::Rect2d& truth : {small, large}) {
    double best = 0;
    for (const ScoredBox& box : found) {
      best = std::max(best, (box.box & truth).area() / (box.box | truth).area());
    }
    EXPECT_GT(best, 0.6) << truth;
  }
  EXPECT_TRUE(finder.find(gray(cv::Rect(0, 150, 180, 150)).clone(), 48).empty());
}

TEST_F(HogDetectorTest, LearnsTheBoxModel) {
  const HogDetector detector = trained().detector;
  ASSERT_TRUE(detector.box);
  // The window moves in steps of a cell, which is a sixth of the window. The tolerance is half a
  // cell.
  EXPECT_NEAR(detector.box->dx, 0.1, 0.085);
  EXPECT_NEAR(detector.box->dy, -0.1, 0.085);
  EXPECT_NEAR(detector.box->size, 0.22, 0.05);
  // The finder passes on the detector's box model. Starts lie on the shape although the landmark
  // model's own boxes differ.
  LandmarkModel model;
  model.shape = shape::train_shape_model({images_[0].shapes[0], images_[1].shapes[0]});
  model.box = {0.5, 0.5, 0.9, 1};
  FaceFinder finder(detector, {});
  const cv::Mat gray = read_gray_image(images_[2].image);
  const std::vector<Candidate> candidates = finder.find_confident(gray);
  ASSERT_EQ(candidates.size(), 1U);
  const Eigen::Matrix2Xd start = start_at(model, finder, candidates[0]);
  const Eigen::Matrix2Xd& truth = images_[2].shapes[0];
  EXPECT_LT((start.rowwise().mean() - truth.rowwise().mean()).norm(),
            0.35 * regression::shape_size(truth));
}

TEST_F(HogDetectorTest, SameForAnyNumberOfThreads) {
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const HogDetector one = trained().detector;
  cv::setNumThreads(3);
  const HogDetector three = trained().detector;
  cv::setNumThreads(threads);
  EXPECT_EQ(one.weights, three.weights);
  EXPECT_EQ(one.threshold, three.threshold);
}

TEST_F(HogDetectorTest, FileRoundTripAndRejectsInvalidFiles) {
  HogDetector detector;
  detector.width = detector.height = 48;
  detector.weights = Eigen::MatrixXf::Random(kHogPlanes, detector.cells().area());
  detector.threshold = 0.25;
  detector.box = BoxModel{0.1, -0.1, 0.3, 7};
  const std::string path = folder_ / "d.json";
  write_hog_detector(path, detector, nlohmann::json::object());
  const HogDetector back = read_hog_detector(path);
  EXPECT_EQ(back.weights, detector.weights);
  EXPECT_EQ(back.threshold, detector.threshold);
  EXPECT_EQ(back.box->size, 0.3);

  const Archive good = read_archive(path, "face-detector", 1);
  const auto refused = [&](const char* name, const nlohmann::json& value) {
    Archive bad = good;
    bad.payload[name] = value;
    write_archive(path, bad);
    EXPECT_THROW((void)read_hog_detector(path), ModelError) << name << " " << value.dump();
  };
  refused("width", 1000000);
  refused("width", 80);
  refused("cell", 0);
  refused("padding", -1);
  refused("overlap", 3);
  refused("weights", pack(PackedArray<float>{{kHogPlanes, 4}, std::vector<float>(4 * kHogPlanes)}));
  refused("box", {{"dx", 0}});
}

TEST_F(HogDetectorTest, BoundsDetectionsWhenEveryWindowPasses) {
  HogDetector detector;
  detector.width = detector.height = 48;
  detector.weights = Eigen::MatrixXf::Constant(kHogPlanes, detector.cells().area(), 0.1F);
  detector.threshold = -1000;
  detector.overlap = 1;
  const std::vector<ScoredBox> found =
      HogFinder(detector).find(cv::Mat(600, 800, CV_8UC1, cv::Scalar(80)), 48);
  EXPECT_GE(found.size(), 10U);
  EXPECT_LE(found.size(), 200U);
}

TEST_F(HogDetectorTest, CanBeInterruptedAndNamesUnusableBoxes) {
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)train_hog_detector(images_, "set", options_, silent_, stop.get_token()),
               Interrupted);
  options_.window = 200;  // larger than every object, and no upsampling
  try {
    (void)trained();
    FAIL() << "boxes smaller than the window";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("option 'upsample'"), std::string::npos)
        << error.what();
  }
  for (shape::BoxedImage& image : images_) image.image += ".gone";
  EXPECT_THROW((void)trained(), InputError);
}

TEST_F(HogDetectorTest, DrawsTheFilter) {
  const cv::Mat drawn = draw_hog_detector(trained().detector, 16);
  EXPECT_EQ(drawn.type(), CV_8UC3);
  EXPECT_GT(cv::norm(drawn, cv::NORM_INF), 200);
}

}  // namespace
}  // namespace tarsier::face::landmarks
