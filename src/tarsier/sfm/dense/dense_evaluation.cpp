// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/dense_evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/sfm/dense/point_grid.h"
#include "tarsier/sfm/dense/surface_truth.h"

#include <Eigen/Core>
#include <fmt/format.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr double kSpacing = 0.001;  // spacing of the true surface's points, share of the extent
constexpr float kMaxShownError = 0.01F;

// The distance of each point to the nearest one of the grid.
std::vector<float> distances(const std::vector<cv::Vec3f>& points, const PointGrid& grid,
                             float limit, const std::stop_token& stop) {
  std::vector<float> result(points.size());
  cv::parallel_for_(cv::Range(0, static_cast<int>(points.size())), [&](const cv::Range& range) {
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto index = static_cast<std::size_t>(i);
      result[index] = grid.distance(points[index], limit);
    }
  });
  throw_if_stopped(stop);
  return result;
}

cv::Mat draw_errors(const cv::Mat1f& errors) {
  cv::Mat1b part(errors.size(), static_cast<std::uint8_t>(0));
  cv::Mat1b known(errors.size(), static_cast<std::uint8_t>(0));
  for (int y = 0; y < errors.rows; ++y) {
    for (int x = 0; x < errors.cols; ++x) {
      if (errors(y, x) < 0) continue;
      known(y, x) = 255;
      part(y, x) = cv::saturate_cast<std::uint8_t>(255 * errors(y, x) / kMaxShownError);
    }
  }
  cv::Mat colors;
  cv::applyColorMap(part, colors, cv::COLORMAP_TURBO);
  cv::Mat image = cv::Mat::zeros(errors.size(), CV_8UC3);
  colors.copyTo(image, known);
  return image;
}

class Evaluation {
 public:
  Evaluation(const Workspace& truth, const Workspace& model)
      : truth_(truth), model_(model), similarity_(align_workspaces(truth, model)) {
    for (int i = 0; i < model.count(); ++i) by_name_[model.name(i)] = i;
  }

  void score_depths(const std::function<void(const std::string&, const cv::Mat&)>& show,
                    Progress& progress, const std::stop_token& stop, DenseScores& scores) {
    std::vector<float> all;
    progress.begin("depths", truth_.count(), "images");
    for (int i = 0; i < truth_.count(); ++i) {
      throw_if_stopped(stop);
      views_.push_back(ground_truth_view(truth_, i));
      scores.images.push_back(score_image(i, show, all));
      progress.advance();
    }
    progress.end();
    scores.depth_median = lower_quantile(all, 0.5);
  }

  void score_cloud(const std::stop_token& stop, DenseScores& scores) {
    std::vector<cv::Vec3f> surface;
    for (std::size_t i = 0; i < views_.size(); ++i) {
      throw_if_stopped(stop);
      const GroundTruthView& view = views_[i];
      for (int y = 0; y < view.depth.rows; ++y) {
        for (int x = 0; x < view.depth.cols; ++x) {
          if (!(view.depth(y, x) > 0)) continue;
          const Eigen::Vector3d world = view.world_of(x, y);
          for (std::size_t j = 0; j < views_.size(); ++j) {
            if (j == i || !views_[j].sees(world)) continue;
            surface.emplace_back(geometry::to_cv(world));
            break;
          }
        }
      }
    }
    if (surface.empty())
      throw InputError(truth_.folder(),
                       "no part of the ground truth surface is seen by two images");
    scores.extent = extent_of(surface);
    const std::string path = (fs::path(model_.folder()) / "fused.ply").string();
    std::error_code ignored;
    if (!fs::exists(path, ignored)) return;
    std::vector<cv::Vec3f> points;
    for (const CloudPoint& point : read_cloud(path)) {
      const Eigen::Vector3d moved =
          similarity_ * Eigen::Vector3d(point.position[0], point.position[1], point.position[2]);
      points.emplace_back(geometry::to_cv(moved));
    }
    const float limit = distance_limit(scores.extent);
    const float cell = distance_cell(scores.extent);
    const PointGrid true_grid(
        voxel_downsampled(surface, static_cast<float>(scores.extent * kSpacing)), cell);
    const PointGrid grid(points, cell);
    scores.cloud =
        score_thresholds(distances(points, true_grid, limit, stop),
                         distances(true_grid.points(), grid, limit, stop), scores.extent);
  }

