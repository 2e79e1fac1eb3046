// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/detect/box_detector.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/quality.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/testing_blobs.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::face::landmarks {
namespace {

// A model of blobs with descent and quality, trained once.
const LandmarkModel& blob_model() {
  static const LandmarkModel model = [] {
    const std::vector<regression::TrainingFace> faces = regression::test_support::blob_faces(60, 3);
    std::vector<Eigen::Matrix2Xd> shapes;
    for (const regression::TrainingFace& face : faces) shapes.push_back(face.points);
    LandmarkModel result;
    result.shape = shape::train_shape_model(shapes);
    result.eyes = {0, 2};
    NoProgress silent;
    regression::DescentOptions options;
    options.stages = {{16, 0.4}, {24, 0.25}};
    options.components = 16;
    options.ridge = 0.1;
    result.descent = regression::train_descent(
        faces, regression::scattered_starts(faces, result.shape.mean, 6, 1), options, silent, {});
    std::vector<regression::RatedFit> fits;
    Rng rng(4);
    for (int f = 0; f < 60; ++f) {
      const Eigen::Matrix2Xd& truth = faces[static_cast<std::size_t>(f)].points;
      fits.push_back({f, truth});
      for (int k = 0; k < 3; ++k) {
        fits.push_back(
            {f, truth.colwise() + Eigen::Vector2d(rng.normal(0, 25), rng.normal(0, 25))});
      }
    }
    result.quality =
        regression::train_quality(faces, fits, regression::QualityOptions{}, silent, {});
    return result;
  }();
  return model;
}

// A detector that returns the object's box, shifted by `shift` px, with a given score.
class BoxBeside final : public BoxDetector {
 public:
  BoxBeside(const Eigen::Matrix2Xd& truth, double shift, double score) : score_(score) {
    box_ = box_around(blob_model().box, truth);
    box_.x += shift;
  }
  [[nodiscard]] std::vector<ScoredFace> find(const cv::Mat&) const override {
    return {{box_, score_}};
  }

 private:
  cv::Rect2d box_;
  double score_ = 0;
};

std::vector<FittedFace> found_by_box(const LandmarkModel& model, const cv::Mat& gray,
                                     const Eigen::Matrix2Xd& truth, double shift, double score) {
  FaceFinderOptions options;
  options.external_detector = std::make_shared<BoxBeside>(truth, shift, score);
  FaceFinder finder(options);
  FitWorkspace workspace;
  return find_faces(model, {}, gray, finder, workspace);
}

TEST(FindFaces, ShiftedBoxIsEnoughForAConfidentDetection) {
  Rng rng(3);
  const Eigen::Matrix2Xd truth =
      (regression::test_support::blob_shape(0.1) * 28).colwise() + Eigen::Vector2d(150, 90);
  const cv::Mat gray = regression::test_support::draw_blobs(truth, 28, {320, 180}, rng);
  for (const double shift : {0.0, 30.0, -30.0}) {
    const std::vector<FittedFace> faces = found_by_box(blob_model(), gray, truth, shift, 0.9);
    ASSERT_EQ(faces.size(), 1U) << shift;
    EXPECT_LT((faces[0].fit.points - truth).colwise().norm().mean(), 1.5) << shift;
    EXPECT_GT(faces[0].fit.score, 0.5) << shift;
  }
  // For an uncertain detection no further starts are tried.
  EXPECT_EQ(found_by_box(blob_model(), gray, truth, 0, 0.5).size(), 1U);
  EXPECT_TRUE(found_by_box(blob_model(), gray, truth, 40, 0.5).empty());
}

TEST(FindFaces, RejectsConfidentDetectionWithBadFit) {
  const Eigen::Matrix2Xd somewhere =
      (regression::test_support::blob_shape(0) * 28).colwise() + Eigen::Vector2d(150, 90);
  const cv::Mat nothing(180, 320, CV_8UC1, cv::Scalar(70));
  LandmarkModel model = blob_model();
  const std::vector<FittedFace> kept = found_by_box(model, nothing, somewhere, 0, 0.99);
  ASSERT_EQ(kept.size(), 1U);
  EXPECT_LT(kept[0].fit.score, 0.4);
  // The same with a final score below 0.1.
  model.quality->stage.bias[0] -= 0.4F;
  EXPECT_TRUE(found_by_box(model, nothing, somewhere, 0, 0.99).empty());
}

class TrackerTest : public FolderTest {
 protected:
  TrackerTest() {
    options_.smoothing = false;
    TrackerState::Track track;
    track.face.id = state_.next_id++;
    state_.tracks.push_back(track);
  }
  // Processes a frame with the object at `x`; the first call starts the track.
  std::vector<TrackedFace> show(double x, int frame, bool visible = true) {
    Rng rng(static_cast<std::uint64_t>(frame) + 1);
    truth_ = (regression::test_support::blob_shape(0.1) * 28).colwise() + Eigen::Vector2d(x, 90);
    const cv::Mat gray = visible ? regression::test_support::draw_blobs(truth_, 28, {320, 180}, rng)
                                 : cv::Mat(180, 320, CV_8UC1, 70);
    TrackerState::Track& track = state_.tracks.front();
    if (track.raw.cols() == 0) {
      track.raw = truth_;
      track.face.box = box_around(blob_model().box, truth_);
    }
    return track_faces(blob_model(), {}, options_, finder_, state_, gray, frame / 25.0, workspace_);
  }

