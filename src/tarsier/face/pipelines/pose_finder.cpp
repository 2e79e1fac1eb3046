// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/pose_finder.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <utility>

namespace tarsier::face {
namespace {

// A second fit that is worth this much less than the first went astray.
constexpr double kMuchWorse = 0.1;
// Below this quality no second fit helps: the candidate is not a face.
constexpr double kHopeless = 0.15;

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

}  // namespace

PoseFinder::PoseFinder(std::shared_ptr<const landmarks::LandmarkModel> landmarks,
                       const landmarks::FitOptions& fit, const head::HeadModel& head,
                       const head::LandmarkMapping& mapping, const head::HeadPoseOptions& options,
                       std::shared_ptr<const head_view::ViewModel> view)
    : landmarks_(std::move(landmarks)),
      fit_((fit.check(), fit)),
      chosen_(mapping.landmarks),
      poser_(chosen_points(head, mapping, landmarks_->points()), options),
      view_(std::move(view)) {
  std::vector<int> sorted = chosen_;
  std::sort(sorted.begin(), sorted.end());
  sorted.erase(std::unique(sorted.begin(), sorted.end()), sorted.end());
  is_whole_ = static_cast<int>(sorted.size()) == landmarks_->points();
}

PosedFace PoseFinder::pose_of(landmarks::TrackedFace face, const cv::Mat& gray,
                              const geometry::Camera& camera, head::HeadIdentity* identity,
                              bool learn, landmarks::FitWorkspace& workspace) const {
  const auto pose = [&](const Eigen::Matrix2Xd& points, bool keep) {
    if (identity == nullptr) return poser_.pose(points(Eigen::all, chosen_), camera);
    if (keep) return poser_.pose(points(Eigen::all, chosen_), camera, *identity);
    head::HeadIdentity known = *identity;
    return poser_.pose(points(Eigen::all, chosen_), camera, known);
  };
  head::HeadPoseResult found = pose(face.points, learn && !is_whole_);
  if (is_whole_ && found.pose) {
    const Eigen::Matrix2Xd projected = poser_.project(*found.pose, camera);
    Eigen::Matrix2Xd start(2, face.points.cols());
    for (std::size_t i = 0; i < chosen_.size(); ++i) {
      start.col(chosen_[i]) = projected.col(static_cast<Eigen::Index>(i));
    }
    if (start.allFinite()) {
      landmarks::Fit again = landmarks::fit_points(*landmarks_, fit_, gray, start, workspace);
      if (again.score >= face.score - kMuchWorse) {
        face.points = std::move(again.points);
        face.score = again.score;
      }
    }
    head::HeadPoseResult better = pose(face.points, learn);
    if (better.pose) found = std::move(better);
  }
  if (view_ != nullptr && found.pose) {
    if (auto refined = head_view::refined_pose(*view_, poser_, face.points(Eigen::all, chosen_),
                                               gray, camera, *found.pose, identity)) {
      found.pose = std::move(refined);
    }
  }
  PosedFace result;
  result.face = std::move(face);
  result.pose = std::move(found.pose);
  result.reason = std::move(found.reason);
  return result;
}

std::vector<PosedFace> PoseFinder::find(const cv::Mat& gray, const geometry::Camera& camera,
                                        landmarks::FaceFinder& finder,
                                        landmarks::FitWorkspace& workspace,
                                        double min_score) const {
  std::vector<PosedFace> faces;
  for (landmarks::FoundFace& found :
       landmarks::find_faces(*landmarks_, fit_, gray, finder, workspace, kHopeless)) {
    const double first = found.fit.score;
    PosedFace face = pose_of({0, std::move(found.fit.points), first, found.box}, gray, camera,
                             nullptr, false, workspace);
    if (landmarks_->quality && std::max(first, face.face.score) < min_score) continue;
    face.face.id = static_cast<int>(faces.size()) + 1;
    faces.push_back(std::move(face));
  }
  return faces;
}

}  // namespace tarsier::face
