// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/landmark_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/detect/box_detector.h"
#include "tarsier/face/detect/testing_anchors.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::face {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

const LandmarkTracker& tracker() {
  static const LandmarkTracker shared = LandmarkTracker::load(models());
  return shared;
}

class LandmarkTrackerTest : public MessiTest {};

TEST_F(LandmarkTrackerTest, StillResultEqualsFindFaces) {
  LandmarkState state;
  const LandmarkResult result = tracker().process(frame(0, true), state);
  ASSERT_EQ(result.faces.size(), 1U);
  EXPECT_FALSE(result.tracked);
  EXPECT_GT(result.ms, 0);

  cv::Mat gray;
  cv::cvtColor(image_, gray, cv::COLOR_BGR2GRAY);
  landmarks::FaceFinder finder = tracker().detector().make_finder();
  landmarks::FitWorkspace workspace;
  const auto expected =
      landmarks::find_faces(tracker().model(), tracker().fit(), gray, finder, workspace);
  ASSERT_EQ(expected.size(), 1U);
  EXPECT_EQ(result.faces[0].points, expected[0].fit.points);
  EXPECT_EQ(result.faces[0].id, 1);

  const nlohmann::ordered_json json = to_json(result);
  EXPECT_EQ(json["faces"], landmarks::faces_json(result.faces, false));
  EXPECT_TRUE(json.contains("ms"));
  EXPECT_FALSE(json["faces"][0].contains("id"));
}

// A detector that needs a margin around the face.
struct MarginDetector final : BoxDetector {
  [[nodiscard]] std::vector<ScoredFace> find(const cv::Mat& gray) const override {
    if (gray.cols <= without_margin) return {};
    return {{box, 0.9}};
  }
  int without_margin = 0;
  cv::Rect2d box;  // the detection
};

TEST_F(LandmarkTrackerTest, TightCropGivesTheSameLandmarks) {
  LandmarkState state;
  const LandmarkResult whole = tracker().process(frame(0, true), state);
  ASSERT_EQ(whole.faces.size(), 1U);
  const Eigen::Matrix2Xd& points = whole.faces[0].points;
  const Eigen::Vector2d low = points.rowwise().minCoeff();
  const Eigen::Vector2d high = points.rowwise().maxCoeff();
  const cv::Rect area(cv::Point(cvFloor(low.x()), cvFloor(low.y())),
                      cv::Point(cvCeil(high.x()) + 1, cvCeil(high.y()) + 1));
  cv::Mat gray;
  cv::cvtColor(image_(area), gray, cv::COLOR_BGR2GRAY);
  const auto seen = std::make_shared<MarginDetector>();
  seen->without_margin = gray.cols;
  // The border is 0.3 of the longer side.
  const double border = cvRound(0.3 * std::max(gray.cols, gray.rows));
  const cv::Rect2d box = whole.faces[0].box - cv::Point2d(area.tl());
  seen->box = box + cv::Point2d(border, border);
  landmarks::FaceFinderOptions options;
  options.external_detector = seen;
  landmarks::FaceFinder finder(options);
  landmarks::FitWorkspace workspace;
  const auto find = [&] {
    return landmarks::find_faces(tracker().model(), tracker().fit(), gray, finder, workspace);
  };
  const auto faces = find();
  ASSERT_EQ(faces.size(), 1U);
  const double eyes = (points.col(45) - points.col(36)).norm();
  const Eigen::Matrix2Xd there = faces[0].fit.points.colwise() + Eigen::Vector2d(area.x, area.y);
  EXPECT_LT((there - points).colwise().norm().mean(), 0.05 * eyes);
  EXPECT_NEAR(faces[0].box.x, box.x, 1e-9);
  EXPECT_NEAR(faces[0].box.width, box.width, 1e-9);
  // Detections in the repeated border, or which do not fill the image, are no faces.
  seen->box = {0, 0, 20, 20};
  EXPECT_TRUE(find().empty());
  seen->box = {20, 20, 8, 8};
  EXPECT_TRUE(find().empty());
  // For a large image a reduced copy is searched.
  cv::resize(gray, gray, {}, 16, 16, cv::INTER_CUBIC);
  seen->without_margin = 200;
  const double shrunk = 200.0 / std::max(gray.cols, gray.rows);
  seen->box = {box.x * 16 * shrunk + 60, box.y * 16 * shrunk + 60, box.width * 16 * shrunk,
               box.height * 16 * shrunk};
  const auto large = find();
  ASSERT_EQ(large.size(), 1U);
  EXPECT_NEAR(large[0].box.width, 16 * box.width, 0.03 * 16 * box.width);
  const Eigen::Matrix2Xd reduced =
      (large[0].fit.points / 16).colwise() + Eigen::Vector2d(area.x, area.y);
  EXPECT_LT((reduced - points).colwise().norm().mean(), 0.08 * eyes);
}

