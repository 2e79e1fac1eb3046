// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/fusion.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <Eigen/Core>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <numbers>
#include <optional>

namespace tarsier::sfm {
namespace {

struct View {
  DepthMap map;
  cv::Mat3b color;
  geometry::Camera camera;
  geometry::Rigid3 pose;

  [[nodiscard]] std::int64_t bytes() const {
    return static_cast<std::int64_t>(map.depth.total()) * (4 + 12 + 4 + 3);
  }
  [[nodiscard]] Eigen::Vector3d world_of(int x, int y) const {
    const double z = map.depth.at<float>(y, x);
    const Eigen::Vector3d in_camera((x - camera.cx) / camera.fx * z,
                                    (y - camera.cy) / camera.fy * z, z);
    return pose.rotation.transpose() * (in_camera - pose.translation);
  }
  [[nodiscard]] Eigen::Vector3d normal_of(int x, int y) const {
    const auto& n = map.normal.at<cv::Vec3f>(y, x);
    return pose.rotation.transpose() * Eigen::Vector3d(n[0], n[1], n[2]);
  }
};

// The most recently used views, within a memory limit.
class Views {
 public:
  Views(const Workspace& workspace, std::int64_t memory) : workspace_(workspace), memory_(memory) {}

  std::shared_ptr<const View> get(int index) {
    const auto found = views_.find(index);
    if (found != views_.end()) {
      order_.remove(index);
      order_.push_back(index);
      return found->second;
    }
    auto view = std::make_shared<View>();
    view->map = workspace_.read_depth_map(index);
    cv::resize(workspace_.read_image(index), view->color, view->map.depth.size(), 0, 0,
               cv::INTER_AREA);
    view->camera = camera_of_map(workspace_.camera(index), view->map.depth.size());
    view->pose = workspace_.pose(index);
    bytes_ += view->bytes();
    views_[index] = view;
    order_.push_back(index);
    while (bytes_ > memory_ && order_.size() > 1) {
      bytes_ -= views_[order_.front()]->bytes();
      views_.erase(order_.front());
      order_.pop_front();
    }
    return view;
  }

 private:
  const Workspace& workspace_;
  std::int64_t memory_;
  std::int64_t bytes_ = 0;
  std::map<int, std::shared_ptr<const View>> views_;
  std::list<int> order_;  // the most recently used is the last
};

struct Neighbour {
  std::shared_ptr<const View> view;
  cv::Mat1b fused;
};

class Fuser {
 public:
  Fuser(const View& view, const std::vector<Neighbour>& neighbours, const FusionOptions& options)
      : view_(view),
        neighbours_(neighbours),
        options_(options),
        min_cosine_(std::cos(options.max_normal_angle_deg * std::numbers::pi / 180)),
        min_views_(neighbours.empty() ? 1 : options.min_views) {}

  [[nodiscard]] std::optional<CloudPoint> point_at(int x, int y) const {
    const Eigen::Vector3d world = view_.world_of(x, y);
    const Eigen::Vector3d normal = view_.normal_of(x, y);
    Sum sum;
    sum.add(view_, x, y, world, normal);
    std::array<std::pair<const Neighbour*, cv::Point>, 64> fused;
    std::size_t count = 0;
    int visible = 1;
    for (const Neighbour& neighbour : neighbours_) {
      const View& other = *neighbour.view;
      const Eigen::Vector3d there = other.pose * world;
      const auto pixel = other.camera.project(there);
      if (!pixel || !(pixel->x > -0.5 && pixel->y > -0.5 && pixel->x < other.camera.width - 0.5 &&
                      pixel->y < other.camera.height - 0.5))
        continue;
      ++visible;
      const cv::Point at(static_cast<int>(std::lround(pixel->x)),
                         static_cast<int>(std::lround(pixel->y)));
      const float known = other.map.depth.at<float>(at);
      if (!(known > 0) || !(std::abs(known / there.z() - 1) <= options_.max_depth_difference))
        continue;
      const Eigen::Vector3d other_world = other.world_of(at.x, at.y);
      const Eigen::Vector3d other_normal = other.normal_of(at.x, at.y);
      if (!(other_normal.dot(normal) >= min_cosine_)) continue;
      const auto back = view_.camera.project(view_.pose * other_world);
      if (!back || !(std::hypot(back->x - x, back->y - y) <= options_.max_reprojection_px))
        continue;
      sum.add(other, at.x, at.y, other_world, other_normal);
      if (count < fused.size()) fused[count++] = {&neighbour, at};
    }
    if (sum.count < std::min(min_views_, std::max(visible, 2))) return std::nullopt;
    for (std::size_t i = 0; i < count; ++i) {
      // Several threads may mark a pixel; all write the same value.
      auto& flag = const_cast<std::uint8_t&>(fused[i].first->fused(fused[i].second));
      std::atomic_ref<std::uint8_t>(flag).store(1, std::memory_order_relaxed);
    }
    return sum.point();
  }

