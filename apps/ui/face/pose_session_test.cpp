// SPDX-License-Identifier: MIT
#include "ui/face/pose_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/media/image_file.h"
#include "tarsier/render/builtin.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include "ui/testing_stages.h"
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace tarsier {
namespace {

constexpr const char* kMessi = "/usr/share/doc/opencv-doc/examples/data/messi5.jpg";

// The models that ship, but for the view: none.
const face::PoseModels& models() {
  static const face::PoseModels shared = [] {
    face::PoseTrackerOptions options;
    options.refine = false;
    return face::load_pose_models(ModelStore(TARSIER_SOURCE_MODELS), options);
  }();
  return shared;
}

class PoseSessionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(kMessi)) GTEST_SKIP() << "needs the package opencv-doc";
    image_ = read_image(kMessi);
  }
  static PoseSession session(const PoseSessionOptions& options = {}) {
    return {face::PoseTracker(models(), {}), options};
  }
  Frame frame(int index = 0, bool still = true) const {
    Frame frame;
    frame.image = image_;
    frame.index = index;
    frame.time = 0.04 * index;
    frame.name = "messi";
    frame.still = still;
    return frame;
  }
  cv::Mat image_;
};

TEST_F(PoseSessionTest, MirroredImageHasTheMirroredPose) {
  PoseSession pose_session = session();
  const View view = pose_session.on_frame(frame(), {});
  ASSERT_EQ(pose_session.faces().size(), 1U);
  ASSERT_TRUE(pose_session.faces()[0].pose);
  const face::head::HeadAngles angles = pose_session.faces()[0].pose->angles;
  // He looks down and to image right.
  EXPECT_NEAR(angles.yaw_deg, -33, 15);
  EXPECT_NEAR(angles.pitch_deg, -20, 12);
  EXPECT_GT(cv::norm(view.output, image_, cv::NORM_INF), 50);  // axes are drawn
  const Eigen::Vector3d place = pose_session.faces()[0].pose->camera_from_head.translation;
  // The face is left of the image's middle.
  EXPECT_LT(place[0], 0);
  EXPECT_GT(place[2], 1000);

  cv::flip(image_, image_, 1);
  (void)pose_session.on_frame(frame(), {});
  ASSERT_EQ(pose_session.faces().size(), 1U);
  const face::head::HeadAngles mirrored = pose_session.faces()[0].pose->angles;
  EXPECT_NEAR(mirrored.yaw_deg, -angles.yaw_deg, 6);
  EXPECT_NEAR(mirrored.roll_deg, -angles.roll_deg, 4);
  EXPECT_NEAR(mirrored.pitch_deg, angles.pitch_deg, 6);
}

TEST_F(PoseSessionTest, JsonHasTheDocumentedKeys) {
  PoseSession pose_session = session();
  (void)pose_session.on_frame(frame(), {});
  const nlohmann::ordered_json list =
      face::posed_faces_json(pose_session.faces(), pose_session.result().tracked);
  ASSERT_EQ(list.size(), 1U);
  for (const char* key :
       {"box", "points", "score", "rotation", "translation", "yaw", "pitch", "roll"}) {
    EXPECT_TRUE(list[0].contains(key)) << key;
  }
  ASSERT_EQ(list[0]["rotation"].size(), 9U);
  // R = Rz(roll) Rx(-pitch) Ry(yaw), row-major.
  const auto r = geometry::row_major(
      face::head::rotation_of_angles({list[0]["yaw"].get<double>(), list[0]["pitch"].get<double>(),
                                      list[0]["roll"].get<double>()}));
  for (std::size_t k = 0; k < 9; ++k) {
    EXPECT_NEAR(list[0]["rotation"][k].get<double>(), r[k], 1e-3) << k;
  }
}

TEST_F(PoseSessionTest, KeepsTheIdAndConvergesInAVideo) {
  PoseSession pose_session = session();
  face::head::HeadAngles last;
  for (int i = 0; i < 12; ++i) {
    (void)pose_session.on_frame(frame(i, false), {});
    ASSERT_EQ(pose_session.faces().size(), 1U) << i;
    EXPECT_EQ(pose_session.faces()[0].face.id, 1);
    ASSERT_TRUE(pose_session.faces()[0].pose) << i;
    const face::head::HeadAngles now = pose_session.faces()[0].pose->angles;
    if (i > 6) {
      EXPECT_NEAR(now.yaw_deg, last.yaw_deg, 0.5) << i;
      EXPECT_NEAR(now.pitch_deg, last.pitch_deg, 0.5) << i;
    }
    last = now;
  }
  // The face goes and comes back.
  const cv::Mat face = image_.clone();
  image_.setTo(cv::Scalar::all(90));
  for (int i = 12; i < 16; ++i) (void)pose_session.on_frame(frame(i, false), {});
  EXPECT_TRUE(pose_session.faces().empty());
  image_ = face;
  for (int i = 16; i < 32; ++i) (void)pose_session.on_frame(frame(i, false), {});
  ASSERT_EQ(pose_session.faces().size(), 1U);
  EXPECT_NEAR(pose_session.faces()[0].pose->angles.yaw_deg, last.yaw_deg, 5);
}