// Rotates the image clockwise by `degrees` about the middle of `points`, and the points too.
cv::Mat rotated(const cv::Mat& image, double degrees, Eigen::Matrix2Xd& points) {
  const Eigen::Vector2d middle = points.rowwise().mean();
  const cv::Matx23d map = cv::getRotationMatrix2D(
      cv::Point2f(static_cast<float>(middle.x()), static_cast<float>(middle.y())), -degrees, 1);
  cv::Mat out;
  cv::warpAffine(image, out, map, image.size(), cv::INTER_CUBIC, cv::BORDER_REPLICATE);
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    const cv::Vec2d to = map * cv::Vec3d(points(0, i), points(1, i), 1);
    points.col(i) = Eigen::Vector2d(to[0], to[1]);
  }
  return out;
}

LandmarkTracker tracker_with(landmarks::RolledSearch rolled) {
  LandmarkTrackerOptions options;
  options.finder.rolled = rolled;
  return LandmarkTracker::load(models(), options);
}

TEST_F(LandmarkTrackerTest, FindsRolledFaces) {
  LandmarkState state;
  const LandmarkResult upright = tracker().process(frame(0, true), state);
  ASSERT_EQ(upright.faces.size(), 1U);
  const LandmarkTracker never = tracker_with(landmarks::RolledSearch::kNever);
  const LandmarkTracker always = tracker_with(landmarks::RolledSearch::kAlways);
  const double eyes = (upright.faces[0].points.col(45) - upright.faces[0].points.col(36)).norm();
  const cv::Mat image = image_;
  int missed = 0;
  for (const double degrees : {-60, -45, 45, 60}) {
    Eigen::Matrix2Xd points = upright.faces[0].points;
    image_ = rotated(image, degrees, points);
    const auto is_found = [&](const LandmarkResult& result) {
      return std::any_of(result.faces.begin(), result.faces.end(), [&](const auto& face) {
        return (face.points - points).colwise().norm().mean() < 0.08 * eyes;
      });
    };
    EXPECT_TRUE(is_found(tracker().process(frame(0, true), state))) << degrees;
    LandmarkState of_never;
    missed += is_found(never.process(frame(0, true), of_never)) ? 0 : 1;
    // In a video, the face is found in the first frame, and again after it was lost.
    LandmarkState video;
    const LandmarkResult first = tracker().process(frame(0, false), video);
    EXPECT_TRUE(is_found(first)) << degrees;
    ASSERT_EQ(first.faces.size(), 1U);
    video.tracker.tracks.at(0).lost = true;
    video.tracker.until_search = 100;
    const LandmarkResult again = tracker().process(frame(1, false), video);
    EXPECT_TRUE(is_found(again)) << degrees;
    EXPECT_EQ(again.faces.at(0).id, first.faces[0].id);
    // A face that appears later is found by one of the next two searches.
    LandmarkState late;
    cv::Mat empty(image.size(), CV_8UC3, cv::Scalar(90, 90, 90));
    std::swap(empty, image_);
    static_cast<void>(tracker().process(frame(0, false), late));
    std::swap(empty, image_);
    bool seen = false;
    for (int k = 1; k <= 2 * tracker().tracking().search_every + 1 && !seen; ++k)
      seen = is_found(tracker().process(frame(k, false), late));
    EXPECT_TRUE(seen) << degrees;
  }
  EXPECT_GE(missed, 2);
  // An upright face is bit for bit the same as without that search.
  image_ = image;
  LandmarkState other;
  const LandmarkResult without = never.process(frame(0, true), other);
  EXPECT_EQ(without.faces.at(0).points, upright.faces[0].points);
  LandmarkState third;
  const LandmarkResult both = always.process(frame(0, true), third);
  ASSERT_EQ(both.faces.size(), 1U);
  EXPECT_EQ(both.faces[0].points, upright.faces[0].points);
}

