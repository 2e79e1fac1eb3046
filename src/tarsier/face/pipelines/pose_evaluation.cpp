// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/pose_evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/occlusion.h"
#include "tarsier/media/image_file.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::face {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> images_below(const std::string& folder) {
  std::error_code error;
  if (!fs::is_directory(folder, error)) throw InputError(folder, "no such folder");
  std::vector<std::string> paths;
  for (const auto& entry :
       fs::recursive_directory_iterator(folder, fs::directory_options::skip_permission_denied)) {
    if (entry.is_regular_file() && is_image_path(entry.path().string()))
      paths.push_back(entry.path().string());
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

cv::Point2d middle_of(const cv::Rect2d& box) { return (box.tl() + box.br()) / 2; }

cv::Rect2d head_box_of(const std::string& image, cv::Size size) {
  return head::pointing_box(image).value_or(cv::Rect2d(0, 0, size.width, size.height));
}

}  // namespace

Eigen::Vector3d angle_sigmas(const head::HeadPose& pose) {
  return {pose.yaw_sigma_deg, pose.pitch_sigma_deg, pose.roll_sigma_deg};
}

std::vector<PointingImage> pointing_images(const std::string& folder, double max_pan_deg,
                                           double max_tilt_deg) {
  std::vector<PointingImage> images;
  for (const std::string& path : images_below(folder)) {
    const auto name = head::parse_pointing_name(path);
    if (name && std::abs(name->pan_deg) <= max_pan_deg && std::abs(name->tilt_deg) <= max_tilt_deg)
      images.push_back({path, *name});
  }
  if (images.empty()) throw InputError(folder, "has no image named as in Pointing'04");
  return images;
}

const PosedFace* face_in_head_box(const std::vector<PosedFace>& faces, const std::string& image,
                                  cv::Size size) {
  const cv::Rect2d head_box = head_box_of(image, size);
  for (const PosedFace& face : faces)
    if (face.pose && head_box.contains(middle_of(face.face.box))) return &face;
  return nullptr;
}

std::string resolve_image_path(const std::string& truth, const std::string& image) {
  std::error_code error;
  if (fs::exists(image, error)) return image;
  return (fs::path(truth).parent_path() / image).string();
}

PoseEvaluator::PoseEvaluator(const PoseModels& models, const PoseTrackerOptions& options)
    : tracker_(models, options), strict_(tracker_.landmarks().detector().make_finder()) {}

std::vector<PosedFace> PoseEvaluator::faces_of(const std::string& name, const cv::Mat& image) {
  Frame frame;
  frame.image = image;
  frame.name = name;
  frame.still = true;
  PoseResult result = tracker_.process(frame, state_);
  nlohmann::ordered_json line{{"image", name}};
  line.update(to_json(result));
  lines_ += line.dump() + "\n";
  return std::move(result.faces);
}

// Works on grey levels.
cv::Mat PoseEvaluator::occluded(const cv::Mat& image, const cv::Mat& texture, Rng rng) {
  Frame frame;
  frame.image = gray_of(image, gray_).clone();
  frame.still = true;
  cv::Mat result = frame.image.clone();
  for (const PosedFace& face : tracker_.process(frame, state_).faces)
    (void)regression::draw_occlusion(result, face.face.points, texture, rng);
  return result;
}

std::vector<head::PointingOutcome> PoseEvaluator::pointing(const std::vector<PointingImage>& images,
                                                           Progress& progress,
                                                           const std::stop_token& stop) {
  std::vector<head::PointingOutcome> outcomes;
  progress.begin("poses", static_cast<std::int64_t>(images.size()), "images");
  for (const auto& [path, name] : images) {
    throw_if_stopped(stop);
    progress.advance();
    head::PointingOutcome outcome;
    outcome.image = path;
    outcome.truth = name;
    const cv::Mat image = read_image(path);
    const std::vector<PosedFace> faces = faces_of(path, image);
    if (const PosedFace* face = face_in_head_box(faces, path, image.size())) {
      outcome.rotation = face->pose->camera_from_head.rotation;
      outcome.sigma_deg = angle_sigmas(*face->pose);
    }
    const cv::Rect2d head_box = head_box_of(path, image.size());
    for (const landmarks::Candidate& candidate : strict_.find_confident(gray_of(image, gray_)))
      outcome.face_detected = outcome.face_detected || head_box.contains(middle_of(candidate.box));
    outcomes.push_back(std::move(outcome));
  }
  progress.end();
  return outcomes;
}

std::vector<head::PoseLine> PoseEvaluator::poses(const std::string& path,
                                                 const std::vector<head::PoseLine>& truth,
                                                 const PoseEvaluationOptions& options,
                                                 Progress& progress, const std::stop_token& stop) {
  std::vector<head::PoseLine> found;
  const Rng root(options.seed);
  progress.begin("poses", static_cast<std::int64_t>(truth.size()), "images");
  for (std::size_t i = 0; i < truth.size(); ++i) {
    throw_if_stopped(stop);
    progress.advance();
    cv::Mat image = read_image(resolve_image_path(path, truth[i].image));
    if (options.occlude) {
      const std::string& other = truth[(i + truth.size() / 2) % truth.size()].image;
      image = occluded(image, read_gray_image(resolve_image_path(path, other)), root.fork(i));
    }
    const std::vector<PosedFace> faces = faces_of(truth[i].image, image);
    head::PoseLine line;
    line.image = truth[i].image;
    if (const auto pose = faces.empty() ? std::nullopt : faces.front().pose) {
      line.rotation = pose->camera_from_head.rotation;
      line.translation = pose->camera_from_head.translation;
      line.sigma_deg = angle_sigmas(*pose);
      line.sigma_floor_deg = pose->sigma_floor_deg;
    }
    found.push_back(std::move(line));
  }
  progress.end();
  return found;
}

}  // namespace tarsier::face
