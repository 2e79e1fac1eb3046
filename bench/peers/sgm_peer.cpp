// SPDX-License-Identifier: MIT
// tarsier_peer_sgm DENSE OUT
// Depth maps by plain OpenCV for the undistorted images of a dense folder. Each image is rectified
// with the same sources that `sfm dense` uses, and cv::StereoSGBM (Hirschmueller, TPAMI 2008)
// computes disparities. The depths of all pairs of an image are combined (joined()), and Tarsier's
// own code filters and fuses the maps. OUT becomes a dense folder for `sfm eval --dense` and `sfm
// mesh`. Prints one line of JSON; seconds are processor time without reading and fusing.
#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/dense_reconstructor.h"
#include "tarsier/sfm/dense/gray_images.h"
#include "tarsier/sfm/dense/workspace.h"

#include <Eigen/Geometry>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <iostream>
#include <nlohmann/json.hpp>
#include <vector>

namespace {

namespace fs = std::filesystem;
using namespace tarsier;
using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kMaxDisparities = 1024;
constexpr double kSameDepth = 0.01;  // relative difference of two pairs that agree

double cpu_seconds() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

Matrix3d matrix_of(const geometry::Camera& camera) {
  Matrix3d k;
  k << camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1;
  return k;
}

cv::Mat1b warped(const cv::Mat1b& image, const Matrix3d& homography, cv::Size size) {
  cv::Mat h;
  cv::eigen2cv(homography, h);
  cv::Mat1b result;
  cv::warpPerspective(image, result, h, size, cv::INTER_LINEAR);
  return result;
}

// Bilinear if the four neighbours are on one surface, else the nearest; below 0: unknown.
double disparity_at(const cv::Mat1s& map, double x, double y) {
  const int left = static_cast<int>(std::floor(x));
  const int top = static_cast<int>(std::floor(y));
  if (left < 0 || top < 0 || left + 1 >= map.cols || top + 1 >= map.rows) return -1;
  const short four[] = {map(top, left), map(top, left + 1), map(top + 1, left),
                        map(top + 1, left + 1)};
  const auto [low, high] = std::minmax_element(four, four + 4);
  const double right = x - left;
  const double down = y - top;
  if (*low >= 0 && *high - *low <= 16) {
    return ((1 - down) * ((1 - right) * four[0] + right * four[1]) +
            down * ((1 - right) * four[2] + right * four[3])) /
           16;
  }
  const short nearest = four[(down < 0.5 ? 0 : 2) + (right < 0.5 ? 0 : 1)];
  return nearest < 0 ? -1 : nearest / 16.0;
}

// The depths of the reference from one source; empty if the source is in front of or behind it.
cv::Mat1f pair_depth(const sfm::MatchImage& reference, const sfm::MatchImage& source,
                     double min_depth, double max_depth) {
  const geometry::Rigid3 source_from_reference = source.pose * reference.pose.inverse();
  const Matrix3d turn = source_from_reference.rotation;
  const Vector3d center = -turn.transpose() * source_from_reference.translation;
  const double baseline = center.norm();
  // The common frame: x towards the source, z in the mean viewing direction.
  const Vector3d x = center / baseline;
  const Vector3d ahead = Vector3d::UnitZ() + turn.transpose() * Vector3d::UnitZ();
  if (std::abs(ahead.dot(x)) > 0.9 * ahead.norm()) return {};
  const Vector3d z = (ahead - ahead.dot(x) * x).normalized();
  Matrix3d common;
  common << x.transpose(), z.cross(x).transpose(), z.transpose();
  const cv::Size size = reference.gray.size();
  const double focal = reference.camera.fx;
  const Matrix3d ray_of = matrix_of(reference.camera).inverse();
  Eigen::AlignedBox2d box;
  double nearest = max_depth;
  double farthest = 0;
  for (const double u : {0, size.width - 1}) {
    for (const double v : {0, size.height - 1}) {
      const Vector3d ray = common * ray_of * Vector3d(u, v, 1);
      if (!(ray.z() > 0.2)) return {};
      box.extend(Eigen::Vector2d(focal * ray.x() / ray.z(), focal * ray.y() / ray.z()));
      nearest = std::min(nearest, min_depth * ray.z());
      farthest = std::max(farthest, max_depth * ray.z());
    }
  }
  const double at_farthest = focal * baseline / farthest;
  const double range = focal * baseline / nearest - at_farthest;
  const int disparities = std::min(kMaxDisparities, (static_cast<int>(range) / 16 + 1) * 16);
  // Space at the left for points outside the reference's border in the source.
  const cv::Size canvas(static_cast<int>(box.sizes().x()) + 1 + disparities,
                        static_cast<int>(box.sizes().y()) + 1);
  if (canvas.area() > 8 * size.area()) return {};
  Matrix3d left;
  left << focal, 0, disparities - box.min().x(), 0, focal, -box.min().y(), 0, 0, 1;
  Matrix3d right = left;
  right(0, 2) += at_farthest;  // the farthest depth has disparity 0
  const Matrix3d from_reference = left * common * ray_of;
  const Matrix3d from_source =
      right * common * turn.transpose() * matrix_of(source.camera).inverse();
  constexpr int kBlock = 5;
  const auto matcher =
      cv::StereoSGBM::create(0, disparities, kBlock, 8 * kBlock * kBlock, 32 * kBlock * kBlock, 1,
                             63, 10, 100, 2, cv::StereoSGBM::MODE_SGBM);
  cv::Mat found;
  matcher->compute(warped(reference.gray, from_reference, canvas),
                   warped(source.gray, from_source, canvas), found);
  const cv::Mat1s disparity = found;
  cv::Mat1f depth(size, 0.F);
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      const Vector3d place = from_reference * Vector3d(u, v, 1);
      const double d = disparity_at(disparity, place.x() / place.z(), place.y() / place.z());
      if (d < 0) continue;
      depth(v, u) = static_cast<float>(focal * baseline / (d + at_farthest) / place.z());
    }
  }
  return depth;
}