// Two faces, one of them rolled. Beside a good upright face, the rolled one is found only on
// request.
TEST_F(LandmarkTrackerTest, FindsARolledFaceNextToAnUprightOneOnRequest) {
  LandmarkState state;
  const LandmarkResult upright = tracker().process(frame(0, true), state);
  ASSERT_EQ(upright.faces.size(), 1U);
  Eigen::Matrix2Xd points = upright.faces[0].points;
  const cv::Mat rolled = rotated(image_, 50, points);
  cv::hconcat(image_, rolled, image_);
  const auto count = [&](landmarks::RolledSearch search) {
    LandmarkState own;
    return tracker_with(search).process(frame(0, true), own).faces.size();
  };
  EXPECT_EQ(count(landmarks::RolledSearch::kAuto), count(landmarks::RolledSearch::kNever));
  EXPECT_EQ(count(landmarks::RolledSearch::kAlways), 2U);
}

TEST_F(LandmarkTrackerTest, GreyAndColourGiveTheSameLandmarks) {
  LandmarkState state;
  const LandmarkResult of_color = tracker().process(frame(0, true), state);
  cv::Mat gray;
  cv::cvtColor(image_, gray, cv::COLOR_BGR2GRAY);
  image_ = gray;
  const LandmarkResult of_gray = tracker().process(frame(0, true), state);
  ASSERT_EQ(of_gray.faces.size(), of_color.faces.size());
  EXPECT_EQ(of_gray.faces[0].points, of_color.faces[0].points);
  image_ = cv::Mat(40, 40, CV_32FC1, cv::Scalar(0));
  EXPECT_THROW(static_cast<void>(tracker().process(frame(0, true), state)), std::invalid_argument);
}

TEST_F(LandmarkTrackerTest, KeepsIdsWithinAVideo) {
  LandmarkState state;
  for (int k = 0; k < 3; ++k) {
    const LandmarkResult result = tracker().process(frame(k, false), state);
    ASSERT_EQ(result.faces.size(), 1U);
    EXPECT_TRUE(result.tracked);
    EXPECT_EQ(result.faces[0].id, 1);
    EXPECT_EQ(to_json(result)["faces"][0]["id"], 1);
  }
  // Ids of another video start from 1 again.
  state.tracker.next_id = 7;
  EXPECT_EQ(tracker().process(frame(0, false, "b.mp4"), state).faces.at(0).id, 1);
  redetect(state);
  EXPECT_TRUE(state.tracker.tracks.at(0).lost);
}

TEST_F(LandmarkTrackerTest, TracksImageSequencesAsAVideo) {
  LandmarkState state;
  for (int k = 0; k < 3; ++k) {
    const std::string name = "frames/" + std::to_string(k) + ".png";
    EXPECT_EQ(tracker().process(frame(k, false, name), state).faces.at(0).id, k == 0 ? 1 : 7);
    // In another video its id would be 1 again.
    state.tracker.tracks.at(0).face.id = 7;
  }
}

TEST_F(LandmarkTrackerTest, StatesAreIndependent) {
  LandmarkState a;
  LandmarkState b;
  const LandmarkTracker copy = tracker();
  const LandmarkResult first = tracker().process(frame(0, false), a);
  a.tracker.next_id = 7;
  EXPECT_EQ(copy.process(frame(0, false), b).faces.at(0).id, first.faces.at(0).id);
}

std::string load_error(const ModelStore& store, const LandmarkTrackerOptions& options = {}) {
  try {
    static_cast<void>(LandmarkTracker::load(store, options));
  } catch (const ModelError& error) {
    return error.what();
  }
  return "no error";
}