 private:
  // Compares at the pixels of a map that may be smaller, with the nearest true pixel.
  DenseScores::Depth score_image(
      int index, const std::function<void(const std::string&, const cv::Mat&)>& show,
      std::vector<float>& all) {
    DenseScores::Depth score;
    score.name = truth_.name(index);
    const auto found = by_name_.find(score.name);
    if (found == by_name_.end() || !model_.has_depth_map(found->second)) return score;
    const GroundTruthView& truth = views_.back();
    const cv::Mat1f depth = model_.read_depth_map(found->second).depth;
    cv::Mat1f errors(depth.size(), -1.F);
    std::vector<float> values;
    std::int64_t possible = 0;
    const double to_truth_x = static_cast<double>(truth.depth.cols) / depth.cols;
    const double to_truth_y = static_cast<double>(truth.depth.rows) / depth.rows;
    for (int y = 0; y < depth.rows; ++y) {
      for (int x = 0; x < depth.cols; ++x) {
        const auto expected =
            depth_between(truth.depth, (x + 0.5) * to_truth_x - 0.5, (y + 0.5) * to_truth_y - 0.5);
        if (!expected) continue;
        ++possible;
        if (!(depth(y, x) > 0)) continue;
        errors(y, x) =
            static_cast<float>(std::abs(depth(y, x) * similarity_.scale / *expected - 1));
        values.push_back(errors(y, x));
      }
    }
    if (show) show(score.name, draw_errors(errors));
    all.insert(all.end(), values.begin(), values.end());
    score.known =
        possible > 0 ? static_cast<double>(values.size()) / static_cast<double>(possible) : 0;
    score.within_tenth = share_within(values, 0.001);
    score.within_half = share_within(values, 0.005);
    score.within_one = share_within(values, 0.01);
    score.median = lower_quantile(values, 0.5);
    return score;
  }

  // Bilinear in inverse depth on one surface; at a depth edge the nearest pixel.
  static std::optional<double> depth_between(const cv::Mat1f& depth, double x, double y) {
    const int left = std::clamp(static_cast<int>(std::floor(x)), 0, depth.cols - 2);
    const int top = std::clamp(static_cast<int>(std::floor(y)), 0, depth.rows - 2);
    const double right = std::clamp(x - left, 0.0, 1.0);
    const double down = std::clamp(y - top, 0.0, 1.0);
    const float corners[4] = {depth(top, left), depth(top, left + 1), depth(top + 1, left),
                              depth(top + 1, left + 1)};
    const auto [low, high] = std::minmax_element(corners, corners + 4);
    if (*low > 0 && *high < 1.02F * *low) {
      const double upper = (1 - right) / corners[0] + right / corners[1];
      const double lower = (1 - right) / corners[2] + right / corners[3];
      return 1 / ((1 - down) * upper + down * lower);
    }
    const float nearest = corners[(down < 0.5 ? 0 : 2) + (right < 0.5 ? 0 : 1)];
    if (!(nearest > 0)) return std::nullopt;
    return nearest;
  }

  const Workspace& truth_;
  const Workspace& model_;
  const geometry::Sim3 similarity_;
  std::map<std::string, int> by_name_;
  std::vector<GroundTruthView> views_;  // of the ground truth
};

}  // namespace

nlohmann::ordered_json to_json(const DenseScores& scores) {
  const auto rounded = [](double value) { return std::round(value * 1e6) / 1e6; };
  nlohmann::ordered_json images = nlohmann::ordered_json::array();
  for (const DenseScores::Depth& image : scores.images) {
    images.push_back({{"name", image.name},
                      {"median", rounded(image.median)},
                      {"within_0.1", rounded(image.within_tenth)},
                      {"within_0.5", rounded(image.within_half)},
                      {"within_1", rounded(image.within_one)},
                      {"known", rounded(image.known)}});
  }
  return {{"images", std::move(images)},
          {"depth_median", rounded(scores.depth_median)},
          {"extent", rounded(scores.extent)},
          {"cloud", to_json(scores.cloud)}};
}

geometry::Sim3 align_workspaces(const Workspace& truth, const Workspace& model) {
  std::map<std::string, int> by_name;
  for (int i = 0; i < model.count(); ++i) by_name[model.name(i)] = i;
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  Eigen::Matrix3d turns = Eigen::Matrix3d::Zero();
  Eigen::Vector3d from_mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d to_mean = Eigen::Vector3d::Zero();
  for (int i = 0; i < truth.count(); ++i) {
    const auto found = by_name.find(truth.name(i));
    if (found == by_name.end()) continue;
    const geometry::Rigid3& pose = model.pose(found->second);
    from.push_back(pose.center());
    to.push_back(truth.pose(i).center());
    from_mean += from.back();
    to_mean += to.back();
    turns += truth.pose(i).rotation.transpose() * pose.rotation;
  }
  if (from.size() < 2) {
    throw InputError(model.folder(),
                     fmt::format("has {} images in common with {}: two or more are needed",
                                 from.size(), truth.folder()));
  }
  from_mean /= static_cast<double>(from.size());
  to_mean /= static_cast<double>(from.size());
  geometry::Sim3 similarity;
  similarity.rotation = geometry::nearest_rotation(turns);
  double above = 0;
  double below = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Eigen::Vector3d turned = similarity.rotation * (from[i] - from_mean);
    above += (to[i] - to_mean).dot(turned);
    below += turned.squaredNorm();
  }
  if (!(below > 0 && above > 0))
    throw InputError(model.folder(),
                     "the camera positions cannot be aligned with those of the ground truth");
  similarity.scale = above / below;
  similarity.translation = to_mean - similarity.scale * (similarity.rotation * from_mean);
  return similarity;
}

DenseScores evaluate_dense(const Workspace& truth, const Workspace& model,
                           const std::function<void(const std::string&, const cv::Mat&)>& show,
                           Progress& progress, const std::stop_token& stop) {
  Evaluation evaluation(truth, model);
  DenseScores scores;
  evaluation.score_depths(show, progress, stop, scores);
  evaluation.score_cloud(stop, scores);
  return scores;
}

}  // namespace tarsier::sfm