// For each pixel the mean of the largest group of pairs that agree; at least two if there are
// several.
cv::Mat1f joined(const std::vector<cv::Mat1f>& depths, cv::Size size) {
  cv::Mat1f result(size, 0.F);
  std::vector<float> values;
  for (int v = 0; v < size.height; ++v) {
    for (int u = 0; u < size.width; ++u) {
      values.clear();
      for (const cv::Mat1f& depth : depths)
        if (depth(v, u) > 0) values.push_back(depth(v, u));
      std::size_t most = 0;
      for (const float middle : values) {
        float sum = 0;
        std::size_t count = 0;
        for (const float value : values) {
          if (!(std::abs(value / middle - 1) < kSameDepth)) continue;
          sum += value;
          ++count;
        }
        if (count <= most) continue;
        most = count;
        result(v, u) = sum / static_cast<float>(count);
      }
      if (most < 2 && depths.size() > 1) result(v, u) = 0;
    }
  }
  return result;
}

cv::Mat3f normals_of(const cv::Mat1f& depth, const geometry::Camera& camera) {
  cv::Mat3f result(depth.size(), cv::Vec3f(0, 0, -1));
  const auto point = [&](int u, int v) {
    const double z = depth(v, u);
    return Vector3d((u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z);
  };
  constexpr int kStep = 2;
  for (int v = kStep; v + kStep < depth.rows; ++v) {
    for (int u = kStep; u + kStep < depth.cols; ++u) {
      if (!(depth(v, u) > 0 && depth(v, u - kStep) > 0 && depth(v, u + kStep) > 0 &&
            depth(v - kStep, u) > 0 && depth(v + kStep, u) > 0))
        continue;
      Vector3d normal = (point(u, v + kStep) - point(u, v - kStep))
                            .cross(point(u + kStep, v) - point(u - kStep, v));
      if (!(normal.norm() > 0)) continue;
      normal.normalize();
      if (normal.dot(point(u, v)) > 0) normal = -normal;
      result(v, u) = cv::Vec3f(static_cast<float>(normal.x()), static_cast<float>(normal.y()),
                               static_cast<float>(normal.z()));
    }
  }
  return result;
}

void run(const std::string& from, const std::string& to) {
  fs::create_directories(to);
  fs::copy(fs::path(from) / "sparse", fs::path(to) / "sparse",
           fs::copy_options::recursive | fs::copy_options::overwrite_existing);
  if (!fs::exists(fs::path(to) / "images"))
    fs::create_directory_symlink(fs::absolute(fs::path(from) / "images"), fs::path(to) / "images");
  const sfm::Workspace workspace = sfm::Workspace::open(to);
  const sfm::DenseOptions options;
  const auto choices = sfm::select_views(workspace.sparse(), options.views);
  std::vector<cv::Size> sizes;
  for (int i = 0; i < workspace.count(); ++i) {
    const geometry::Camera& camera = workspace.camera(i);
    const double side = std::max(camera.width, camera.height);
    const double scale = std::max(1 / options.reduce, std::min(1.0, options.min_side / side));
    sizes.emplace_back(static_cast<int>(std::lround(camera.width * scale)),
                       static_cast<int>(std::lround(camera.height * scale)));
  }
  sfm::GrayImages grays(workspace, sizes, 1'000'000'000);
  std::vector<sfm::MatchImage> views;
  for (int i = 0; i < workspace.count(); ++i) {
    views.emplace_back();
    views.back().gray = grays.get(i);
    views.back().camera = sfm::camera_of_map(workspace.camera(i), views.back().gray.size());
    views.back().pose = workspace.pose(i);
  }
  const double start = cpu_seconds();
  for (std::size_t i = 0; i < views.size(); ++i) {
    std::vector<cv::Mat1f> depths;
    for (const auto& source : choices[i].sources) {
      cv::Mat1f depth = pair_depth(views[i], views[static_cast<std::size_t>(source.image)],
                                   choices[i].min_depth, choices[i].max_depth);
      if (!depth.empty()) depths.push_back(std::move(depth));
    }
    views[i].depth = joined(depths, views[i].gray.size());
  }
  const double seconds = cpu_seconds() - start;
  std::vector<std::vector<int>> neighbours(views.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    sfm::MatchProblem problem;
    problem.reference = views[i];
    problem.min_depth = choices[i].min_depth;
    problem.max_depth = choices[i].max_depth;
    for (const auto& source : choices[i].sources) {
      problem.sources.push_back(views[static_cast<std::size_t>(source.image)]);
      neighbours[i].push_back(source.image);
    }
    if (problem.sources.empty()) continue;
    const sfm::PlaneMap map{views[i].depth, normals_of(views[i].depth, views[i].camera),
                            cv::Mat1f(views[i].depth.size(), 0.F)};
    workspace.write_depth_map(static_cast<int>(i), sfm::filtered(problem, map, options.filter));
  }
  sfm::CloudWriter cloud((fs::path(to) / "fused.ply").string());
  NoProgress progress;
  (void)sfm::fuse(workspace, neighbours, options.fusion, 1'000'000'000, cloud, progress, {});
  cloud.commit();
  std::cout << nlohmann::json{{"points", cloud.count()},
                              {"images", views.size()},
                              {"cpu_seconds", seconds},
                              {"opencv", CV_VERSION}}
            << "\n";
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: tarsier_peer_sgm DENSE OUT\n";
    return 2;
  }
  try {
    cv::setNumThreads(1);
    run(argv[1], argv[2]);
  } catch (const std::exception& error) {
    std::cerr << "tarsier_peer_sgm: " << error.what() << "\n";
    return 1;
  }
  return 0;
}
