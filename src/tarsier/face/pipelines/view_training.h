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

// Collects images of heads of known poses for head_view::train_view_model(), and evaluates the
// model on held-out people:
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
  // Poses are computed from the landmarks alone, with a guessed camera. Throws
  // std::invalid_argument for options with `refine` or a camera, otherwise as PoseTracker's
  // constructor.
  ViewTraining(const PoseModels& models, const PoseTrackerOptions& options);

  // Adds images of Pointing'04. Angles beyond the scored range are included, so that corrections
  // near its limits are interpolated. The ground truth is where the person was asked to look, in
  // the camera's frame: the marks are far from the head, so their directions do not change when the
  // head moves. The tilt is multiplied by `tilt_share` (0.1..1.5), because heads tilt less than the
  // eyes. Each person is a group. Throws InputError, Interrupted.
  void add_pointing(const std::string& folder, double tilt_share, Progress& progress,
                    const std::stop_token& stop);
  // Adds lines with exact rotations (head::read_pose_lines()). Each seventh of the lines is a
  // group. Throws as add_pointing().
  void add_truth(const std::string& file, Progress& progress, const std::stop_token& stop);
  // Adds annotated faces, called `name` in messages. The ground truth is the pose of the annotated
  // points. Groups as in add_truth(). Throws InputError if the set has other points than the
  // landmark model, otherwise as add_pointing().
  void add_annotated(const shape::LandmarkSet& set, const std::string& name, Progress& progress,
                     const std::stop_token& stop);

  // One sample for each image in which a head was found.
  [[nodiscard]] const std::vector<head_view::ViewSample>& samples() const { return samples_; }
  // What was added: "Pointing'04", and the names of the files.
  [[nodiscard]] const std::vector<std::string>& sources() const { return sources_; }

  // Empty if there are no images of that kind.
  struct Scores {
    std::optional<head::PointingScore> pointing;
    std::optional<head::PoseScore> exact;  // of the images in which a head was found
  };
  // Scores of the poses from landmarks alone.
  [[nodiscard]] Scores score_landmarks() const;
  // Scores of poses corrected by a model that was trained without the image's group. Throws as
  // head_view::leave_groups_out().
  [[nodiscard]] Scores score_held_out(const head_view::TrainViewOptions& options) const;

 private:
  // The result for one image from its landmarks.
  struct Seen {
    std::optional<head_view::HeadView> view;  // empty: no head was found
    head::HeadPose pose;
    head::HeadPose raw;       // before its covariance was calibrated
    Eigen::Matrix2Xd points;  // those that the estimator uses
    geometry::Camera camera;
  };
  // Selects the annotated face among the faces of an image, with its pose; null: none.
  using Choice = std::function<const PosedFace*(const std::vector<PosedFace>&, cv::Size)>;

  [[nodiscard]] const head::HeadPoseEstimator& estimator() const {
    return tracker_.finder().estimator();
  }
  [[nodiscard]] Seen see(const std::string& path, const Choice& choice);
  int add(Seen seen, int group, const Eigen::Vector3d& forward, bool nominal);
  void add_exact(Seen seen, int group, const std::string& image, const Eigen::Matrix3d& rotation);
  [[nodiscard]] int next_group();
  [[nodiscard]] Scores score(const std::vector<head::HeadPose>& poses) const;

  PoseTracker tracker_;
  head::LandmarkMapping mapping_;
  PoseState state_;
  std::vector<Seen> seen_;
  std::vector<head_view::ViewSample> samples_;  // one for each of `seen_`
  std::vector<std::string> sources_;
  std::vector<head::PointingOutcome> pointing_;
  std::vector<int> pointing_index_;  // index into `seen_`; -1: no head was found
  std::vector<std::pair<int, head::PosePair>> exact_;
  int files_ = 0;  // files whose groups are parts of them
  int lines_ = 0;  // lines of the latest of these files
};

}  // namespace tarsier::face
