// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/pose_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rounding.h"
#include "tarsier/face/head/train_head.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/geometry/frame_camera.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::face {
namespace {

constexpr const char* kShippedView = "head-view.json";
constexpr std::size_t kMinPoints = 6;  // of a head, for its pose

// `landmarks`: number of landmarks that the view model must have.
std::shared_ptr<const head_view::ViewModel> load_view(const ModelStore& models,
                                                      const PoseTrackerOptions& options,
                                                      int landmarks) {
  if (!options.refine) return nullptr;
  if (options.view.empty()) {
    const bool all_ship = options.fit == PoseFit::kLandmarks && options.head.empty() &&
                          options.mapping.empty() && options.landmarks.model.empty();
    if (!all_ship || !models.has(kShippedView)) return nullptr;
  }
  const std::string path = models.path_or(options.view, kShippedView);
  auto view = std::make_shared<const head_view::ViewModel>(head_view::read_view_model(path));
  if (view->landmarks() != landmarks) {
    throw ModelError(path, fmt::format("was learnt with {} landmarks, the head has {}: learn it "
                                       "again with the same head and mapping",
                                       view->landmarks(), landmarks));
  }
  return view;
}

// Starts from the points of the landmark tracker if a face is new or was lost.
AppearanceTrackerOptions appearance_options(const PoseTrackerOptions& options) {
  const landmarks::TrackerOptions& tracking = options.landmarks.tracker;
  AppearanceTrackerOptions result;
  result.model = options.appearance;
  result.start = AppearanceStart::kLandmarks;
  result.landmarks = options.landmarks;
  result.tracker.search_every = tracking.search_every;
  result.tracker.max_objects = tracking.max_faces;
  result.tracker.remember_s = tracking.remember_s;
  return result;
}

std::vector<landmarks::TrackedFace> faces_of(
    const std::vector<appearance::TrackedObject>& objects) {
  std::vector<landmarks::TrackedFace> faces;
  for (const appearance::TrackedObject& object : objects) {
    landmarks::TrackedFace face;
    face.id = object.id;
    face.points = object.fit.points;
    face.score = 1 - object.fit.error;
    const Eigen::Vector2d low = face.points.rowwise().minCoeff();
    const Eigen::Vector2d size = face.points.rowwise().maxCoeff() - low;
    face.box = {low.x(), low.y(), size.x(), size.y()};
    faces.push_back(std::move(face));
  }
  return faces;
}

}  // namespace

void PoseTrackerOptions::check() const {
  landmarks.check();
  pose.check();
  one_euro.check();
  TARSIER_REQUIRE(refine || view.empty(),
                  "a view model is given, but the refinement does not use it");
  TARSIER_REQUIRE(fit == PoseFit::kAam || appearance.empty(),
                  "an appearance model is given, but the points are not fitted by it");
  TARSIER_REQUIRE(mean_length >= 1 && mean_length <= 1000, "mean of {} frames", mean_length);
  TARSIER_REQUIRE(focal_px == 0 || (focal_px > 0 && std::isfinite(focal_px)), "focal length of {}",
                  focal_px);
}

PoseModels load_pose_models(const ModelStore& models, const PoseTrackerOptions& options) {
  options.check();
  PoseModels result{LandmarkTracker::load(models, options.landmarks),
                    std::make_shared<const head::HeadModel>(
                        head::read_head_model(models.path_or(options.head, "head.json"))),
                    {},
                    {},
                    {}};
  const int landmarks = result.landmarks.model().points();
  result.mapping = options.mapping.empty() ? head::own_mapping(*result.head)
                                           : head::read_landmark_mapping(
                                                 options.mapping, result.head->points(), landmarks);
  for (const int landmark : result.mapping.landmarks) {
    if (landmark >= landmarks) {
      throw UsageError(
          fmt::format("the head model needs landmark {}, but the landmark model has {} landmarks: "
                      "give a file (option 'mapping')",
                      landmark, landmarks));
    }
  }
  if (result.mapping.landmarks.size() < kMinPoints) {
    throw UsageError("option 'mapping': a head's pose needs at least 6 points");
  }
  const head::HeadModel chosen = head::select_points(*result.head, result.mapping.model_points);
  result.view = load_view(models, options, static_cast<int>(chosen.mirror.size()));
  if (options.fit == PoseFit::kAam)
    result.appearance =
        AppearanceTracker::load(models, appearance_options(options),
                                std::make_shared<const LandmarkTracker>(result.landmarks));
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
    for (const double value : geometry::row_major(pose.camera_from_head.rotation)) {
      object["rotation"].push_back(rounded_to_steps(value, 1e7));
    }
    object["translation"] = nlohmann::ordered_json::array();
    for (const double value : pose.camera_from_head.translation) {
      object["translation"].push_back(rounded_to_steps(value, 100));
    }
    object["yaw"] = rounded_to_steps(pose.angles.yaw_deg, 100);
    object["pitch"] = rounded_to_steps(pose.angles.pitch_deg, 100);
    object["roll"] = rounded_to_steps(pose.angles.roll_deg, 100);
    object["yaw_sigma_deg"] = rounded_to_steps(pose.yaw_sigma_deg, 100);
    object["pitch_sigma_deg"] = rounded_to_steps(pose.pitch_sigma_deg, 100);
    object["roll_sigma_deg"] = rounded_to_steps(pose.roll_sigma_deg, 100);
    object["sigma_floor_deg"] = nlohmann::ordered_json::array();
    for (const double value : pose.sigma_floor_deg)
      object["sigma_floor_deg"].push_back(rounded_to_steps(value, 100));
    object["rms_px"] = rounded_to_steps(pose.rms_px, 100);
  }
  return list;
}

