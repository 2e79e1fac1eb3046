// SPDX-License-Identifier: MIT
#include "ui/face/pose_session.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rounding.h"
#include "tarsier/face/head/draw_pose.h"
#include "tarsier/face/head/surface.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/render/render.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier {
namespace {

constexpr std::array<const char*, 5> kOverlayNames{"none", "axes", "box", "head", "object"};

const char* name_of(PoseOverlay overlay) {
  return kOverlayNames[static_cast<std::size_t>(overlay)];
}

}  // namespace

void PoseSessionOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(overlay != PoseOverlay::kObject || object != nullptr, "no object to draw");
  TARSIER_REQUIRE(edits.empty() || appearance != nullptr, "no appearance model to edit with");
}

PoseSession::PoseSession(face::PoseTracker tracker, PoseSessionOptions options, DebugSink* debug)
    : FrameSession("Head pose"),
      tracker_(std::move(tracker)),
      options_((options.check(), std::move(options))),
      debug_(debug) {
  const int points = tracker_.landmarks().model().points();
  if (!options_.edits.empty()) {
    TARSIER_REQUIRE(options_.appearance->points() == points,
                    "an appearance model of {} points, landmarks of {}",
                    options_.appearance->points(), points);
    synthesis_.emplace(*options_.appearance);
  }
}

const face::head::HeadModel& PoseSession::head_model() const {
  return tracker_.finder().estimator().model();
}

void PoseSession::process(const Frame& frame) {
  result_ = tracker_.process(frame, state_, watched(debug_));
}

bool PoseSession::act(const std::string& name) {
  if (name == "redetect") face::redetect(state_);
  if (name != "draw") return false;
  const std::size_t kinds = options_.object != nullptr ? 5 : 4;
  options_.overlay =
      static_cast<PoseOverlay>((static_cast<std::size_t>(options_.overlay) + 1) % kinds);
  return true;
}

std::vector<Action> PoseSession::own_actions() const {
  return {{"redetect", "detect faces again", 'd'}, {"draw", "choose the overlay", 'v'}};
}

void PoseSession::draw_object(cv::Mat& image, const face::PosedFace& face) const {
  const face::head::HeadSurface surface =
      face::head::head_surface(head_model(), face::head::shape_of(head_model(), face.pose->b));
  auto occluder = std::make_shared<render::Mesh>();
  for (Eigen::Index i = 0; i < surface.points.cols(); ++i) {
    const Eigen::Vector3f x = surface.points.col(i).cast<float>();
    occluder->positions.emplace_back(x[0], x[1], x[2]);
  }
  for (const std::array<int, 3>& corners : surface.triangles) {
    render::Triangle triangle;
    triangle.position = corners;
    occluder->triangles.push_back(triangle);
  }
  render::Scene scene;
  scene.antialias = true;
  scene.shading = render::Shading::kPhong;
  scene.light.specular = 0.25;
  scene.near = 1;
  render::Item head;
  head.mesh = occluder;
  head.camera_from_mesh = face.pose->camera_from_head;
  head.role = render::Role::kOccluder;
  render::Item object;
  object.mesh = options_.object;
  object.camera_from_mesh = face.pose->camera_from_head;
  scene.items = {head, object};
  render::render(image, scene, camera());
}

void PoseSession::edit_face(cv::Mat& image, const face::PosedFace& face) const {
  Eigen::Matrix2Xd points = face.face.points;
  for (const face::appearance::FaceEdit edit : options_.edits)
    points =
        face::appearance::edited_points(*options_.appearance, points, edit, options_.edit_amount);
  face::appearance::draw_edited(*synthesis_, *options_.appearance, image, face.face.points, points);
}

void PoseSession::draw(cv::Mat& image) {
  if (synthesis_) {
    for (const face::PosedFace& face : faces()) edit_face(image, face);
  }
  // The farthest head first, so that the object of a nearer head covers it.
  std::vector<const face::PosedFace*> order;
  for (const face::PosedFace& face : faces()) {
    if (face.pose) order.push_back(&face);
  }
  std::stable_sort(
      order.begin(), order.end(), [](const face::PosedFace* a, const face::PosedFace* b) {
        return a->pose->camera_from_head.translation[2] > b->pose->camera_from_head.translation[2];
      });
  for (const face::PosedFace* face : order) {
    const face::head::HeadPose& pose = *face->pose;
    const geometry::Rigid3& place = pose.camera_from_head;
    if (options_.overlay == PoseOverlay::kAxes) {
      // Letters would hide a small face.
      face::head::draw_axes(image, camera(), place, {60, 60, -100}, face->face.box.width > 120);
    } else if (options_.overlay == PoseOverlay::kBox) {
      face::head::draw_box(image, camera(), place, {-75, -85, -35}, {75, 115, 115});
    } else if (options_.overlay == PoseOverlay::kHead) {
      face::head::draw_head(image, camera(), place, head_model(),
                            face::head::shape_of(head_model(), pose.b));
    } else if (options_.overlay == PoseOverlay::kObject) {
      draw_object(image, *face);
    }
    if (options_.overlay == PoseOverlay::kNone || options_.overlay == PoseOverlay::kObject) {
      continue;
    }
    image::draw::TextStyle text;
    text.height_px = std::clamp(face->face.box.height * 0.06, 8.0, 24.0);
    const std::string angles =
        fmt::format("{}yaw {:+.0f} +-{:.0f}  pitch {:+.0f} +-{:.0f}  roll {:+.0f} +-{:.0f}",
                    !result_.tracked ? "" : fmt::format("{}:  ", face->face.id),
                    pose.angles.yaw_deg, pose.yaw_sigma_deg, pose.angles.pitch_deg,
                    pose.pitch_sigma_deg, pose.angles.roll_deg, pose.roll_sigma_deg);
    const cv::Size size = image::draw::text_size(angles, text.height_px);
    const int x = std::clamp(cvRound(face->face.box.x), 0, std::max(0, image.cols - size.width));
    const int y = std::max(cvRound(face->face.box.y), size.height);
    image::draw::put_text(image, angles, {x, y}, text, image::draw::Anchor::kBottomLeft);
  }
}

nlohmann::json PoseSession::state() const {
  nlohmann::json ids = nlohmann::json::array();
  nlohmann::json yaws = nlohmann::json::array();
  for (const face::PosedFace& face : faces()) {
    ids.push_back(face.face.id);
    yaws.push_back(face.pose ? nlohmann::json(rounded_to_steps(face.pose->angles.yaw_deg, 10))
                             : nullptr);
  }
  return {{"faces", faces().size()},
          {"ids", std::move(ids)},
          {"yaw", std::move(yaws)},
          {"draw", name_of(options_.overlay)}};
}

std::string PoseSession::status() const { return count_text(faces().size(), "face"); }

}  // namespace tarsier