 private:
  struct Sum {
    int count = 0;
    double weight = 0;
    double error_probability = 1;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    Eigen::Vector3d normal = Eigen::Vector3d::Zero();
    cv::Vec3d color;

    void add(const View& view, int x, int y, const Eigen::Vector3d& at, const Eigen::Vector3d& n) {
      const double confidence = view.map.confidence.at<float>(y, x);
      const double w = confidence + 1e-3;
      ++count;
      weight += w;
      error_probability *= 1 - confidence;
      position += w * at;
      normal += w * n;
      color += w * cv::Vec3d(view.color(y, x));
    }
    [[nodiscard]] CloudPoint point() const {
      CloudPoint point;
      const Eigen::Vector3d mean = position / weight;
      const double length = normal.norm();
      for (int k = 0; k < 3; ++k) {
        point.position[k] = static_cast<float>(mean[k]);
        point.normal[k] = static_cast<float>(length > 0 ? normal[k] / length : 0);
        point.color[k] = cv::saturate_cast<std::uint8_t>(color[k] / weight);
      }
      point.confidence = static_cast<float>(1 - error_probability);
      return point;
    }
  };

  const View& view_;
  const std::vector<Neighbour>& neighbours_;
  const FusionOptions& options_;
  const double min_cosine_;
  const int min_views_;
};

}  // namespace

std::vector<std::int64_t> fuse(const Workspace& workspace,
                               const std::vector<std::vector<int>>& neighbours,
                               const FusionOptions& options, std::int64_t memory_bytes,
                               CloudWriter& cloud, Progress& progress,
                               const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(neighbours.size() == static_cast<std::size_t>(workspace.count()),
                  "neighbours for {} of {} images", neighbours.size(), workspace.count());
  Views views(workspace, memory_bytes);
  std::vector<cv::Mat1b> fused(neighbours.size());
  const auto mask_of = [&](int index, const View& view) {
    cv::Mat1b& mask = fused[static_cast<std::size_t>(index)];
    if (mask.empty()) mask = cv::Mat1b::zeros(view.map.depth.size());
    return mask;
  };
  std::vector<std::int64_t> counts(neighbours.size(), 0);
  progress.begin("fuse", workspace.count(), "images");
  for (int i = 0; i < workspace.count(); ++i) {
    throw_if_stopped(stop);
    if (!workspace.has_depth_map(i)) {
      progress.advance();
      continue;
    }
    const std::shared_ptr<const View> view = views.get(i);
    const cv::Mat1b mask = mask_of(i, *view);
    std::vector<Neighbour> around;
    for (const int j : neighbours[static_cast<std::size_t>(i)]) {
      if (j == i || !workspace.has_depth_map(j)) continue;
      const std::shared_ptr<const View> other = views.get(j);
      around.push_back({other, mask_of(j, *other)});
    }
    const Fuser fuser(*view, around, options);
    std::vector<std::vector<CloudPoint>> rows(static_cast<std::size_t>(mask.rows));
    cv::parallel_for_(cv::Range(0, mask.rows), [&](const cv::Range& range) {
      for (int y = range.start; y < range.end && !stop.stop_requested(); ++y) {
        for (int x = 0; x < mask.cols; ++x) {
          if (mask(y, x) != 0 || !(view->map.depth.at<float>(y, x) > 0)) continue;
          if (const auto point = fuser.point_at(x, y))
            rows[static_cast<std::size_t>(y)].push_back(*point);
        }
      }
    });
    throw_if_stopped(stop);
    for (const std::vector<CloudPoint>& row : rows) {
      cloud.add(row);
      counts[static_cast<std::size_t>(i)] += static_cast<std::int64_t>(row.size());
    }
    // Later images do not need it.
    fused[static_cast<std::size_t>(i)].release();
    progress.advance();
  }
  progress.end();
  return counts;
}

}  // namespace tarsier::sfm
