// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/pose_finder.h"

#include "tarsier/core/require.h"
#include "tarsier/face/head/draw_pose.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <string>
#include <string_view>
#include <utility>

namespace tarsier::face {
namespace {

// The second fit has failed if its score is lower than the first one's by more than this.
constexpr double kMaxScoreDrop = 0.1;
// Below this quality the candidate is not a face, and a second fit does not help.
constexpr double kMinFaceScore = 0.15;
// Min scores of detection and first fit for which the second fit's score counts.
constexpr double kMinDetection = 0.6;
constexpr double kMinFirstFit = 0.35;

head::HeadModel chosen_points(const head::HeadModel& model, const head::LandmarkMapping& mapping,
                              int landmarks) {
  TARSIER_REQUIRE(mapping.model_points.size() == mapping.landmarks.size(),
                  "a mapping of {} points to {} landmarks", mapping.model_points.size(),
                  mapping.landmarks.size());
  for (const int landmark : mapping.landmarks) {
    TARSIER_REQUIRE(landmark >= 0 && landmark < landmarks,
                    "the head needs landmark {}, the landmark model has {}: give a mapping",
                    landmark, landmarks);
  }
  bool is_whole = static_cast<int>(mapping.model_points.size()) == model.points();
  for (std::size_t i = 0; is_whole && i < mapping.model_points.size(); ++i) {
    is_whole = mapping.model_points[i] == static_cast<int>(i);
  }
  return is_whole ? model : head::select_points(model, mapping.model_points);
}

// Sink for the stages of the second fit, which has stages of the same names as the first.
class SecondFit final : public DebugSink {
 public:
  explicit SecondFit(DebugSink* next) : next_(next) {}
  [[nodiscard]] DebugSink* sink() { return next_ == nullptr ? nullptr : this; }
  void image(std::string_view name, const cv::Mat& image) override {
    next_->image("second/" + std::string(name), image);
  }

