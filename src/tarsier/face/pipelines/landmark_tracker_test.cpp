// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/landmark_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/detect/testing_anchors.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/face/pipelines/testing_messi.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

namespace tarsier::face {
namespace {

using testing::HasSubstr;
namespace fs = std::filesystem;

const LandmarkTracker& tracker() {
  static const LandmarkTracker shared = LandmarkTracker::load(models());
  return shared;
}

class Landmarks : public MessiTest {};

TEST_F(Landmarks, OfAStillAreThoseOfTheFinder) {
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

TEST_F(Landmarks, GrayAndColourGiveTheSame) {
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

TEST_F(Landmarks, OfAVideoKeepTheirIdUntilAnotherBegins) {
  LandmarkState state;
  for (int k = 0; k < 3; ++k) {
    const LandmarkResult result = tracker().process(frame(k, false), state);
    ASSERT_EQ(result.faces.size(), 1U);
    EXPECT_TRUE(result.tracked);
    EXPECT_EQ(result.faces[0].id, 1);
    EXPECT_EQ(to_json(result)["faces"][0]["id"], 1);
  }
  // Another video counts from 1 again.
  state.tracker.next_id = 7;
  EXPECT_EQ(tracker().process(frame(0, false, "b.mp4"), state).faces.at(0).id, 1);
  redetect(state);
  EXPECT_TRUE(state.tracker.tracks.at(0).lost);
}

TEST_F(Landmarks, OfImagesInSequenceAreTrackedAsOfAVideo) {
  LandmarkState state;
  for (int k = 0; k < 3; ++k) {
    const std::string name = "frames/" + std::to_string(k) + ".png";
    EXPECT_EQ(tracker().process(frame(k, false, name), state).faces.at(0).id, k == 0 ? 1 : 7);
    // Were it another video, its faces would count from 1 again.
    state.tracker.tracks.at(0).face.id = 7;
  }
}

TEST_F(Landmarks, TwoStatesDoNotMeet) {
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

TEST(LandmarkLoading, NamesWhatIsMissing) {
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

TEST(LandmarkLoading, RefusesBadOptions) {
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

TEST(FaceDetectorModel, IsThatOfTheStoreElseTheCascades) {
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

TEST(FaceDetectorModel, TakesTheInstalledOneBesideIt) {
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

  // What all its views agree on is sure; in a video one of them looks, and nothing is.
  cv::Mat image(416, 416, CV_8UC1, cv::Scalar(0));
  image(cv::Rect(160, 96, 64, 64)) = 255;
  landmarks::FaceFinder both = DetectorModel::load(store).make_finder();
  landmarks::FaceFinder own = DetectorModel::load(store, "own").make_finder();
  EXPECT_TRUE(own.find(image).empty());
  const std::vector<landmarks::Candidate> candidates = both.find(image);
  ASSERT_FALSE(candidates.empty());
  EXPECT_TRUE(candidates.front().sure);
  EXPECT_GT(candidates.front().score, 0.9);
  const auto inside = [](const landmarks::Candidate& candidate) {
    const cv::Point2d middle = 0.5 * (candidate.box.tl() + candidate.box.br());
    return cv::norm(middle - cv::Point2d(192, 128)) < 110;
  };
  EXPECT_TRUE(std::any_of(candidates.begin(), candidates.end(), inside));
  const std::vector<landmarks::Candidate> one =
      both.find_in(image, {cv::Rect(0, 0, 416, 416), 40, 0});
  ASSERT_FALSE(one.empty());
  for (const landmarks::Candidate& candidate : one) EXPECT_FALSE(candidate.sure);

  fs::resize_file(installed, 100);
  EXPECT_THROW(static_cast<void>(DetectorModel::load(store)), ModelError);
}

}  // namespace
}  // namespace tarsier::face