TEST(LandmarkTrackerLoadTest, ErrorNamesTheMissingFile) {
  const TemporaryFolder empty;
  EXPECT_THAT(load_error(ModelStore(empty.path())), HasSubstr(empty / "landmarks68.json"));
  LandmarkTrackerOptions options;
  landmarks::LandmarkModel model = tracker().model();
  model.patches.reset();
  options.model = empty / "model.json";
  landmarks::write_landmark_model(options.model, model, {{"terms", "test"}});
  options.fit.method = landmarks::FitMethod::kPatches;
  EXPECT_THAT(load_error(models(), options), HasSubstr("no part for the method patch"));
  options = {};
  options.detector = empty / "detector.json";
  EXPECT_THAT(load_error(models(), options), HasSubstr(empty / "detector.json"));
}

TEST(LandmarkTrackerLoadTest, RejectsInvalidOptions) {
  LandmarkTrackerOptions options;
  options.fit.starts = 0;
  EXPECT_THROW(static_cast<void>(LandmarkTracker::load(models(), options)), std::invalid_argument);
  options = {};
  options.tracker.search_every = 0;
  EXPECT_THROW(options.check(), std::invalid_argument);
  options = {};
  options.finder.detector.min_face = 3;
  EXPECT_THROW(options.check(), std::invalid_argument);
  EXPECT_THROW(LandmarkTracker(nullptr, DetectorModel()), std::invalid_argument);
}

TEST(DetectorModelTest, LoadsTheShippedDetectorOrCascades) {
  EXPECT_NE(DetectorModel::load(models()).networks(), nullptr);
  EXPECT_EQ(DetectorModel::load(models(), "cascades").networks(), nullptr);
  const TemporaryFolder empty;
  EXPECT_EQ(DetectorModel::load(ModelStore(empty.path())).networks(), nullptr);
  EXPECT_NE(
      DetectorModel::load(ModelStore(empty.path()), models().path("face-detector.json")).networks(),
      nullptr);
  EXPECT_THROW(static_cast<void>(DetectorModel::load(models(), models().path("head.json"))),
               ModelError);
}

TEST(DetectorModelTest, UsesTheInstalledAnchorDetector) {
  const TemporaryFolder folder;
  const std::string installed = folder.path() + "/face-anchors.json";
  fs::copy(models().path("face-detector.json"), folder.path() + "/face-detector.json");
  write_anchor_detector(installed, bright_anchors(), {});
  const ModelStore store(folder.path());
  EXPECT_TRUE(has_anchor_detector(store));
  EXPECT_NE(DetectorModel::load(store).anchors(), nullptr);
  EXPECT_NE(DetectorModel::load(store, "own").networks(), nullptr);
  EXPECT_EQ(DetectorModel::load(store, "own").anchors(), nullptr);
  EXPECT_EQ(DetectorModel::load(store, "cascades").anchors(), nullptr);

  // A face that all views agree on is sure. In a video only one view is searched, and no face is
  // sure.
  cv::Mat image(416, 416, CV_8UC1, cv::Scalar(0));
  image(cv::Rect(160, 96, 64, 64)) = 255;
  landmarks::FaceFinder both = DetectorModel::load(store).make_finder();
  landmarks::FaceFinder own = DetectorModel::load(store, "own").make_finder();
  EXPECT_TRUE(own.find(image).empty());
  const std::vector<landmarks::Candidate> candidates = both.find(image);
  ASSERT_FALSE(candidates.empty());
  EXPECT_TRUE(candidates.front().confident);
  EXPECT_GT(candidates.front().score, 0.9);
  const auto inside = [](const landmarks::Candidate& candidate) {
    const cv::Point2d middle = 0.5 * (candidate.box.tl() + candidate.box.br());
    return cv::norm(middle - cv::Point2d(192, 128)) < 110;
  };
  EXPECT_TRUE(std::any_of(candidates.begin(), candidates.end(), inside));
  const std::vector<landmarks::Candidate> one =
      both.find_in(image, {cv::Rect(0, 0, 416, 416), 40, 0});
  ASSERT_FALSE(one.empty());
  for (const landmarks::Candidate& candidate : one) EXPECT_FALSE(candidate.confident);

  fs::resize_file(installed, 100);
  EXPECT_THROW(static_cast<void>(DetectorModel::load(store)), ModelError);
}

}  // namespace
}  // namespace tarsier::face