 private:
  DebugSink* next_;
};

// Shows the head in its pose on the enlarged part of the image around the face.
void show_pose(DebugSink* debug, std::string_view name, const cv::Mat& gray,
               const Eigen::Matrix2Xd& points, const geometry::Camera& camera,
               const head::HeadModel& model, const head::HeadPose& pose) {
  if (debug == nullptr || !points.allFinite()) return;
  constexpr double kSide = 480;    // px of the output
  constexpr double kMargin = 0.5;  // share of the points' extent added on each side
  const Eigen::Vector2d low = points.rowwise().minCoeff();
  const Eigen::Vector2d high = points.rowwise().maxCoeff();
  const double extent = std::max(4.0, (high - low).maxCoeff()) * (1 + 2 * kMargin);
  const Eigen::Vector2d corner = (low + high) / 2 - Eigen::Vector2d::Constant(extent / 2);
  const double scale = kSide / extent;
  cv::Mat shown;
  cv::warpAffine(gray, shown,
                 cv::Matx23d(scale, 0, -scale * corner.x(), 0, scale, -scale * corner.y()),
                 cv::Size(cvRound(kSide), cvRound(kSide)));
  cv::cvtColor(shown, shown, cv::COLOR_GRAY2BGR);
  geometry::Camera part = camera;  // camera of this part of the image, at this scale
  part.width = shown.cols;
  part.height = shown.rows;
  part.fx *= scale;
  part.fy *= scale;
  part.cx = scale * (camera.cx - corner.x());
  part.cy = scale * (camera.cy - corner.y());
  head::draw_head(shown, part, pose.camera_from_head, model, head::shape_of(model, pose.b));
  head::draw_axes(shown, part, pose.camera_from_head, {60, 60, -100});
  debug->image(name, shown);
}

}  // namespace

PoseFinder::PoseFinder(std::shared_ptr<const landmarks::LandmarkModel> landmarks,
                       const landmarks::FitOptions& fit, const head::HeadModel& head,
                       const head::LandmarkMapping& mapping, const head::HeadPoseOptions& options,
                       std::shared_ptr<const head_view::ViewModel> view)
    : landmarks_(std::move(landmarks)),
      fit_((fit.check(), fit)),
      chosen_(mapping.landmarks),
      estimator_(chosen_points(head, mapping, landmarks_->points()), options),
      view_(std::move(view)) {
  std::vector<int> sorted = chosen_;
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  is_whole_ = static_cast<int>(sorted.size()) == landmarks_->points();
  TARSIER_REQUIRE(
      view_ == nullptr || view_->landmarks() == static_cast<int>(estimator_.model().mirror.size()),
      "a view model of {} landmarks, the head has {}", view_->landmarks(),
      estimator_.model().mirror.size());
}

Eigen::VectorXd PoseFinder::sigmas(const landmarks::TrackedFace& face) const {
  if (face.visibility.sigma_px.size() == 0) return {};
  return face.visibility.sigma_px(chosen_);
}

head::HeadPoseResult PoseFinder::pose(const landmarks::TrackedFace& face,
                                      const geometry::Camera& camera, head::HeadIdentity* identity,
                                      bool learn) const {
  const Eigen::Matrix2Xd points = face.points(Eigen::all, chosen_);
  if (identity == nullptr) return estimator_.pose(points, camera, sigmas(face));
  if (learn) return estimator_.pose(points, camera, *identity, sigmas(face));
  head::HeadIdentity known = *identity;
  return estimator_.pose(points, camera, known, sigmas(face));
}

PosedFace PoseFinder::refined(landmarks::TrackedFace face, head::HeadPoseResult found,
                              const cv::Mat& gray, const geometry::Camera& camera,
                              head::HeadIdentity* identity, const head::AngleCalibration& errors,
                              DebugSink* debug) const {
  if (found.pose) {
    std::optional<head::HeadPose> corrected;
    if (view_ != nullptr)
      corrected = head_view::refined_pose(*view_, estimator_, face.points(Eigen::all, chosen_),
                                          gray, camera, *found.pose, identity, sigmas(face));
    if (corrected) {
      found.pose = std::move(corrected);
    } else {
      head::calibrate_sigmas(*found.pose, errors);
    }
  }
  if (found.pose)
    show_pose(debug, "pose", gray, face.points, camera, estimator_.model(), *found.pose);
  return {std::move(face), std::move(found.pose), std::move(found.reason)};
}

PosedFace PoseFinder::pose_of_points(landmarks::TrackedFace face, const cv::Mat& gray,
                                     const geometry::Camera& camera, head::HeadIdentity* identity,
                                     bool learn, DebugSink* debug) const {
  head::HeadPoseResult found = pose(face, camera, identity, learn);
  return refined(std::move(face), std::move(found), gray, camera, identity, kAppearanceSigma,
                 debug);
}

PosedFace PoseFinder::pose_of(landmarks::TrackedFace face, const cv::Mat& gray,
                              const geometry::Camera& camera, head::HeadIdentity* identity,
                              bool learn, landmarks::FitWorkspace& workspace,
                              DebugSink* debug) const {
  head::HeadPoseResult found = pose(face, camera, identity, learn && !is_whole_);
  if (is_whole_ && found.pose) {
    show_pose(debug, "first pose", gray, face.points, camera, estimator_.model(), *found.pose);
    SecondFit second(debug);
    const Eigen::Matrix2Xd projected = estimator_.project(*found.pose, camera);
    Eigen::Matrix2Xd start(2, face.points.cols());
    for (std::size_t i = 0; i < chosen_.size(); ++i) {
      start.col(chosen_[i]) = projected.col(static_cast<Eigen::Index>(i));
    }
    if (start.allFinite()) {
      landmarks::Fit again =
          landmarks::fit_points(*landmarks_, fit_, gray, start, workspace, second.sink());
      if (again.score >= face.score - kMaxScoreDrop) {
        face.points = std::move(again.points);
        face.score = again.score;
        face.visibility = std::move(again.visibility);
      }
    }
    head::HeadPoseResult better = pose(face, camera, identity, learn);
    if (better.pose) found = std::move(better);
  }
  return refined(std::move(face), std::move(found), gray, camera, identity, kLandmarkSigma, debug);
}

std::vector<PosedFace> PoseFinder::find(const cv::Mat& gray, const geometry::Camera& camera,
                                        landmarks::FaceFinder& finder,
                                        landmarks::FitWorkspace& workspace, double min_score,
                                        DebugSink* debug) const {
  std::vector<PosedFace> faces;
  for (landmarks::FittedFace& found :
       landmarks::find_faces(*landmarks_, fit_, gray, finder, workspace, kMinFaceScore, debug)) {
    const double first = found.fit.score;
    landmarks::TrackedFace start;
    start.points = std::move(found.fit.points);
    start.score = first;
    start.box = found.box;
    start.visibility = std::move(found.fit.visibility);
    PosedFace face = pose_of(std::move(start), gray, camera, nullptr, false, workspace, debug);
    // Without a face, one of several fits can score well by chance.
    const bool second_counts = found.detection >= kMinDetection && first >= kMinFirstFit;
    const double score = second_counts ? std::max(first, face.face.score) : first;
    if (landmarks_->quality && score < min_score) continue;
    face.face.id = static_cast<int>(faces.size()) + 1;
    faces.push_back(std::move(face));
  }
  return faces;
}

}  // namespace tarsier::face
