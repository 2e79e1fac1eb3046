// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/depth_filter.h"

#include "tarsier/core/require.h"

#include <Eigen/Core>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace tarsier::sfm {
namespace {

// Projects points of the reference into another image and back.
struct Reprojection {
  const MatchImage& reference;
  const MatchImage& source;
  geometry::Rigid3 source_from_reference;

  // Computes the error of a reference pixel after projection to the source and back, and the
  // difference of the depths there. False where the source has no depth. `inside`: whether the
  // point is in the source's image.
  bool compute(int x, int y, float depth, bool& inside, double& px, double& difference) const {
    inside = false;
    const geometry::Camera& from = reference.camera;
    const geometry::Camera& to = source.camera;
    const Eigen::Vector3d point(depth * (x - from.cx) / from.fx, depth * (y - from.cy) / from.fy,
                                depth);
    const Eigen::Vector3d there = source_from_reference * point;
    if (!(there.z() > 0)) return false;
    const double u = to.fx * there.x() / there.z() + to.cx;
    const double v = to.fy * there.y() / there.z() + to.cy;
    if (!(u > -0.5 && v > -0.5 && u < to.width - 0.5 && v < to.height - 0.5)) return false;
    inside = true;
    const int column = static_cast<int>(std::lround(u));
    const int row = static_cast<int>(std::lround(v));
    const float known = source.depth(std::min(row, to.height - 1), std::min(column, to.width - 1));
    if (!(known > 0)) return false;
    difference = std::abs(known / there.z() - 1);
    const Eigen::Vector3d back =
        source_from_reference.rotation.transpose() *
        (Eigen::Vector3d((u - to.cx) / to.fx, (v - to.cy) / to.fy, 1) * static_cast<double>(known) -
         source_from_reference.translation);
    if (!(back.z() > 0)) return false;
    px = std::hypot(from.fx * back.x() / back.z() + from.cx - x,
                    from.fy * back.y() / back.z() + from.cy - y);
    return true;
  }
};

}  // namespace

DepthMap filtered(const MatchProblem& problem, const PlaneMap& map,
                  const DepthFilterOptions& options) {
  problem.check();
  options.check();
  TARSIER_REQUIRE(map.depth.size() == problem.reference.gray.size(), "a map of {}x{}",
                  map.depth.cols, map.depth.rows);
  std::vector<Reprojection> reprojections;
  for (const MatchImage& source : problem.sources) {
    if (source.depth.empty()) continue;
    reprojections.push_back(
        {problem.reference, source, source.pose * problem.reference.pose.inverse()});
  }
  const int min_agreeing = reprojections.empty() ? 0 : options.min_consistent;
  DepthMap result;
  result.depth = cv::Mat1f::zeros(map.depth.size());
  result.normal = cv::Mat3f::zeros(map.depth.size());
  result.confidence = cv::Mat1f::zeros(map.depth.size());
  cv::parallel_for_(cv::Range(0, map.depth.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      for (int x = 0; x < map.depth.cols; ++x) {
        const float depth = map.depth(y, x);
        const float cost = map.cost(y, x);
        if (!(depth > 0) || !(cost <= options.max_cost)) continue;
        int agreeing = 0;
        int visible = 0;
        for (const Reprojection& reprojection : reprojections) {
          bool inside = false;
          double px = 0;
          double difference = 0;
          if (reprojection.compute(x, y, depth, inside, px, difference) &&
              px <= options.max_reprojection_px && difference <= options.max_depth_difference)
            ++agreeing;
          if (inside) ++visible;
        }
        const bool is_seen_by_few = visible < min_agreeing;
        if (agreeing < (is_seen_by_few ? std::max(visible, 1) : min_agreeing)) continue;
        if (is_seen_by_few && !(cost <= options.max_cost / 2)) continue;
        result.depth.at<float>(y, x) = depth;
        result.normal.at<cv::Vec3f>(y, x) = map.normal(y, x);
        result.confidence.at<float>(y, x) =
            std::max(0.F, 1 - cost) * (1 - std::exp2(-static_cast<float>(agreeing)));
      }
    }
  });
  remove_small_segments(result, options.min_segment_px, options.max_depth_difference);
  return result;
}

void remove_small_segments(DepthMap& map, int min_px, double difference) {
  map.check();
  const cv::Size size = map.depth.size();
  cv::Mat1b seen(size, static_cast<std::uint8_t>(0));
  std::vector<cv::Point> segment;
  const auto limit = static_cast<float>(difference);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      if (seen(y, x) != 0 || !(map.depth.at<float>(y, x) > 0)) continue;
      segment.assign(1, {x, y});
      seen(y, x) = 1;
      for (std::size_t i = 0; i < segment.size(); ++i) {
        const cv::Point at = segment[i];
        const float depth = map.depth.at<float>(at);
        for (const cv::Point& step :
             {cv::Point(1, 0), cv::Point(-1, 0), cv::Point(0, 1), cv::Point(0, -1)}) {
          const cv::Point next = at + step;
          if (next.x < 0 || next.y < 0 || next.x >= size.width || next.y >= size.height) continue;
          const float other = map.depth.at<float>(next);
          if (seen(next) != 0 || !(other > 0) || !(std::abs(other - depth) <= limit * depth))
            continue;
          seen(next) = 1;
          segment.push_back(next);
        }
      }
      if (static_cast<int>(segment.size()) >= min_px) continue;
      for (const cv::Point& at : segment) {
        map.depth.at<float>(at) = 0;
        if (!map.normal.empty()) map.normal.at<cv::Vec3f>(at) = {0, 0, 0};
        if (!map.confidence.empty()) map.confidence.at<float>(at) = 0;
      }
    }
  }
}

}  // namespace tarsier::sfm
