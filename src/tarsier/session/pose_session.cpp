// SPDX-License-Identifier: MIT
#include "tarsier/session/pose_session.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/draw/text.h"
#include "tarsier/head/draw_pose.h"
#include "tarsier/head/surface.h"
#include "tarsier/landmarks/faces_json.h"
#include "tarsier/render/render.h"
#include "tarsier/session/frame_camera.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace tarsier {
namespace {

constexpr std::array<const char*, 5> kOverlayNames{"none", "axes", "box", "head", "object"};

const char* name_of(PoseOverlay overlay) {
  return kOverlayNames[static_cast<std::size_t>(overlay)];
}

double rounded(double value, double digits) { return std::round(value * digits) / digits; }

}  // namespace

void PoseSessionOptions::check() const {
  fit.check();
  tracker.check();
  pose.check();
  one_euro.check();
  TARSIER_REQUIRE(mean_length >= 1 && mean_length <= 1000, "mean of {} frames", mean_length);
  TARSIER_REQUIRE(focal_px == 0 || (focal_px > 0 && std::isfinite(focal_px)), "focal length of {}",
                  focal_px);
  TARSIER_REQUIRE(overlay != PoseOverlay::kObject || object != nullptr, "no object to draw");
  TARSIER_REQUIRE(edits.empty() || appearance != nullptr, "no appearance model to edit with");
  TARSIER_REQUIRE(edit_amount >= 0 && edit_amount <= 2, "an edit of {}", edit_amount);
}

PoseSession::PoseSession(const landmarks::LandmarkModel& landmarks, const head::HeadModel& head,
                         const head::LandmarkMapping& mapping, landmarks::FaceFinder finder,
                         PoseSessionOptions options)
    : heads_(landmarks, options.fit, head, mapping, options.pose, options.view),
      finder_(std::move(finder)),
      options_((options.check(), std::move(options))) {
  if (!options_.edits.empty()) {
    TARSIER_REQUIRE(options_.appearance->points() == landmarks.points(),
                    "an appearance model of {} points, landmarks of {}",
                    options_.appearance->points(), landmarks.points());
    synthesis_.emplace(*options_.appearance);
  }
  if (options_.object != nullptr) {
    surface_ = head::head_surface(heads_.poser().model(), heads_.poser().model().mean).triangles;
  }
}

geometry::Camera PoseSession::camera_for(const Frame& frame) const {
  if (options_.camera) return camera_of_frame(*options_.camera, frame);
  geometry::Camera camera = head::guess_camera(frame.image.size());
  if (options_.focal_px > 0) camera.fx = camera.fy = options_.focal_px;
  return camera;
}

void PoseSession::find(const Frame& frame) {
  if (still_) {
    faces_ = heads_.find(gray_, camera_, finder_, workspace_);
    return;
  }
  faces_.clear();
  for (landmarks::TrackedFace& face :
       landmarks::track_faces(heads_.landmarks(), heads_.fit(), options_.tracker, finder_, state_,
                              gray_, frame.time, workspace_)) {
    const auto [at, is_new] = persons_.try_emplace(face.id, options_);
    Person& person = at->second;
    person.seen = frame.time;
    // A face that is hardly seen teaches nothing of its shape.
    const bool learn = face.score >= options_.tracker.least_new;
    PosedFace posed =
        heads_.pose_of(std::move(face), gray_, camera_, &person.identity, learn, workspace_);
    if (posed.pose) {
      geometry::Rigid& pose = posed.pose->camera_from_head;
      if (options_.smoothing == PoseSmoothing::kMean) pose = person.mean(pose);
      if (options_.smoothing == PoseSmoothing::kOneEuro) pose = person.one_euro(pose, frame.time);
      posed.pose->angles = head::angles_of_rotation(pose.rotation);
    }
    faces_.push_back(std::move(posed));
  }
}

View PoseSession::on_frame(const Frame& frame, const SourceStatus& source) {
  if (frame.still || frame.name != name_) {
    state_ = {};
    persons_.clear();
  }
  frame_ = frame.image;
  still_ = frame.still;
  name_ = frame.name;
  source_ = source.state == SourceState::kLive ? "" : std::string(tarsier::name_of(source.state));
  camera_ = camera_for(frame);
  timer_.start();
  cv::cvtColor(frame.image, gray_, cv::COLOR_BGR2GRAY);
  find(frame);
  timer_.stop();
  // Who left will not come back under that id.
  std::erase_if(persons_, [&](const auto& entry) {
    return frame.time > entry.second.seen + options_.tracker.remember_s + 1;
  });
  draw();
  return view(true);
}

View PoseSession::on_idle(const SourceStatus& source) {
  source_ = source.state == SourceState::kLive ? "" : std::string(tarsier::name_of(source.state));
  return view(false);
}

View PoseSession::on_event(const Event& event) {
  const std::string name = action_of(event, actions());
  if (name == "quit") finished_ = true;
  if (name == "pause") paused_ = !paused_;
  if (name == "help") help_ = !help_;
  if (name == "redetect") {
    landmarks::redetect(state_);
    persons_.clear();
  }
  if (name == "draw") {
    const std::size_t kinds = options_.object != nullptr ? 5 : 4;
    options_.overlay =
        static_cast<PoseOverlay>((static_cast<std::size_t>(options_.overlay) + 1) % kinds);
    if (!frame_.empty()) draw();
  }
  return view(name == "draw" && !frame_.empty() && still_);
}

