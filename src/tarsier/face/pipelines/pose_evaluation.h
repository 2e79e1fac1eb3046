// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/pipelines/pose_tracker.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Evaluates the poses of a PoseTracker on images of known poses:
//
//   const face::PoseTrackerOptions options;
//   face::PoseEvaluator evaluator(face::load_pose_models(ModelStore::find(), options), options);
//   const auto truth = face::head::read_pose_lines("heads/truth.jsonl");
//   NoProgress progress;
//   const auto found = evaluator.poses("heads/truth.jsonl", truth, {}, progress, {});
//   const auto score = face::head::score_poses(face::head::match_poses(found, truth), truth.size());
//   fmt::print("yaw: {:.1f} degrees\n", score.yaw_mae_deg);
namespace tarsier::face {

// Standard deviations of a pose's yaw, pitch and roll, degrees.
[[nodiscard]] Eigen::Vector3d angle_sigmas(const head::HeadPose& pose);

// An image of Pointing'04 and the angles in its name.
struct PointingImage {
  std::string path;
  head::PointingName name;
};
// Images in and below a folder of Pointing'04 with |pan| and |tilt| up to these limits, sorted by
// path. Throws InputError if there are no such images.
[[nodiscard]] std::vector<PointingImage> pointing_images(const std::string& folder,
                                                         double max_pan_deg = 45,
                                                         double max_tilt_deg = 30);
// The first face with a pose whose box centre is inside the annotated head's box
// (head::pointing_box()). Without an annotated box, the centre must be inside the image of `size`
// px. Null if there is none.
[[nodiscard]] const PosedFace* face_in_head_box(const std::vector<PosedFace>& faces,
                                                const std::string& image, cv::Size size);
// Path of the image that a line of ground truth names: relative to the current folder, or else to
// the folder of the file.
[[nodiscard]] std::string resolve_image_path(const std::string& truth, const std::string& image);

struct PoseEvaluationOptions {
  // Occlude each detected face by a part of another image or by one grey level
  // (regression::draw_occlusion()), and find its pose again.
  bool occlude = false;
  std::uint64_t seed = 1;  // of the occlusions
};

// Estimates poses in stills as PoseTracker does, and collects them for the scores of
// head/evaluation.h.
class PoseEvaluator {
 public:
  // Throws as PoseTracker's constructor.
  PoseEvaluator(const PoseModels& models, const PoseTrackerOptions& options);

  // For images of Pointing'04, in their order: the pose of the annotated head, and whether the
  // strict face detector detects a face there. Input of head::score_pointing(). Throws InputError
  // if an image cannot be read, Interrupted.
  [[nodiscard]] std::vector<head::PointingOutcome> pointing(
      const std::vector<PointingImage>& images, Progress& progress, const std::stop_token& stop);

  // For the images named by the lines of the file `path`, in their order: the pose of the first
  // face, empty if no face or no pose was found. Input of head::match_poses(). Throws as
  // pointing().
  [[nodiscard]] std::vector<head::PoseLine> poses(const std::string& path,
                                                  const std::vector<head::PoseLine>& truth,
                                                  const PoseEvaluationOptions& options,
                                                  Progress& progress, const std::stop_token& stop);

  // All results so far as JSON, one line per image: {"image"} and to_json(PoseResult).
  [[nodiscard]] const std::string& lines() const { return lines_; }

 private:
  [[nodiscard]] std::vector<PosedFace> faces_of(const std::string& name, const cv::Mat& image);
  [[nodiscard]] cv::Mat occluded(const cv::Mat& image, const cv::Mat& texture, Rng rng);

  PoseTracker tracker_;
  PoseState state_;
  landmarks::FaceFinder strict_;  // detects faces only
  std::string lines_;
  cv::Mat gray_;
};

}  // namespace tarsier::face
