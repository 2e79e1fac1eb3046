// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/head_view/view_train.h"
#include "tarsier/face/pipelines/pose_tracker.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/geometry/camera.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

// Images of heads of known poses, as head_view::train_view_model() learns from them, and how good it
// is on people that it has not seen:
//
//   face::PoseTrackerOptions options;
//   options.refine = false;
//   face::ViewTraining training(face::load_pose_models(ModelStore::find(), options), options);
//   NoProgress progress;
//   training.add_truth("heads/truth.jsonl", progress, {});
//   const auto model = face::head_view::train_view_model(training.samples(), {});
namespace tarsier::face {

class ViewTraining {
 public:
  // Poses are of the landmarks alone, by a guessed camera: throws std::invalid_argument for options with
  // `refine` or a camera, else as PoseTracker's constructor.
  ViewTraining(const PoseModels& models, const PoseTrackerOptions& options);

  // Images of Pointing'04, also of larger angles than are scored: corrections near the limits are
  // interpolated then. The truth is where the person was asked to look, in the camera's frame (the
  // marks are far from the head: where it moves, their directions stay), the tilt times `tilt_share`
  // (0.1..1.5: heads tilt less than the eyes). A group is a person. Throws InputError, Interrupted.
  void add_pointing(const std::string& folder, double tilt_share, Progress& progress,
                    const std::stop_token& stop);
  // Lines of exact rotations (head::read_pose_lines()). Groups are sevenths of the lines. Throws as
  // add_pointing().
  void add_truth(const std::string& file, Progress& progress, const std::stop_token& stop);
  // Annotated faces, named `name` in messages: the truth is the pose of the annotated points. Groups as of
  // add_truth(). Throws InputError where the set has other points than the landmark model, and as
  // add_pointing().
  void add_annotated(const shape::LandmarkSet& set, const std::string& name, Progress& progress,
                     const std::stop_token& stop);

  // Of the images in which a head was found.
  [[nodiscard]] const std::vector<head_view::ViewSample>& samples() const { return samples_; }
  // What was added: "Pointing'04", the files.
  [[nodiscard]] const std::vector<std::string>& sources() const { return sources_; }

  // Empty where there are no such images.
  struct Scores {
    std::optional<head::PointingScore> pointing;
    std::optional<head::PoseScore> exact;  // of the images in which a head was found
  };
  // Of the poses of the landmarks alone.
  [[nodiscard]] Scores score_landmarks() const;
  // Of the poses that are corrected by a model that was learnt without the group of the image. Throws
  // as head_view::leave_groups_out().
  [[nodiscard]] Scores score_left_out(const head_view::TrainViewOptions& options) const;

 private:
  // An image: what landmarks make of it.
  struct Seen {
    std::optional<head_view::HeadView> view;  // none: no head was found
    head::HeadPose pose;
    head::HeadPose raw;       // before its covariance was calibrated
    Eigen::Matrix2Xd points;  // of the poser
    geometry::Camera camera;
  };
  // The one of an image's faces that is meant, with its pose; null: none.
  using Choice = std::function<const PosedFace*(const std::vector<PosedFace>&, cv::Size)>;

  [[nodiscard]] const head::HeadPoser& poser() const { return tracker_.finder().poser(); }
  [[nodiscard]] Seen see(const std::string& path, const Choice& choice);
  int add(Seen seen, int group, const Eigen::Vector3d& forward, bool asked);
  void add_exact(Seen seen, int group, const std::string& image, const Eigen::Matrix3d& rotation);
  [[nodiscard]] int next_group();
  [[nodiscard]] Scores score(const std::vector<head::HeadPose>& poses) const;

  PoseTracker tracker_;
  head::LandmarkMapping mapping_;
  PoseState state_;
  std::vector<Seen> seen_;
  std::vector<head_view::ViewSample> samples_;  // one of each `seen_`
  std::vector<std::string> sources_;
  std::vector<head::PointingOutcome> pointing_;
  std::vector<int> of_pointing_;  // index into `seen_` of each; -1 where no head was found
  std::vector<std::pair<int, head::PosePair>> exact_;
  int files_ = 0;  // with groups that are parts of them
  int lines_ = 0;  // of the latest one
};

}  // namespace tarsier::face