std::vector<Action> PoseSession::actions() const {
  return {{"redetect", "look for faces anew", 'd'},
          {"draw", "what is drawn", 'v'},
          {"pause", "pause and go on", key::kSpace},
          {"help", "this list", 'h'},
          {"quit", "end", 'q'}};
}

void PoseSession::draw_object(const PosedFace& face) {
  const head::HeadSurface surface = head::head_surface(
      heads_.poser().model(), head::shape_of(heads_.poser().model(), face.pose->b));
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
  render::render(output_, scene, camera_);
}

void PoseSession::edit_face(const PosedFace& face) {
  Eigen::Matrix2Xd points = face.face.points;
  for (const appearance::FaceEdit edit : options_.edits)
    points = appearance::edited_points(*options_.appearance, points, edit, options_.edit_amount);
  appearance::draw_edited(*synthesis_, *options_.appearance, output_, face.face.points, points);
}

void PoseSession::draw() {
  frame_.copyTo(output_);
  if (synthesis_) {
    for (const PosedFace& face : faces_) edit_face(face);
  }
  // The farthest first, so that a nearer head's object lies over it.
  std::vector<const PosedFace*> order;
  for (const PosedFace& face : faces_) {
    if (face.pose) order.push_back(&face);
  }
  std::stable_sort(order.begin(), order.end(), [](const PosedFace* a, const PosedFace* b) {
    return a->pose->camera_from_head.translation[2] > b->pose->camera_from_head.translation[2];
  });
  for (const PosedFace* face : order) {
    const head::HeadPose& pose = *face->pose;
    const geometry::Rigid& place = pose.camera_from_head;
    if (options_.overlay == PoseOverlay::kAxes) {
      // Letters would hide a small face.
      head::draw_axes(output_, camera_, place, {60, 60, -100}, face->face.box.width > 120);
    } else if (options_.overlay == PoseOverlay::kBox) {
      head::draw_box(output_, camera_, place, {-75, -85, -35}, {75, 115, 115});
    } else if (options_.overlay == PoseOverlay::kHead) {
      head::draw_head(output_, camera_, place, heads_.poser().model(),
                      head::shape_of(heads_.poser().model(), pose.b));
    } else if (options_.overlay == PoseOverlay::kObject) {
      draw_object(*face);
    }
    if (options_.overlay == PoseOverlay::kNone || options_.overlay == PoseOverlay::kObject) {
      continue;
    }
    draw::TextStyle text;
    text.height_px = std::clamp(face->face.box.height * 0.06, 8.0, 24.0);
    const std::string angles =
        fmt::format("{}yaw {:+.0f}  pitch {:+.0f}  roll {:+.0f}",
                    still_ ? "" : fmt::format("{}:  ", face->face.id), pose.angles.yaw_deg,
                    pose.angles.pitch_deg, pose.angles.roll_deg);
    const cv::Size size = draw::text_size(angles, text.height_px);
    const int x = std::clamp(cvRound(face->face.box.x), 0, std::max(0, output_.cols - size.width));
    const int y = std::max(cvRound(face->face.box.y), size.height);
    draw::put_text(output_, angles, {x, y}, text, draw::Anchor::kBottomLeft);
  }
}

View PoseSession::view(bool fresh) {
  View result;
  nlohmann::json ids = nlohmann::json::array();
  nlohmann::json yaws = nlohmann::json::array();
  for (const PosedFace& face : faces_) {
    ids.push_back(face.face.id);
    yaws.push_back(face.pose ? nlohmann::json(rounded(face.pose->angles.yaw_deg, 10)) : nullptr);
  }
  result.state = {{"faces", faces_.size()},
                  {"ids", std::move(ids)},
                  {"yaw", std::move(yaws)},
                  {"draw", name_of(options_.overlay)},
                  {"paused", paused_}};
  result.status = fmt::format("{} {}{}{}", faces_.size(), faces_.size() == 1 ? "face" : "faces",
                              source_.empty() ? "" : "  " + source_, paused_ ? "  paused" : "");
  if (fresh) result.output = output_;
  if (!output_.empty()) {
    output_.copyTo(shown_);
    draw::status_bar(shown_, result.status, timer_.words(still_) + "   h: help");
    if (help_) draw_help(shown_, "Head pose", actions());
    result.image = shown_;
  }
  result.finished = finished_;
  return result;
}

nlohmann::ordered_json posed_faces_json(const std::vector<PosedFace>& faces, bool with_ids) {
  std::vector<landmarks::TrackedFace> tracked;
  tracked.reserve(faces.size());
  for (const PosedFace& face : faces) tracked.push_back(face.face);
  nlohmann::ordered_json list = landmarks::faces_json(tracked, with_ids);
  for (std::size_t i = 0; i < faces.size(); ++i) {
    nlohmann::ordered_json& object = list[i];
    if (!faces[i].pose) {
      object["reason"] = faces[i].reason;
      continue;
    }
    const head::HeadPose& pose = *faces[i].pose;
    object["rotation"] = nlohmann::ordered_json::array();
    for (const double value : pose.camera_from_head.rotation.val) {
      object["rotation"].push_back(rounded(value, 1e7));
    }
    object["translation"] = nlohmann::ordered_json::array();
    for (const double value : pose.camera_from_head.translation.val) {
      object["translation"].push_back(rounded(value, 100));
    }
    object["yaw"] = rounded(pose.angles.yaw_deg, 100);
    object["pitch"] = rounded(pose.angles.pitch_deg, 100);
    object["roll"] = rounded(pose.angles.roll_deg, 100);
    object["rms_px"] = rounded(pose.rms_px, 100);
  }
  return list;
}

}  // namespace tarsier
