// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/view_training.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/pipelines/pose_evaluation.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>

namespace tarsier::face {
namespace {

// Files are divided into this many parts; each is held out once.
constexpr int kPartsPerFile = 7;
constexpr int kFirstPartGroup = 1000;  // group number; lower ones are people
// Larger than the scored range, degrees.
constexpr double kMaxPan = 90;
constexpr double kMaxTilt = 60;

const PosedFace* first_face(const std::vector<PosedFace>& faces, cv::Size /*size*/) {
  return !faces.empty() && faces.front().pose ? &faces.front() : nullptr;
}

// The face whose box contains the centre of `points`.
const PosedFace* face_at(const std::vector<PosedFace>& faces, const Eigen::Matrix2Xd& points) {
  const Eigen::Vector2d middle = points.rowwise().mean();
  for (const PosedFace& face : faces)
    if (face.pose && face.face.box.contains(cv::Point2d(middle[0], middle[1]))) return &face;
  return nullptr;
}

}  // namespace

ViewTraining::ViewTraining(const PoseModels& models, const PoseTrackerOptions& options)
    : tracker_(models, options), mapping_(models.mapping) {
  TARSIER_REQUIRE(!options.refine && !options.camera,
                  "a view model is trained with landmarks only and guessed cameras");
}

ViewTraining::Seen ViewTraining::see(const std::string& path, const Choice& choice) {
  Frame frame;
  frame.image = read_image(path);
  frame.name = path;
  frame.still = true;
  const PoseResult result = tracker_.process(frame, state_);
  Seen seen;
  seen.camera = result.camera;
  const PosedFace* face = choice(result.faces, frame.image.size());
  if (face == nullptr) return seen;
  seen.pose = *face->pose;
  seen.points = face->face.points(Eigen::all, mapping_.landmarks);
  // The uncalibrated covariance of the estimator, which the view model's correction starts from.
  Eigen::VectorXd sigma_px;
  if (face->face.visibility.sigma_px.size() > 0)
    sigma_px = face->face.visibility.sigma_px(mapping_.landmarks);
  seen.raw = seen.pose;
  if (const auto again = estimator().pose(seen.points, seen.camera, sigma_px); again.pose)
    seen.raw = *again.pose;
  cv::Mat gray;
  seen.view = head_view::view_of_head(gray_of(frame.image, gray), seen.camera,
                                      seen.pose.camera_from_head, estimator().model(), seen.points);
  return seen;
}

// Returns the index of the image in `seen_`, -1 if no head was found. `forward`: in the camera's
// frame. `nominal`: it is the direction in which the person was asked to look.
int ViewTraining::add(Seen seen, int group, const Eigen::Vector3d& forward, bool nominal) {
  if (!seen.view) return -1;
  const Eigen::Vector3d in_view = seen.view->camera_from_view.transpose() * forward;
  samples_.push_back({*seen.view, head_view::direction_of(*seen.view, in_view), group, nominal});
  seen_.push_back(std::move(seen));
  return static_cast<int>(seen_.size()) - 1;
}

void ViewTraining::add_exact(Seen seen, int group, const std::string& image,
                             const Eigen::Matrix3d& rotation) {
  const int at = add(std::move(seen), group, rotation * Eigen::Vector3d(0, 0, -1), false);
  if (at < 0) return;
  head::PosePair pair;
  pair.image = image;
  pair.truth = rotation;
  exact_.emplace_back(at, pair);
}

int ViewTraining::next_group() {
  return kFirstPartGroup + kPartsPerFile * (files_ - 1) + lines_++ % kPartsPerFile;
}

void ViewTraining::add_pointing(const std::string& folder, double tilt_share, Progress& progress,
                                const std::stop_token& stop) {
  const std::vector<PointingImage> images = pointing_images(folder, kMaxPan, kMaxTilt);
  progress.begin("Pointing'04", static_cast<std::int64_t>(images.size()), "images");
  for (const auto& [path, name] : images) {
    throw_if_stopped(stop);
    progress.advance();
    const Eigen::Vector3d forward =
        head::forward_of_gaze({name.pan_deg, name.tilt_deg * tilt_share});
    const auto in_box = [&image = path](const std::vector<PosedFace>& faces, cv::Size size) {
      return face_in_head_box(faces, image, size);
    };
    pointing_index_.push_back(add(see(path, in_box), name.person, forward, true));
    head::PointingOutcome outcome;
    outcome.image = path;
    outcome.truth = name;
    pointing_.push_back(std::move(outcome));
  }
  progress.end();
  sources_.emplace_back("Pointing'04");
}

void ViewTraining::add_truth(const std::string& file, Progress& progress,
                             const std::stop_token& stop) {
  const std::vector<head::PoseLine> lines = head::read_pose_lines(file);
  ++files_;
  lines_ = 0;
  progress.begin(file, static_cast<std::int64_t>(lines.size()), "images");
  for (const head::PoseLine& line : lines) {
    throw_if_stopped(stop);
    progress.advance();
    if (!line.rotation) continue;
    const int group = next_group();
    add_exact(see(resolve_image_path(file, line.image), first_face), group, line.image,
              *line.rotation);
  }
  progress.end();
  sources_.push_back(file);
}

void ViewTraining::add_annotated(const shape::LandmarkSet& set, const std::string& name,
                                 Progress& progress, const std::stop_token& stop) {
  const int landmarks = tracker_.finder().landmarks().points();
  if (set.points() != landmarks) {
    throw InputError(
        name, fmt::format("has {} points, the landmark model has {}", set.points(), landmarks));
  }
  ++files_;
  lines_ = 0;
  progress.begin(name, static_cast<std::int64_t>(set.samples.size()), "images");
  for (const shape::LandmarkSample& sample : set.samples) {
    throw_if_stopped(stop);
    progress.advance();
    const int group = next_group();
    Seen seen = see(sample.image, [&](const std::vector<PosedFace>& faces, cv::Size /*size*/) {
      return face_at(faces, sample.points);
    });
    if (!seen.view) continue;
    const Eigen::Matrix2Xd points = sample.points(Eigen::all, mapping_.landmarks);
    const head::HeadPoseResult truth = estimator().pose(points, seen.camera);
    if (truth.pose)
      add_exact(std::move(seen), group, sample.image, truth.pose->camera_from_head.rotation);
  }
  progress.end();
  sources_.push_back(name);
}

ViewTraining::Scores ViewTraining::score(const std::vector<head::HeadPose>& poses) const {
  Scores scores;
  std::vector<head::PointingOutcome> pointing = pointing_;
  for (std::size_t i = 0; i < pointing.size(); ++i) {
    if (pointing_index_[i] < 0) continue;
    const head::HeadPose& pose = poses[static_cast<std::size_t>(pointing_index_[i])];
    pointing[i].rotation = pose.camera_from_head.rotation;
    pointing[i].sigma_deg = angle_sigmas(pose);
  }
  if (!pointing.empty()) scores.pointing = head::score_pointing(pointing);
  std::vector<head::PosePair> pairs;
  for (auto [at, pair] : exact_) {
    const head::HeadPose& pose = poses[static_cast<std::size_t>(at)];
    pair.rotation = pose.camera_from_head.rotation;
    pair.sigma_deg = angle_sigmas(pose);
    pair.sigma_floor_deg = pose.sigma_floor_deg;
    pairs.push_back(pair);
  }
  if (!pairs.empty()) scores.exact = head::score_poses(pairs, static_cast<int>(pairs.size()));
  return scores;
}

ViewTraining::Scores ViewTraining::score_landmarks() const {
  std::vector<head::HeadPose> poses;
  poses.reserve(seen_.size());
  for (const Seen& seen : seen_) poses.push_back(seen.pose);
  return score(poses);
}

ViewTraining::Scores ViewTraining::score_held_out(
    const head_view::TrainViewOptions& options) const {
  const std::vector<head_view::CorrectedDirection> found =
      head_view::leave_groups_out(samples_, options);
  std::vector<head::HeadPose> poses;
  for (std::size_t i = 0; i < seen_.size(); ++i) {
    const Seen& seen = seen_[i];
    auto pose = head_view::refined_pose(found[i], *seen.view, estimator(), seen.points, seen.camera,
                                        seen.raw, nullptr);
    poses.push_back(pose ? *pose : seen.pose);
  }
  return score(poses);
}

}  // namespace tarsier::face
