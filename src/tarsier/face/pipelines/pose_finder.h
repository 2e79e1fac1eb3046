// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head_view/view_model.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/geometry/camera.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>
#include <string>
#include <vector>

// Converts landmarks to head poses and back. Landmarks are fitted from the mean frontal face, which
// biases turned faces towards the front. Once a pose is known, the fit is therefore repeated from
// the head's own points, projected in that pose. The second pose has less bias. A view model, if
// there is one, finally corrects the direction.
namespace tarsier::face {

// Errors of angles that no view model corrected, by the source of the points. Measured as those of
// head_view::kViewSigma; the factors of appearance models on 161 of the synthetic heads.
inline constexpr head::AngleCalibration kLandmarkSigma{{1.9, 7.7}, {2.4, 17.4}, {2.3, 0}};
inline constexpr head::AngleCalibration kAppearanceSigma{{8.1, 10.0}, {5.1, 19.0}, {5.9, 0}};

struct PosedFace {
  landmarks::TrackedFace face;
  // The deviations of its angles are calibrated, by one of the above or by head_view::kViewSigma.
  std::optional<head::HeadPose> pose;
  std::string reason;  // why there is no pose
};

// Handles one face or one still at a time; called by PoseTracker. Const and thread-safe; each
// thread needs its own workspace.
class PoseFinder {
 public:
  // `mapping`: from the head's points to the landmarks. Throws std::invalid_argument if the models
  // do not fit together. `view` may be null.
  PoseFinder(std::shared_ptr<const landmarks::LandmarkModel> landmarks,
             const landmarks::FitOptions& fit, const head::HeadModel& head,
             const head::LandmarkMapping& mapping, const head::HeadPoseOptions& options,
             std::shared_ptr<const head_view::ViewModel> view = nullptr);

  [[nodiscard]] const landmarks::LandmarkModel& landmarks() const { return *landmarks_; }
  [[nodiscard]] const landmarks::FitOptions& fit() const { return fit_; }
  [[nodiscard]] const head::HeadPoseEstimator& estimator() const { return estimator_; }

  // The pose of a face whose points are fitted; fits the points a second time (gray: CV_8UC1, of
  // the camera's size). face.points and face.score are replaced by those of the second fit unless
  // it is much worse. `identity` may be null; it learns from the face if `learn`. `debug`, which
  // may be null, receives the head in the first pose, the stages of the second fit ("second/start"
  // ..) and the head in the final pose.
  [[nodiscard]] PosedFace pose_of(landmarks::TrackedFace face, const cv::Mat& gray,
                                  const geometry::Camera& camera, head::HeadIdentity* identity,
                                  bool learn, landmarks::FitWorkspace& workspace,
                                  DebugSink* debug = nullptr) const;

  // The pose of a face whose points are used as they are. Otherwise as above; `debug` receives the
  // head in its pose.
  [[nodiscard]] PosedFace pose_of_points(landmarks::TrackedFace face, const cv::Mat& gray,
                                         const geometry::Camera& camera,
                                         head::HeadIdentity* identity, bool learn,
                                         DebugSink* debug = nullptr) const;

  // All faces of a still, numbered from 1, in the order of landmarks::find_faces. A face is kept
  // only if its score is at least `min_score`. The score of the second fit counts only if the
  // detection and the first fit scored well.
  [[nodiscard]] std::vector<PosedFace> find(const cv::Mat& gray, const geometry::Camera& camera,
                                            landmarks::FaceFinder& finder,
                                            landmarks::FitWorkspace& workspace,
                                            double min_score = 0.5,
                                            DebugSink* debug = nullptr) const;

 private:
  // `learn`: update `identity`, which may be null.
  [[nodiscard]] head::HeadPoseResult pose(const landmarks::TrackedFace& face,
                                          const geometry::Camera& camera,
                                          head::HeadIdentity* identity, bool learn) const;
  // Corrects the direction by the view model. Without a view model, calibrates the deviations by
  // `errors`.
  [[nodiscard]] PosedFace refined(landmarks::TrackedFace face, head::HeadPoseResult found,
                                  const cv::Mat& gray, const geometry::Camera& camera,
                                  head::HeadIdentity* identity,
                                  const head::AngleCalibration& errors, DebugSink* debug) const;
  // Of the points that the head has; empty if unknown.
  [[nodiscard]] Eigen::VectorXd sigmas(const landmarks::TrackedFace& face) const;

  std::shared_ptr<const landmarks::LandmarkModel> landmarks_;
  landmarks::FitOptions fit_;
  std::vector<int> chosen_;  // landmark of each of the estimator's points
  bool is_whole_ = false;    // every landmark is a point of the head, so the fit can be repeated
  head::HeadPoseEstimator estimator_;
  std::shared_ptr<const head_view::ViewModel> view_;
};

}  // namespace tarsier::face