nlohmann::ordered_json to_json(const PoseResult& result) {
  return {{"faces", posed_faces_json(result.faces, result.tracked)},
          {"ms", rounded_to_steps(result.ms, 100)}};
}

PoseTracker::PoseTracker(const PoseModels& models, const PoseTrackerOptions& options)
    : landmarks_(models.landmarks),
      appearance_(models.appearance),
      finder_((options.check(), models.landmarks.shared_model()), models.landmarks.fit(),
              *models.head, models.mapping, options.pose, models.view),
      options_(options) {
  TARSIER_REQUIRE((options.fit == PoseFit::kAam) == appearance_.has_value(),
                  "a fit by an appearance model needs one, and another does not");
  landmarks_.set_tracking(options.landmarks.tracker);
}

PoseTracker PoseTracker::load(const ModelStore& models, const PoseTrackerOptions& options) {
  return {load_pose_models(models, options), options};
}

geometry::Camera PoseTracker::camera_for(const Frame& frame) const {
  if (options_.camera) return geometry::camera_of_frame(*options_.camera, frame);
  geometry::Camera camera = head::guess_camera(frame.image.size());
  if (options_.focal_px > 0) camera.fx = camera.fy = options_.focal_px;
  return camera;
}

std::vector<PosedFace> PoseTracker::faces_of_still(const Frame& frame,
                                                   const geometry::Camera& camera, PoseState& state,
                                                   DebugSink* debug) const {
  LandmarkState& landmark_state = state.landmarks;
  const cv::Mat& gray = gray_of(frame.image, landmark_state.gray);
  if (!appearance_)
    return finder_.find(gray, camera, *landmark_state.finder, landmark_state.workspace, 0.5, debug);
  std::vector<PosedFace> posed;
  for (landmarks::TrackedFace& face : faces_of(appearance_->process(frame, state.appearance)))
    posed.push_back(finder_.pose_of_points(std::move(face), gray, camera, nullptr, false, debug));
  return posed;
}

std::vector<PosedFace> PoseTracker::faces_of_video(const Frame& frame,
                                                   const geometry::Camera& camera, PoseState& state,
                                                   DebugSink* debug) const {
  LandmarkState& landmark_state = state.landmarks;
  const landmarks::TrackerOptions& tracking = landmarks_.tracking();
  const cv::Mat& gray = gray_of(frame.image, landmark_state.gray);
  std::vector<PosedFace> result;
  for (landmarks::TrackedFace& face :
       appearance_ ? faces_of(appearance_->process(frame, state.appearance))
                   : landmarks::track_faces(finder_.landmarks(), finder_.fit(), tracking,
                                            *landmark_state.finder, landmark_state.tracker, gray,
                                            frame.time, landmark_state.workspace, debug)) {
    PoseState::Person& person = state.persons.try_emplace(face.id, options_).first->second;
    person.last_seen_s = frame.time;
    // A face with a low score is not used to learn the head's shape.
    const bool learn = face.score >= tracking.min_new;
    PosedFace posed = appearance_ ? finder_.pose_of_points(std::move(face), gray, camera,
                                                           &person.identity, learn, debug)
                                  : finder_.pose_of(std::move(face), gray, camera, &person.identity,
                                                    learn, landmark_state.workspace, debug);
    if (posed.pose) {
      geometry::Rigid3& pose = posed.pose->camera_from_head;
      Eigen::Matrix3d& covariance = posed.pose->rotation_covariance;
      if (options_.smoothing == PoseSmoothing::kMean) pose = person.mean(pose, &covariance);
      if (options_.smoothing == PoseSmoothing::kOneEuro)
        pose = person.one_euro(pose, frame.time, &covariance);
      head::set_angles(*posed.pose);
    }
    result.push_back(std::move(posed));
  }
  // A person who left gets a new id on return.
  std::erase_if(state.persons, [&](const auto& entry) {
    return frame.time > entry.second.last_seen_s + tracking.remember_s + 1;
  });
  return result;
}

PoseResult PoseTracker::process(const Frame& frame, PoseState& state, DebugSink* debug) const {
  LandmarkState& landmark_state = state.landmarks;
  if (!landmark_state.finder) landmark_state.finder.emplace(landmarks_.detector().make_finder());
  const std::string source = source_of(frame);
  if (frame.still || source != landmark_state.source) {
    redetect(state);
    landmark_state.tracker = {};  // ids start again at 1
  }
  landmark_state.source = source;
  PoseResult result;
  result.tracked = !frame.still;
  result.camera = camera_for(frame);
  const auto start = std::chrono::steady_clock::now();
  result.faces = frame.still ? faces_of_still(frame, result.camera, state, debug)
                             : faces_of_video(frame, result.camera, state, debug);
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  result.ms = spent.count();
  return result;
}

void redetect(PoseState& state) {
  redetect(state.landmarks);
  redetect(state.appearance);
  state.persons.clear();
}

}  // namespace tarsier::face
