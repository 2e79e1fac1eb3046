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

// From landmarks to head poses, and back: landmarks are fitted from the mean face seen from the
// front, which pulls turned faces towards the front. So once a pose is known, the fit begins again
// from the head's own points in that pose; what comes out is turned further, as the face is. A
// model of how heads look, where there is one, has the last word on the direction.
namespace tarsier::face {

// Errors of angles whose direction no view model corrected, by what found the points; measured as
// those of head_view::kViewSigma, the factors of appearance models on 161 of the drawn heads.
inline constexpr head::AngleCalibration kLandmarkSigma{{1.9, 7.7}, {2.4, 17.4}, {2.3, 0}};
inline constexpr head::AngleCalibration kAppearanceSigma{{8.1, 10.0}, {5.1, 19.0}, {5.9, 0}};

struct PosedFace {
  landmarks::TrackedFace face;
  // With calibrated deviations of its angles: by one of the above, or head_view::kViewSigma.
  std::optional<head::HeadPose> pose;
  std::string reason;  // where there is none
};

// One face or one still at a time; PoseTracker calls it. Const: any number of threads may use it,
// each with a workspace of its own.
class PoseFinder {
 public:
  // `mapping`: of the head's points to the landmarks. Throws std::invalid_argument where they do
  // not fit together. `view` may be null.
  PoseFinder(std::shared_ptr<const landmarks::LandmarkModel> landmarks,
             const landmarks::FitOptions& fit, const head::HeadModel& head,
             const head::LandmarkMapping& mapping, const head::HeadPoseOptions& options,
             std::shared_ptr<const head_view::ViewModel> view = nullptr);

  [[nodiscard]] const landmarks::LandmarkModel& landmarks() const { return *landmarks_; }
  [[nodiscard]] const landmarks::FitOptions& fit() const { return fit_; }
  [[nodiscard]] const head::HeadPoser& poser() const { return poser_; }

  // The pose of a face whose points were fitted, fitting them again (gray: CV_8UC1, of the camera's
  // size). face.points and face.score become those of the better fit. `identity` may be null; it
  // learns from the face if `learn`. `debug`, which may be null, takes the head of the first pose,
  // the stages of the second fit ("second/start" ..) and the head of the last pose.
  [[nodiscard]] PosedFace pose_of(landmarks::TrackedFace face, const cv::Mat& gray,
                                  const geometry::Camera& camera, head::HeadIdentity* identity,
                                  bool learn, landmarks::FitWorkspace& workspace,
                                  DebugSink* debug = nullptr) const;

  // The pose of a face whose points are taken as they are. The rest as above; `debug` takes the head
  // of the pose.
  [[nodiscard]] PosedFace pose_of_points(landmarks::TrackedFace face, const cv::Mat& gray,
                                         const geometry::Camera& camera,
                                         head::HeadIdentity* identity, bool learn,
                                         DebugSink* debug = nullptr) const;

  // All faces of a still, numbered from 1, in the order of landmarks::find_faces. Faces that only
  // the less strict search saw are kept when their score after the second fit is at least
  // `min_score`.
  [[nodiscard]] std::vector<PosedFace> find(const cv::Mat& gray, const geometry::Camera& camera,
                                            landmarks::FaceFinder& finder,
                                            landmarks::FitWorkspace& workspace,
                                            double min_score = 0.5,
                                            DebugSink* debug = nullptr) const;

 private:
  // `learn`: the identity, which may be null, does.
  [[nodiscard]] head::HeadPoseResult pose(const landmarks::TrackedFace& face,
                                          const geometry::Camera& camera,
                                          head::HeadIdentity* identity, bool learn) const;
  // With the direction that the view model, where there is one, has for it; else its deviations by
  // `errors`.
  [[nodiscard]] PosedFace refined(landmarks::TrackedFace face, head::HeadPoseResult found,
                                  const cv::Mat& gray, const geometry::Camera& camera,
                                  head::HeadIdentity* identity,
                                  const head::AngleCalibration& errors, DebugSink* debug) const;
  // Of the points that the head has; empty where nothing is known.
  [[nodiscard]] Eigen::VectorXd sigmas(const landmarks::TrackedFace& face) const;

  std::shared_ptr<const landmarks::LandmarkModel> landmarks_;
  landmarks::FitOptions fit_;
  std::vector<int> chosen_;  // landmarks, in the order of the poser's points
  bool is_whole_ = false;    // every landmark is a point of the head: the fit can begin again
  head::HeadPoser poser_;
  std::shared_ptr<const head_view::ViewModel> view_;
};

}  // namespace tarsier::face
