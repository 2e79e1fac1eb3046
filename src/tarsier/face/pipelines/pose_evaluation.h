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

// How good the poses of a PoseTracker are, on images of known poses:
//
//   const face::PoseTrackerOptions options;
//   face::PoseEvaluator evaluator(face::load_pose_models(ModelStore::find(), options), options);
//   const auto truth = face::head::read_pose_lines("heads/truth.jsonl");
//   NoProgress progress;
//   const auto found = evaluator.poses("heads/truth.jsonl", truth, {}, progress, {});
//   const auto score = face::head::score_poses(face::head::match_poses(found, truth), truth.size());
//   fmt::print("yaw: {:.1f} degrees\n", score.yaw_mae_deg);
namespace tarsier::face {

// The standard deviations of a pose's yaw, pitch and roll, degrees.
[[nodiscard]] Eigen::Vector3d angle_sigmas(const head::HeadPose& pose);

// An image of Pointing'04 and the angles of its name.
struct PointingImage {
  std::string path;
  head::PointingName name;
};
// Images in and below a folder of Pointing'04 with |pan| and |tilt| up to these limits, sorted by
// path. Throws InputError for a folder without such images.
[[nodiscard]] std::vector<PointingImage> pointing_images(const std::string& folder,
                                                         double max_pan_deg = 45,
                                                         double max_tilt_deg = 30);
// The first face with a pose whose box has its middle inside the annotated head's box (head::pointing_box();
// without one, inside the image, of `size` px); null: none.
[[nodiscard]] const PosedFace* face_in_head_box(const std::vector<PosedFace>& faces,
                                                const std::string& image, cv::Size size);
// The image of a line of truth: from the current folder, or from that of the file.
[[nodiscard]] std::string image_of_truth(const std::string& truth, const std::string& image);

struct PoseEvaluationOptions {
  // Draw something before each face that is found, and look again: a part of another image, or one
  // tone (landmarks::draw_occlusion()).
  bool occlude = false;
  std::uint64_t seed = 1;  // of what is drawn
};

// Finds poses as PoseTracker does in stills, and gathers them for the scores of head/evaluation.h.
class PoseEvaluator {
 public:
  // Throws as PoseTracker's constructor.
  PoseEvaluator(const PoseModels& models, const PoseTrackerOptions& options);

  // Of images of Pointing'04, in their order: the pose of the head that is annotated, and whether the
  // strict face detector sees a face there. For head::score_pointing(). Throws InputError for an
  // image that cannot be read, Interrupted.
  [[nodiscard]] std::vector<head::PointingOutcome> pointing(
      const std::vector<PointingImage>& images, Progress& progress, const std::stop_token& stop);

  // Of the images that the lines of the file `path` name, in their order: the pose of the first face;
  // none where no face or no pose was found. For head::match_poses(). Throws as pointing().
  [[nodiscard]] std::vector<head::PoseLine> poses(const std::string& path,
                                                  const std::vector<head::PoseLine>& truth,
                                                  const PoseEvaluationOptions& options,
                                                  Progress& progress, const std::stop_token& stop);

  // All that was found so far, a line of JSON an image: {"image"} and to_json(PoseResult).
  [[nodiscard]] const std::string& lines() const { return lines_; }

 private:
  [[nodiscard]] std::vector<PosedFace> faces_of(const std::string& name, const cv::Mat& image);
  [[nodiscard]] cv::Mat occluded(const cv::Mat& image, const cv::Mat& texture, Rng rng);

  PoseTracker tracker_;
  PoseState state_;
  landmarks::FaceFinder strict_;  // faces alone
  std::string lines_;
  cv::Mat gray_;
};

}  // namespace tarsier::face
