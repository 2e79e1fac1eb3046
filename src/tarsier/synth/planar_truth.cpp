// SPDX-License-Identifier: MIT
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/synth/planar_worlds.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::synth {
namespace {

using Json = nlohmann::ordered_json;

// From the image's pixels (centres at integers) to the frame's; for a camera without distortion.
Eigen::Matrix3d homography_of(const PlanarPrint& print, const PrintTruth& truth,
                              const geometry::Camera& camera) {
  const cv::Rect2d part =
      print.part.empty() ? cv::Rect2d(0, 0, print.image.cols, print.image.rows) : print.part;
  const double scale = truth.width / part.width;  // m per px
  const Eigen::Matrix3d plane_from_pixel{{scale, 0, scale * (0.5 - part.x - 0.5 * part.width)},
                                         {0, -scale, -scale * (0.5 - part.y - 0.5 * part.height)},
                                         {0, 0, 1}};
  Eigen::Matrix3d ray_from_plane = truth.camera_from_print.rotation;
  ray_from_plane.col(2) = truth.camera_from_print.translation;
  const Eigen::Matrix3d h = geometry::to_eigen(camera.matrix()) * ray_from_plane * plane_from_pixel;
  return h * (1 / h(2, 2));
}

Json marker_json(const PrintTruth& truth) {
  Json marker{{"id", truth.id}};
  marker["corners"] = Json::array();
  for (const cv::Point2d& p : truth.corners) marker["corners"].push_back({p.x, p.y});
  const Eigen::Vector3d r = rotation_vector(truth.camera_from_print.rotation);
  const Eigen::Vector3d& t = truth.camera_from_print.translation;
  marker["rvec"] = {r[0], r[1], r[2]};
  marker["tvec"] = {t[0], t[1], t[2]};
  marker["side_px"] = truth.side_px;
  marker["visible"] = truth.visible;
  return marker;
}

}  // namespace

std::string truth_list(const std::vector<PrintTruth>& truth) {
  Json list = Json::array();
  for (const PrintTruth& print : truth) list.push_back(marker_json(print));
  return list.dump();
}

std::string truth_line(const TruthLine& line, const PlanarStill& still,
                       const std::vector<PlanarPrint>& prints) {
  Json json{{"image", line.image}};
  if (!line.targets) json["family"] = line.family;
  if (line.targets && !still.truth.empty()) json["target"] = still.truth.front().name;
  const cv::Matx33d k = still.camera.matrix();
  json["K"] = std::vector<double>(k.val, k.val + 9);
  json["dist"] =
      std::vector<double>(still.camera.distortion.begin(), still.camera.distortion.begin() + 5);
  json["size"] = still.truth.empty() ? 0.0 : still.truth.front().width;
  json["level"] = name_of(still.level);
  const ImagingConditions& imaging = still.imaging;
  json["params"] = Json{
      {"gain", imaging.gain},         {"grad", imaging.slope},      {"ga", imaging.slope_angle},
      {"vignette", imaging.vignette}, {"shadow", imaging.shadow},   {"sa", imaging.shadow_angle},
      {"so", imaging.shadow_offset},  {"sw", imaging.shadow_width}, {"offset", imaging.haze},
      {"blur", imaging.defocus_px},   {"motion", still.motion_px},  {"ma", still.motion_angle},
      {"noise", imaging.noise}};
  json["markers"] = Json::array();
  for (const PrintTruth& truth : still.truth) {
    Json marker = marker_json(truth);
    if (line.targets) {
      const auto print = std::find_if(prints.begin(), prints.end(),
                                      [&](const PlanarPrint& p) { return p.id == truth.id; });
      if (print != prints.end()) {
        marker["H"] = geometry::row_major(homography_of(*print, truth, still.camera));
      }
      marker["occlusion"] = 1 - truth.visible;
    }
    json["markers"].push_back(std::move(marker));
  }
  return json.dump();
}

}  // namespace tarsier::synth
