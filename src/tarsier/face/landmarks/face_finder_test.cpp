// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/face_finder.h"

#include "tarsier/face/detect/cascade.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/face/shape/import.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/portrait.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>

namespace tarsier::face::landmarks {
namespace {

const std::string kModels = TARSIER_SOURCE_MODELS;

std::shared_ptr<const FaceNetworks> shipped() {
  static const auto networks =
      std::make_shared<const FaceNetworks>(read_face_networks(kModels + "/face-detector.json"));
  return networks;
}

// A wall with soft spots and grain.
cv::Mat wall(cv::Size size) {
  cv::Mat coarse(size.height / 40 + 1, size.width / 40 + 1, CV_8UC1);
  cv::RNG random(4);
  random.fill(coarse, cv::RNG::UNIFORM, 90, 150);
  cv::Mat image;
  cv::resize(coarse, image, size, 0, 0, cv::INTER_CUBIC);
  cv::Mat grain(size, CV_8UC1);
  random.fill(grain, cv::RNG::NORMAL, 20, 3);
  return image + grain;
}

// Draws a head whose face has a box of `width` px around `position`; returns the box.
cv::Rect2d draw_face(cv::Mat& image, cv::Point2d position, double width, std::uint64_t seed) {
  const synth::Portrait portrait = synth::render_portrait({480, 360}, 0, seed);
  const cv::Point2d* eyes = portrait.truth.eyes;
  // The box that a detector draws around these eyes.
  const double drawn = 2.4 * cv::norm(eyes[1] - eyes[0]);
  const double scale = width / drawn;
  const cv::Point2d center = (eyes[0] + eyes[1]) / 2 + cv::Point2d(0, 0.12 * drawn);
  cv::Mat gray;
  cv::cvtColor(portrait.image, gray, cv::COLOR_BGR2GRAY);
  const cv::Size size(cvRound(480 * scale), cvRound(360 * scale));
  cv::resize(gray, gray, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  const cv::Point at(cvRound(position.x - center.x * scale),
                     cvRound(position.y - center.y * scale));
  const cv::Rect area = cv::Rect(at, size) & cv::Rect(0, 0, image.cols, image.rows);
  gray(area - at).copyTo(image(area));
  return {position.x - width / 2, position.y - width / 2, width, width};
}

int found_of(const std::vector<cv::Rect2d>& truth, const std::vector<Candidate>& candidates) {
  return static_cast<int>(std::count_if(truth.begin(), truth.end(), [&](const cv::Rect2d& face) {
    return std::any_of(candidates.begin(), candidates.end(), [&](const Candidate& candidate) {
      const double common = (candidate.box & face).area();
      return common > 0.4 * (candidate.box.area() + face.area() - common);
    });
  }));
}

bool has_cascades() { return !find_cascade("haarcascade_frontalface_alt2.xml").empty(); }

TEST(FaceFinder, FindsAFaceOf40PixelsIn1080p) {
  cv::Mat image = wall({1920, 1080});
  const cv::Rect2d face = draw_face(image, {1433, 371}, 42, 2);
  FaceFinder finder(shipped(), {});
  EXPECT_EQ(finder.min_face(image.size()), 40);
  EXPECT_EQ(found_of({face}, finder.find(image)), 1);
  if (!has_cascades()) GTEST_SKIP() << "opencv-data is not installed";
  FaceFinder cascades;
  EXPECT_EQ(found_of({face}, cascades.find_confident(image)), 1);
}

TEST(FaceFinder, FindsFacesOf24PixelsOnRequest) {
  cv::Mat image = wall({1280, 720});
  const cv::Rect2d face = draw_face(image, {333, 271}, 26, 2);
  FaceFinderOptions options;
  EXPECT_EQ(found_of({face}, FaceFinder(shipped(), options).find(image)), 0);
  options.detector.min_face = 24;
  EXPECT_EQ(found_of({face}, FaceFinder(shipped(), options).find(image)), 1);
  // For a small image, small faces are found without an option.
  EXPECT_EQ(FaceFinder(shipped(), {}).min_face({640, 480}), 24);
}

TEST(FaceFinder, ALargeFaceDoesNotHideTheSmallOnes) {
  cv::Mat image = wall({1280, 720});
  const std::vector<cv::Rect2d> faces = {draw_face(image, {400, 380}, 280, 2),
                                         draw_face(image, {900, 300}, 90, 3),
                                         draw_face(image, {1150, 560}, 44, 2)};
  EXPECT_EQ(found_of(faces, FaceFinder(shipped(), {}).find(image)), 3);
  if (!has_cascades()) GTEST_SKIP() << "opencv-data is not installed";
  EXPECT_EQ(found_of(faces, FaceFinder().find(image)), 3);
}

// Detects one face in each image: the bright area, with the width `width`.
struct SeesABrightSpot final : BoxDetector {
  explicit SeesABrightSpot(double given) : width(given) {}
  [[nodiscard]] std::vector<ScoredFace> find(const cv::Mat& gray) const override {
    const cv::Moments moments = cv::moments(gray > 100, true);
    if (moments.m00 == 0) return {};
    const cv::Point2d center(moments.m10 / moments.m00 + 0.5, moments.m01 / moments.m00 + 0.5);
    return {{{center.x - width / 2, center.y - width / 2, width, width}, 0.9}};
  }
  double width;
};

TEST(FaceFinder, RolledSearchReturnsImageCoordinates) {
  cv::Mat image(400, 620, CV_8UC1, cv::Scalar(20));
  const cv::Point2d spot(451, 133);
  cv::circle(image, spot, 12, cv::Scalar(250), cv::FILLED);
  FaceFinderOptions options;
  options.external_detector = std::make_shared<SeesABrightSpot>(60);
  FaceFinder finder(options);
  const cv::Rect part(300, 40, 300, 250);
  for (const double degrees : {-90, -40, 0, 17, 45, 90}) {
    for (const cv::Rect& area : {cv::Rect({}, image.size()), part}) {
      const double roll = degrees * CV_PI / 180;
      // The area at full size, and at half size, which is enough for faces of 80 px.
      for (const double smallest : {24.0, 80.0}) {
        const auto found = finder.find_rolled_in(image, {area, smallest, 0}, roll);
        ASSERT_EQ(found.size(), 1U) << degrees;
        const cv::Rect2d& box = found[0].box;
        EXPECT_NEAR(box.x + box.width / 2, spot.x + 0.5, 0.7) << degrees;
        EXPECT_NEAR(box.y + box.height / 2, spot.y + 0.5, 0.7) << degrees;
        EXPECT_NEAR(box.width, smallest > 40 ? 120 : 60, 1);
        EXPECT_EQ(found[0].roll, roll);
      }
    }
  }
  // Each face once, although both rotated images show it.
  EXPECT_EQ(finder.find_rolled(image).size(), 1U);
  EXPECT_TRUE(finder.find_rolled_in(image, {part, 24, 50}, 0.5).empty());  // too large
  EXPECT_TRUE(finder.find_rolled_in(image, {{700, 0, 20, 20}, 24, 0}, 0.5).empty());
  EXPECT_THROW((void)finder.find_rolled_in(image, {part, 24, 0}, 2), std::invalid_argument);
}

// Nothing is detected in the repeated border of the rotated image.
TEST(FaceFinder, RolledFacesHaveTheirCenterInTheImage) {
  cv::Mat image(200, 200, CV_8UC1, cv::Scalar(20));
  image(cv::Rect(196, 90, 4, 20)).setTo(250);
  FaceFinderOptions options;
  options.external_detector = std::make_shared<SeesABrightSpot>(60);
  EXPECT_TRUE(FaceFinder(options).find_rolled(image).empty());
}

TEST(FaceFinder, StartHasTheRollOfTheCandidate) {
  Eigen::Matrix2Xd mean(2, 3);
  mean << -0.5, 0.5, 0, -0.2, -0.2, 0.4;
  BoxModel model;
  model.dx = 0.1;
  model.dy = 0.2;
  model.size = 0.5;
  const cv::Rect2d box(10, 20, 100, 100);
  const Eigen::Matrix2Xd upright = start_in_box(model, mean, box);
  const Eigen::Matrix2Xd rolled = start_in_box(model, mean, box, CV_PI / 2);
  const Eigen::Vector2d center(59.5, 69.5);
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector2d from = upright.col(i) - center;
    EXPECT_NEAR(rolled(0, i), center.x() - from.y(), 1e-9);  // clockwise, y points down
    EXPECT_NEAR(rolled(1, i), center.y() + from.x(), 1e-9);
  }
  EXPECT_EQ(start_in_box(model, mean, box, 0), upright);
}

TEST(FaceFinder, RolledSearchNamesRoundTrip) {
  for (const RolledSearch search :
       {RolledSearch::kNever, RolledSearch::kAuto, RolledSearch::kAlways})
    EXPECT_EQ(parse_rolled_search(name_of(search)), search);
  EXPECT_THROW((void)parse_rolled_search("often"), std::invalid_argument);
}

TEST(FaceFinder, TilesTogetherFindAllFaces) {
  cv::Mat image = wall({1280, 720});
  const std::vector<cv::Rect2d> faces = {draw_face(image, {400, 380}, 280, 2),
                                         draw_face(image, {900, 300}, 90, 3),
                                         draw_face(image, {1150, 560}, 44, 2)};
  FaceFinder finder(shipped(), {});
  const SearchPlan plan = finder.plan(image.size());
  std::vector<Candidate> all = finder.find_in(image, plan.whole);
  for (const SearchTile& tile : plan.tiles) {
    for (const Candidate& candidate : finder.find_in(image, tile)) all.push_back(candidate);
  }
  EXPECT_EQ(found_of(faces, all), 3);
}

// A model that accepts every fit.
LandmarkModel trusting_model() {
  const std::vector<regression::TrainingFace> faces = regression::test_support::blob_faces(20, 3);
  std::vector<Eigen::Matrix2Xd> shapes;
  for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
  LandmarkModel model;
  model.shape = shape::train_shape_model(shapes);
  NoProgress silent;
  regression::DescentOptions options;
  options.stages = {{16, 0.3}};
  options.components = 8;
  options.ridge = 100;  // strong ridge: points stay near the detected face
  model.descent = regression::train_descent(
      faces, regression::scattered_starts(faces, model.shape.mean, 2, 1), options, silent, {});
  return model;
}

TEST(FaceTracker, FindsSmallNewFaceInBoundedTimeAndCost) {
  const LandmarkModel model = trusting_model();
  for (const cv::Size size : {cv::Size(1920, 1080), cv::Size(3840, 2160)}) {
    const cv::Mat empty = wall(size);
    cv::Mat shown = empty.clone();
    const cv::Rect2d face = draw_face(shown, {0.71 * size.width, 0.33 * size.height}, 46, 2);
    FaceFinder finder(shipped(), {});
    const std::size_t tiles = finder.plan(size).tiles.size();
    TrackerState state;
    FitWorkspace workspace;
    std::size_t found_after = 0;
    std::int64_t dearest = 0;
    for (std::size_t frame = 0; frame <= tiles + 1 && found_after == 0; ++frame) {
      const std::int64_t before = finder.pixels();
      const auto faces = track_faces(model, {}, {}, finder, state, frame == 0 ? empty : shown,
                                     static_cast<double>(frame) / 25, workspace);
      // The whole first frame is searched.
      if (frame > 0) dearest = std::max(dearest, finder.pixels() - before);
      const bool found = std::any_of(faces.begin(), faces.end(), [&](const TrackedFace& one) {
        return (one.box & face).area() > 0.2 * face.area();
      });
      if (found) found_after = frame;
    }
    EXPECT_GT(found_after, 0U) << size << " in " << tiles << " frames";
    EXPECT_LE(found_after, tiles) << size;
    // The cost of one tile, and at times of the whole image at its coarsest level and at 320 px for
    // the cascade. It is the same for any image size.
    EXPECT_LT(dearest, 270'000) << size;
  }
}

// --- images ---

struct GroupImages {
  int faces = 0;
  int found = 0;
  int wrong = 0;
};

TEST(GroupImages, ShippedModelsFindTheFaces) {
  const char* data = std::getenv("TARSIER_DATA");
  const std::string folder = std::string(data != nullptr ? data : "") + "/dlib-faces";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << "no dlib-faces in $TARSIER_DATA";
  const LandmarkModel model = read_landmark_model(kModels + "/landmarks68.json");
  FaceFinder finder(shipped(), {});
  FitWorkspace workspace;
  GroupImages sum;
  for (const shape::BoxedImage& image :
       shape::read_dlib_boxes(folder + "/training_with_face_landmarks.xml").images) {
    const cv::Mat gray = read_gray_image(image.image);
    std::vector<Candidate> faces;
    for (const FittedFace& face : find_faces(model, {}, gray, finder, workspace)) {
      faces.push_back({face.box, true});
    }
    const int found = found_of(image.boxes, faces);
    sum.faces += static_cast<int>(image.boxes.size());
    sum.found += found;
    sum.wrong += static_cast<int>(faces.size()) - found;
  }
  EXPECT_EQ(sum.faces, 18);
  EXPECT_GE(sum.found, 17);
  EXPECT_LE(sum.wrong, 1);
}

}  // namespace
}  // namespace tarsier::face::landmarks