TEST_F(PoseSessionTest, PassesStagesToAWatchingSink) {
  test_support::WatchedStages stages;
  PoseSession watched(face::PoseTracker(models(), {}), {}, &stages);
  PoseSession plain = session();
  for (const bool still : {false, true}) {
    stages.watched = false;
    stages.names.clear();
    (void)plain.on_frame(frame(0, still), {});
    (void)watched.on_frame(frame(0, still), {});
    EXPECT_TRUE(stages.names.empty());
    stages.watched = true;
    const View view = watched.on_frame(frame(1, still), {});
    EXPECT_THAT(stages.names, ::testing::IsSupersetOf({"start", "mean", "first pose",
                                                       "second/start", "second/mean", "pose"}));
    EXPECT_EQ(stages.names.back(), "pose");
    EXPECT_TRUE(stages.are_images);
    EXPECT_EQ(cv::norm(view.output, plain.on_frame(frame(1, still), {}).output, cv::NORM_INF), 0)
        << "looking changes the drawing";
  }
}

TEST_F(PoseSessionTest, HeadOccludesTheDrawnObject) {
  PoseSessionOptions options;
  options.overlay = PoseOverlay::kObject;
  render::Mesh ball = render::make_sphere(20, {0, 0, 1});
  for (cv::Vec3f& p : ball.positions) p = p * 25.0F + cv::Vec3f(0, 20, -120);  // before the nose
  options.object = std::make_shared<const render::Mesh>(ball);
  PoseSession before = session(options);
  const View seen = before.on_frame(frame(), {});
  EXPECT_GT(cv::norm(seen.output, image_, cv::NORM_INF), 60);
  for (cv::Vec3f& p : ball.positions) p[2] += 220;  // inside the skull
  options.object = std::make_shared<const render::Mesh>(ball);
  PoseSession behind = session(options);
  const View hidden = behind.on_frame(frame(), {});
  EXPECT_EQ(cv::norm(hidden.output, image_, cv::NORM_INF), 0);
}

TEST_F(PoseSessionTest, ScalesTheCameraToSmallerImagesOfTheSameAspect) {
  face::PoseTrackerOptions options;
  options.camera = face::head::guess_camera(image_.size());
  options.camera->width *= 2;
  options.camera->height *= 2;
  options.camera->fx *= 2;
  options.camera->fy *= 2;
  options.camera->cx = 2 * options.camera->cx + 0.5;
  options.camera->cy = 2 * options.camera->cy + 0.5;
  PoseSession scaled(face::PoseTracker(models(), options), {});
  (void)scaled.on_frame(frame(), {});
  EXPECT_NEAR(scaled.camera().fx, face::head::guess_camera(image_.size()).fx, 1e-9);
  EXPECT_NEAR(scaled.camera().cx, face::head::guess_camera(image_.size()).cx, 1e-9);
  options.camera->height += 100;
  PoseSession other(face::PoseTracker(models(), options), {});
  EXPECT_THROW((void)other.on_frame(frame(), {}), InputError);
}

TEST_F(PoseSessionTest, KeysSwitchTheOverlayAndQuit) {
  PoseSession pose_session = session();
  (void)pose_session.on_frame(frame(), {});
  EXPECT_EQ(pose_session.on_event(key_event('v')).state["draw"], "box");
  EXPECT_EQ(pose_session.on_event(key_event('v')).state["draw"], "head");
  EXPECT_EQ(pose_session.on_event(key_event('v')).state["draw"], "none");
  EXPECT_EQ(pose_session.on_event(action_event("draw")).state["draw"], "axes");
  EXPECT_FALSE(pose_session.on_event(key_event('d')).finished);
  EXPECT_TRUE(pose_session.on_event(key_event('q')).finished);
}

TEST_F(PoseSessionTest, RefusesTheObjectOverlayWithoutAnObject) {
  PoseSessionOptions options;
  options.overlay = PoseOverlay::kObject;  // but no object
  EXPECT_THROW((void)session(options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier
