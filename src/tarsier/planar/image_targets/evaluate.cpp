// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/evaluate.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rounding.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

namespace tarsier::planar::image_targets {
namespace {

using nlohmann::json;

std::vector<double> numbers(const json& object, const char* name, const std::string& path,
                            std::size_t min_count, std::size_t max_count) {
  const json& list = member(object, name, path);
  std::vector<double> out;
  if (list.is_array() && list.size() >= min_count && list.size() <= max_count) {
    for (const json& v : list)
      if (v.is_number() && std::isfinite(v.get<double>())) out.push_back(v.get<double>());
    if (out.size() == list.size()) return out;
  }
  throw InputError(
      path, fmt::format("'{}': expected a list of {} to {} numbers", name, min_count, max_count));
}

geometry::Camera camera_of(const json& line, const std::string& path) {
  const std::vector<double> k = numbers(line, "K", path, 9, 9);
  geometry::Camera camera;
  camera.fx = k[0];
  camera.fy = k[4];
  camera.cx = k[2];
  camera.cy = k[5];
  if (line.contains("dist")) {
    const std::vector<double> d = numbers(line, "dist", path, 0, 8);
    std::copy(d.begin(), d.end(), camera.distortion.begin());
    if (d.size() > 5) camera.lens = geometry::Lens::kRational;
  }
  if (!(camera.fx > 0 && camera.fy > 0)) throw InputError(path, "'K' has no focal length");
  return camera;
}

}  // namespace

nlohmann::ordered_json target_json(const Target& target, std::size_t id,
                                   const cv::Matx33d& homography,
                                   const std::array<cv::Point2d, 4>& corners, double confidence,
                                   const geometry::PlanarPose* pose) {
  nlohmann::ordered_json out;
  out["id"] = id;
  out["name"] = target.name;
  auto& list = out["corners"] = nlohmann::ordered_json::array();
  for (const cv::Point2d& c : corners)
    list.push_back({rounded_to_steps(c.x, 1e4), rounded_to_steps(c.y, 1e4)});
  const cv::Matx33d h = target.from_original_image(homography);
  out["homography"] = std::vector<double>(h.val, h.val + 9);
  out["confidence"] = rounded_to_steps(confidence, 1e3);
  if (pose != nullptr) {
    const Eigen::Vector3d turn = geometry::rotation_vector(pose->camera_from_plane.rotation);
    const Eigen::Vector3d& t = pose->camera_from_plane.translation;
    out["rvec"] = {turn[0], turn[1], turn[2]};
    out["tvec"] = {t[0], t[1], t[2]};
    out["rms_px"] = rounded_to_steps(pose->rms_px, 1e4);
  }
  return out;
}

void evaluate_planar(const std::string& truth_path, const PlanarOptions& options,
                     const std::function<void(const PlanarResult&)>& each,
                     const std::stop_token& stop) {
  std::istringstream file(read_file(truth_path, 64'000'000));
  const std::filesystem::path folder = std::filesystem::path(truth_path).parent_path();
  std::map<std::pair<std::string, double>, std::vector<Target>> trained;
  std::string text;
  for (int number = 1; std::getline(file, text); ++number) {
    if (text.find_first_not_of(" \t\r") == std::string::npos) continue;
    if (stop.stop_requested()) throw Interrupted();
    const std::string where = fmt::format("{}:{}", truth_path, number);
    const json line = parse_json(text, where);
    PlanarResult result;
    geometry::Camera camera;
    std::string name;
    double size = 0;
    try {
      result.image = text_member(line, "image", where);
      name = text_member(line, "target", where);
      size = number_member(line, "size", where, 1e-4, 100);
      camera = camera_of(line, where);
    } catch (const ModelError& error) {  // here the truth is an input, not a model
      throw InputError(where, std::string(error.what()).substr(where.size() + 2));
    }
    auto& targets = trained[{name, size}];
    if (targets.empty()) {
      TrainOptions train = options.train;
      train.width = size;
      targets.push_back(train_target(read_image((folder / name).string()), name, train, stop));
    }
    const cv::Mat image = read_image((folder / result.image).string());
    camera.width = image.cols;
    camera.height = image.rows;
    const auto start = std::chrono::steady_clock::now();
    result.found = detect_targets(targets, image, options.detect, &camera);
    result.ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count();
    result.markers = nlohmann::ordered_json::array();
    for (const DetectedTarget& f : result.found)
      result.markers.push_back(target_json(targets[0], 0, f.homography, f.corners, f.confidence,
                                           f.poses ? &f.poses->best : nullptr));
    each(result);
  }
}

}  // namespace tarsier::planar::image_targets
