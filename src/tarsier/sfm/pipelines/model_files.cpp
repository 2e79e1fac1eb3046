// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/model_files.h"

#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/ply.h"
#include "tarsier/sfm/scene/sensor_image.h"
#include "tarsier/sfm/scene/undistort.h"
#include "tarsier/sfm/view/animation.h"
#include "tarsier/sfm/view/render.h"
#include "tarsier/sfm/view/viewer.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <filesystem>
#include <map>
#include <set>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

// Size of the pyramids in cameras.ply, world units.
double camera_size(const Model& model) {
  Eigen::Vector3d low(1e300, 1e300, 1e300);
  Eigen::Vector3d high = -low;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    const Eigen::Vector3d center = image.pose.center();
    low = low.cwiseMin(center);
    high = high.cwiseMax(center);
  }
  return std::max(1e-6, 0.05 * (high - low).norm());
}

}  // namespace

void write_model(const std::string& folder, const Model& model) {
  const fs::path path(folder);
  write_colmap(folder, model);
  write_points_ply((path / "points.ply").string(), model);
  write_cameras_ply((path / "cameras.ply").string(), model, camera_size(model));
}

void write_views(const std::string& folder, const Model& model) {
  const fs::path path(folder);
  write_file_atomically((path / "view.html").string(), viewer_html(model, "Reconstruction"));
  write_image((path / "view.png").string(), render_model(model, {}));
}

void write_turntable(const std::string& folder, const Model& model) {
  ViewOptions view;
  view.size = {640, 480};
  std::vector<cv::Mat> frames;
  render_turntable(model, view, 36,
                   [&](int, const cv::Mat& frame) { frames.push_back(frame.clone()); });
  write_gif((fs::path(folder) / "turntable.gif").string(), frames, 12);
}

void write_undistorted(const std::string& folder, const Model& model,
                       const std::vector<Input>& inputs, Progress& progress,
                       const std::stop_token& stop) {
  std::map<std::string, std::string> paths;
  for (const Input& input : inputs) paths[input.name] = input.path;
  export_undistorted((fs::path(folder) / "undistorted").string(), model,
                     [&](const std::string& name) { return read_sensor_image(paths.at(name)); },
                     progress, stop);
}

cv::Mat draw_matches(const ComparedPair& pair) {
  constexpr double kMaxHeight = 600;
  constexpr std::size_t kMaxLines = 60;
  cv::Mat sides[2] = {read_sensor_image(pair.first.path), read_sensor_image(pair.second.path)};
  double scales[2];
  for (int k = 0; k < 2; ++k) {
    scales[k] = std::min(1.0, kMaxHeight / sides[k].rows);
    cv::resize(sides[k], sides[k], {}, scales[k], scales[k], cv::INTER_AREA);
  }
  cv::Mat drawn(std::max(sides[0].rows, sides[1].rows), sides[0].cols + sides[1].cols, CV_8UC3,
                cv::Scalar::all(255));
  sides[0].copyTo(drawn(cv::Rect({0, 0}, sides[0].size())));
  sides[1].copyTo(drawn(cv::Rect({sides[0].cols, 0}, sides[1].size())));
  std::set<int> inliers;
  for (const Match& match : pair.view.inliers) inliers.insert(match.first);
  for (const bool good : {false, true}) {
    const std::size_t all = good ? inliers.size() : pair.matches.size() - inliers.size();
    const std::size_t every = std::max<std::size_t>(1, all / kMaxLines);
    const cv::Scalar color = good ? cv::Scalar(80, 190, 60) : cv::Scalar(60, 60, 220);
    std::size_t number = 0;
    for (const Match& match : pair.matches) {
      if (inliers.contains(match.first) != good) continue;
      const cv::Point2d a =
          cv::Point2d(pair.first_points[static_cast<std::size_t>(match.first)]) * scales[0];
      const cv::Point2d b =
          cv::Point2d(pair.second_points[static_cast<std::size_t>(match.second)]) * scales[1];
      const cv::Point2d in_second = b + cv::Point2d(sides[0].cols, 0);
      cv::circle(drawn, a, 2, color, cv::FILLED, cv::LINE_AA);
      cv::circle(drawn, in_second, 2, color, cv::FILLED, cv::LINE_AA);
      if (number++ % every == 0) cv::line(drawn, a, in_second, color, 1, cv::LINE_AA);
    }
  }
  return drawn;
}

}  // namespace tarsier::sfm