  FaceFinder finder_;
  TrackerOptions options_;
  TrackerState state_;
  FitWorkspace workspace_;
  Eigen::Matrix2Xd truth_;
};

TEST_F(TrackerTest, TracksMovingFace) {
  for (int frame = 0; frame < 30; ++frame) {
    const std::vector<TrackedFace> faces = show(70 + 5 * frame, frame);
    ASSERT_EQ(faces.size(), 1U) << frame;
    EXPECT_EQ(faces[0].id, 1);
    EXPECT_LT((faces[0].points - truth_).colwise().norm().mean(), 2.5) << frame;
  }
}

TEST_F(TrackerTest, DropsDisappearedFace) {
  EXPECT_EQ(show(100, 0).size(), 1U);
  const std::vector<TrackedFace> none = show(100, 1, false);
  EXPECT_TRUE(none.empty()) << none[0].score;
}

TEST_F(TrackerTest, RedetectForgetsPositions) {
  EXPECT_EQ(show(100, 0).size(), 1U);
  redetect(state_);
  EXPECT_TRUE(show(100, 1).empty());  // the face detectors do not know these objects
}

TEST_F(TrackerTest, ModelFileRoundTrip) {
  write_landmark_model(path("m.json"), blob_model(), {{"terms", "none"}});
  const LandmarkModel read = read_landmark_model(path("m.json"));
  EXPECT_EQ(read.points(), 9);
  EXPECT_EQ(read.best_method(), FitMethod::kDescent);
  EXPECT_FALSE(read.has(FitMethod::kTrees));
  EXPECT_TRUE(read.quality.has_value());
}

TEST_F(TrackerTest, RejectsInconsistentModelFiles) {
  write_landmark_model(path("m.json"), blob_model(), nlohmann::json::object());
  Archive archive = read_archive(path("m.json"), "landmark-tracker", 1);
  LandmarkModel other = blob_model();
  regression::Descent& descent = *other.descent;
  descent.mean = descent.mean.leftCols(8).eval();
  for (regression::Descent::Stage& stage : descent.stages) {
    const Eigen::Index kept = stage.components.cols();
    stage.weights = stage.weights.topLeftCorner(16, 8 * kept).eval();
    stage.bias = stage.bias.head(16).eval();
  }
  archive.payload["descent"] = to_json(descent);
  write_archive(path("bad.json"), archive);
  EXPECT_THROW((void)read_landmark_model(path("bad.json")), ModelError);
  archive = read_archive(path("m.json"), "landmark-tracker", 1);
  archive.payload["eyes"] = {0, 9};
  write_archive(path("bad.json"), archive);
  EXPECT_THROW((void)read_landmark_model(path("bad.json")), ModelError);
  archive.version = 2;
  write_archive(path("bad.json"), archive);
  EXPECT_THROW((void)read_landmark_model(path("bad.json")), ModelError);
}

TEST(BoxModel, IsTheMedianOverCorrectBoxes) {
  std::vector<Eigen::Matrix2Xd> shapes;
  std::vector<cv::Rect2d> boxes;
  for (int i = 0; i < 9; ++i) {
    shapes.push_back((regression::test_support::blob_shape(0) * 20).colwise() +
                     Eigen::Vector2d(100, 110));
    boxes.emplace_back(60 + i - 4, 60, 80, 80);
  }
  boxes[0] = {300, 300, 80, 80};  // of another object
  boxes[1] = {};                  // not found
  const BoxModel model = train_box_model(shapes, boxes);
  EXPECT_EQ(model.trained_on, 7);
  EXPECT_NEAR(model.size, regression::shape_size(shapes[0]) / 80, 1e-9);
  const Eigen::Vector2d center = shapes[0].rowwise().mean();
  const Eigen::Matrix2Xd mean = (shapes[0].colwise() - center) / regression::shape_size(shapes[0]);
  const Eigen::Matrix2Xd start = start_in_box(model, mean, {60, 60, 80, 80});
  EXPECT_NEAR(start.row(1).mean(), 110, 1e-6);
  const cv::Rect2d back = box_around(model, shapes[0]);
  EXPECT_NEAR(back.width, 80, 1e-9);
  EXPECT_NEAR(back.y, 60, 1e-9);
}

TEST(AlphaBetaFilter, ReducesNoiseAtRestAndFollowsMotion) {
  Rng rng(1);
  const AlphaBetaFilterOptions options;
  const double unit = 100;
  AlphaBetaFilter at_rest;
  AlphaBetaFilter moving;
  double raw = 0;
  double calm = 0;
  double lag = 0;
  const Eigen::Matrix2Xd shape = regression::test_support::blob_shape(0) * 50;
  for (int t = 0; t < 200; ++t) {
    Eigen::Matrix2Xd noise(2, shape.cols());
    for (Eigen::Index i = 0; i < noise.size(); ++i) noise(i) = rng.normal(0, 1);
    const Eigen::Matrix2Xd smooth = at_rest.next(options, shape + noise, 0.04, unit);
    const Eigen::Vector2d gone(3.0 * t, 0);  // three quarters of an eye distance per second
    const Eigen::Matrix2Xd there = shape.colwise() + gone;
    const Eigen::Matrix2Xd followed = moving.next(options, there, 0.04, unit);
    if (t < 50) continue;
    raw += noise.squaredNorm();
    calm += (smooth - shape).squaredNorm();
    lag = std::max(lag, (followed - there).colwise().norm().maxCoeff());
  }
  EXPECT_LT(std::sqrt(calm / raw), 0.35);
  EXPECT_LT(lag, 6);
}

TEST(FitMethods, NamesRoundTrip) {
  for (const FitMethod method :
       {FitMethod::kMean, FitMethod::kTrees, FitMethod::kDescent, FitMethod::kPatches}) {
    EXPECT_EQ(parse_fit_method(name_of(method)), method);
  }
  EXPECT_THROW((void)parse_fit_method("forest"), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::landmarks
