// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/voxel_volume.h"

#include "tarsier/core/require.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

constexpr std::uint64_t kMask = (1U << 21) - 1;
constexpr int kBias = 1 << 20;
constexpr double kMaxRayTruncations = 1.5;  // truncations along the ray
constexpr double kTruncationPixels = 1;     // px; where these exceed a voxel, the truncation grows
constexpr float kMinNormalCosine = 0.7F;
constexpr double kMaxTruncationFactor = 4;  // max factor of the truncation

std::size_t slot_of(VoxelVolume::Key key, std::size_t mask) {
  key ^= key >> 31;
  key *= 0x9E3779B97F4A7C15U;
  return static_cast<std::size_t>(key >> 20) & mask;
}

// Data for the inner loop of integrate().
struct VoxelView {
  Eigen::Matrix3f rotation;  // camera from voxel coordinates
  Eigen::Vector3f translation;
  float fx, fy, cx, cy;
  int width, height;
  float per_unit;    // voxels per world unit
  float truncation;  // voxels
  float per_depth;   // truncation in voxels per world unit of depth
  float carving;
  float factor;  // of the weights
};

float distance_to(const cv::Vec4f& plane, const Eigen::Vector3f& at) {
  return plane[0] * at[0] + plane[1] * at[1] + plane[2] * at[2] - plane[3];
}

// Mean distance, world units, to the planes of the four pixels around (u, v), weighted by proximity
// and their weights. Only planes that agree with that of the nearest pixel are used: normals within
// 45 degrees, so that edges are not averaged, and distances within `max_difference`.
float mean_distance(const TangentMap& map, const Eigen::Vector3f& at, float u, float v,
                    const cv::Vec4f& nearest_plane, float nearest, float max_difference) {
  const auto left = static_cast<int>(std::floor(u));
  const auto top = static_cast<int>(std::floor(v));
  const float across = u - static_cast<float>(left);
  const float down = v - static_cast<float>(top);
  float sum = 0;
  float total = 0;
  for (int j = std::max(0, top); j <= std::min(top + 1, map.weights.rows - 1); ++j) {
    const auto* weights = map.weights.ptr<float>(j);
    const auto* planes = map.planes.ptr<cv::Vec4f>(j);
    for (int i = std::max(0, left); i <= std::min(left + 1, map.weights.cols - 1); ++i) {
      if (!(weights[i] > 0)) continue;
      const float distance = distance_to(planes[i], at);
      const float cosine = planes[i][0] * nearest_plane[0] + planes[i][1] * nearest_plane[1] +
                           planes[i][2] * nearest_plane[2];
      if (cosine < kMinNormalCosine || std::abs(distance - nearest) > max_difference) continue;
      const float weight =
          weights[i] * (i == left ? 1 - across : across) * (j == top ? 1 - down : down);
      sum += weight * distance;
      total += weight;
    }
  }
  return total > 0 ? sum / total : nearest;
}

void add(Voxel& voxel, float distance, float weight) {
  const float sum = voxel.weight + weight;
  voxel.distance += (distance - voxel.distance) * (weight / sum);
  voxel.weight = sum;
}

// `start`: voxel (0, y, z) of a block in the camera frame; `step`: offset of the next one along x.
void add_row(const VoxelView& view, const TangentMap& map, Eigen::Vector3f at,
             const Eigen::Vector3f& step, Voxel* row) {
  for (int x = 0; x < VoxelVolume::kSide; ++x, at += step) {
    if (!(at[2] > 0)) continue;
    const float u = view.fx * at[0] / at[2] + view.cx;
    const float v = view.fy * at[1] / at[2] + view.cy;
    if (!(u >= -0.5F && v >= -0.5F && u < static_cast<float>(view.width) - 0.5F &&
          v < static_cast<float>(view.height) - 0.5F))
      continue;
    const int column = static_cast<int>(u + 0.5F);
    const int line = static_cast<int>(v + 0.5F);
    float weight = map.weights.ptr<float>(line)[column];
    if (!(weight > 0)) {
      if (!map.empty.empty() && map.empty(line, column) != 0)
        add(row[x], view.truncation, view.carving * view.factor);
      continue;
    }
    const cv::Vec4f& plane = map.planes.ptr<cv::Vec4f>(line)[column];
    const float from_nearest = distance_to(plane, at);
    float distance = from_nearest * view.per_unit;
    const float truncation = std::clamp(at[2] * view.per_depth, view.truncation,
                                        static_cast<float>(kMaxTruncationFactor) * view.truncation);
    if (distance < -truncation) continue;
    if (distance < truncation)
      distance = view.per_unit *
                 mean_distance(map, at, u, v, plane, from_nearest, truncation / view.per_unit);
    weight *= view.factor;
    if (distance < 0) {
      // The ray meets the plane at `share` of the voxel's depth.
      const float n_dot_x = from_nearest + plane[3];
      const float share = n_dot_x < 0 ? plane[3] / n_dot_x : 1;
      if ((1 - share) * at[2] * view.per_unit > static_cast<float>(kMaxRayTruncations) * truncation)
        continue;
      weight *= std::min(1.0F, std::max(0.0F, truncation + distance) / (truncation - 1));
    } else if (distance > truncation) {
      distance = truncation;
      weight *= view.carving;
    }
    if (!(weight > 0)) continue;
    add(row[x], distance, weight);
  }
}

// The known pixels that are not within `trim` of a larger unknown area.
cv::Mat1b inner_pixels(const cv::Mat& depth, int trim) {
  cv::Mat1b inner;
  cv::compare(depth, 0, inner, cv::CMP_GT);
  if (trim == 0) return inner;
  const cv::Mat disc = cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * trim + 1, 2 * trim + 1});
  cv::morphologyEx(inner, inner, cv::MORPH_CLOSE, disc);
  cv::erode(inner, inner, disc);
  return inner;
}

// Whether the bounding sphere of a block may be in the image.
bool may_be_visible(const VoxelView& view, const Eigen::Vector3f& center, float radius) {
  if (center[2] < -radius) return false;
  if (center[2] < 2 * radius) return true;
  const float inverse = 1 / (center[2] - radius);
  const float reach = 1.5F * std::max(view.fx, view.fy) * radius * inverse;
  const float u = view.fx * center[0] / center[2] + view.cx;
  const float v = view.fy * center[1] / center[2] + view.cy;
  // A sphere off the axis projects to a larger area.
  const float slant = 1 + std::hypot(center[0], center[1]) / center[2];
  return u > -slant * reach && v > -slant * reach &&
         u < static_cast<float>(view.width) + slant * reach &&
         v < static_cast<float>(view.height) + slant * reach;
}

}  // namespace

VoxelVolume::VoxelVolume(double size) : size_(size) {
  TARSIER_REQUIRE(size > 0 && std::isfinite(size), "{}", size);
}

VoxelVolume::Key VoxelVolume::key_of(const Index& block) {
  const auto part = [&](int k) { return static_cast<std::uint64_t>(block[k] + kBias); };
  return part(2) << 42 | part(1) << 21 | part(0);
}

VoxelVolume::Index VoxelVolume::index_of(Key key) {
  return {static_cast<int>(key & kMask) - kBias, static_cast<int>(key >> 21 & kMask) - kBias,
          static_cast<int>(key >> 42) - kBias};
}

int VoxelVolume::find(const Index& block) const {
  if (table_.empty()) return -1;
  const Key key = key_of(block);
  const std::size_t mask = table_.size() - 1;
  for (std::size_t slot = slot_of(key, mask);; slot = (slot + 1) & mask) {
    const int found = table_[slot];
    if (found < 0 || keys_[static_cast<std::size_t>(found)] == key) return found;
  }
}

void VoxelVolume::allocate(std::vector<Key> keys) {
  keys_ = std::move(keys);
  std::size_t slots = 16;
  while (slots < 2 * keys_.size()) slots *= 2;
  table_.assign(slots, -1);
  for (std::size_t b = 0; b < keys_.size(); ++b) {
    std::size_t slot = slot_of(keys_[b], slots - 1);
    while (table_[slot] >= 0) slot = (slot + 1) & (slots - 1);
    table_[slot] = static_cast<int>(b);
  }
  voxels_.assign(keys_.size() * kVoxels, Voxel{});
}

TangentMap tangent_map(const DepthMap& map, const geometry::Camera& camera,
                       const geometry::Rigid3& pose, const TangentOptions& options) {
  map.check();
  TangentMap result;
  result.camera = camera_of_map(camera, map.depth.size());
  result.pose = pose;
  result.planes = cv::Mat(map.depth.size(), CV_32FC4, cv::Scalar::all(0));
  result.weights = cv::Mat(map.depth.size(), CV_32FC1, cv::Scalar::all(0));
  const cv::Mat1b inner = inner_pixels(map.depth, options.trim_px);
  std::vector<float> depths;
  for (int y = 0; y < map.depth.rows; ++y) {
    const auto* depth = map.depth.ptr<float>(y);
    auto* planes = result.planes.ptr<cv::Vec4f>(y);
    auto* weights = result.weights.ptr<float>(y);
    for (int x = 0; x < map.depth.cols; ++x) {
      const auto z = static_cast<double>(depth[x]);
      if (inner(y, x) == 0 || !(z > 0 && std::isfinite(z))) continue;
      const Eigen::Vector3d ray((x - result.camera.cx) / result.camera.fx,
                                (y - result.camera.cy) / result.camera.fy, 1);
      Eigen::Vector3d normal = -ray.normalized();
      if (!map.normal.empty()) {
        const auto& n = map.normal.at<cv::Vec3f>(y, x);
        const Eigen::Vector3d given(n[0], n[1], n[2]);
        const double length = given.norm();
        if (!std::isfinite(length)) continue;
        if (length > 0.5) normal = given / length;
      }
      const double cosine = -normal.dot(ray) / ray.norm();
      const double confidence =
          map.confidence.empty() ? 1 : static_cast<double>(map.confidence.at<float>(y, x));
      if (!(cosine >= options.min_cosine && confidence > 0 && confidence <= 1)) continue;
      depths.push_back(depth[x]);
      planes[x] = {static_cast<float>(normal[0]), static_cast<float>(normal[1]),
                   static_cast<float>(normal[2]), static_cast<float>(normal.dot(z * ray))};
      weights[x] = static_cast<float>(confidence * cosine);
    }
  }
  if (!depths.empty()) {
    const auto median = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
    std::nth_element(depths.begin(), median, depths.end());
    result.footprint = static_cast<double>(*median) / std::max(result.camera.fx, result.camera.fy);
  }
  return result;
}

std::vector<VoxelVolume::Key> blocks_near(const TangentMap& map, double voxel, double reach) {
  TARSIER_REQUIRE(voxel > 0 && reach >= 1, "{}, {}", voxel, reach);
  const geometry::Rigid3 world = map.pose.inverse();
  const double per_unit = 1 / (voxel * VoxelVolume::kSide);
  const double truncation_factor = kTruncationPixels / (map.camera.fx * voxel);
  std::vector<VoxelVolume::Key> keys;
  std::size_t max_keys = 1 << 16;
  const auto remove_duplicates = [&] {
    std::sort(keys.begin(), keys.end());
    keys.erase(std::unique(keys.begin(), keys.end()), keys.end());
  };
  for (int y = 0; y < map.weights.rows; ++y) {
    const auto* weights = map.weights.ptr<float>(y);
    const auto* planes = map.planes.ptr<cv::Vec4f>(y);
    VoxelVolume::Index last_low(0, 0, 0);
    VoxelVolume::Index last_high(-1, -1, -1);
    for (int x = 0; x < map.weights.cols; ++x) {
      if (!(weights[x] > 0)) continue;
      const Eigen::Vector3d ray((x - map.camera.cx) / map.camera.fx,
                                (y - map.camera.cy) / map.camera.fy, 1);
      const cv::Vec4f& plane = planes[x];
      const Eigen::Vector3d normal(plane[0], plane[1], plane[2]);
      const double z = static_cast<double>(plane[3]) / normal.dot(ray);
      const Eigen::Vector3d block = (world * Eigen::Vector3d(z * ray)) * per_unit;
      const double block_reach =
          reach / VoxelVolume::kSide * std::clamp(z * truncation_factor, 1.0, kMaxTruncationFactor);
      if (!(block.cwiseAbs().maxCoeff() < VoxelVolume::kMaxBlock - block_reach - 1)) continue;
      VoxelVolume::Index low;
      VoxelVolume::Index high;
      for (int k = 0; k < 3; ++k) {
        low[k] = static_cast<int>(std::floor(block[k] - block_reach));
        high[k] = static_cast<int>(std::floor(block[k] + block_reach));
      }
      if (low == last_low && high == last_high) continue;
      last_low = low;
      last_high = high;
      for (int k = low[2]; k <= high[2]; ++k)
        for (int j = low[1]; j <= high[1]; ++j)
          for (int i = low[0]; i <= high[0]; ++i) keys.push_back(VoxelVolume::key_of({i, j, k}));
    }
    if (keys.size() > max_keys) {
      remove_duplicates();
      max_keys = std::max<std::size_t>(1 << 16, 2 * keys.size());
    }
  }
  remove_duplicates();
  return keys;
}

void integrate(VoxelVolume& volume, const TangentMap& map, const Integration& options) {
  if (!(map.footprint > 0)) return;
  VoxelView view{};
  view.rotation = (map.pose.rotation * volume.size()).cast<float>();
  view.translation = map.pose.translation.cast<float>();
  view.fx = static_cast<float>(map.camera.fx);
  view.fy = static_cast<float>(map.camera.fy);
  view.cx = static_cast<float>(map.camera.cx);
  view.cy = static_cast<float>(map.camera.cy);
  view.width = map.weights.cols;
  view.height = map.weights.rows;
  view.per_unit = static_cast<float>(1 / volume.size());
  view.truncation = static_cast<float>(options.truncation);
  view.per_depth =
      static_cast<float>(options.truncation * kTruncationPixels / (map.camera.fx * volume.size()));
  view.carving = static_cast<float>(options.carving);
  const double resolution_ratio = volume.size() / map.footprint;
  view.factor = static_cast<float>(std::clamp(resolution_ratio * resolution_ratio, 0.1, 4.0));
  const auto radius = static_cast<float>(volume.size() * 0.5 * VoxelVolume::kSide * std::sqrt(3.0));
  const Eigen::Vector3f step = view.rotation.col(0);
  cv::parallel_for_(cv::Range(0, volume.blocks()), [&](const cv::Range& range) {
    for (int b = range.start; b < range.end; ++b) {
      // Far from the origin, float would not be accurate enough in the world frame.
      const Eigen::Vector3d first =
          map.pose *
          Eigen::Vector3d(volume.index(b).cast<double>() * (VoxelVolume::kSide * volume.size()));
      const Eigen::Vector3f corner = first.cast<float>();
      const float half = 0.5F * (VoxelVolume::kSide - 1);
      if (!may_be_visible(view, corner + view.rotation * Eigen::Vector3f(half, half, half), radius))
        continue;
      Voxel* voxels = volume.voxels(b).data();
      for (int z = 0; z < VoxelVolume::kSide; ++z) {
        for (int y = 0; y < VoxelVolume::kSide; ++y) {
          const Eigen::Vector3f start = corner + view.rotation.col(1) * static_cast<float>(y) +
                                        view.rotation.col(2) * static_cast<float>(z);
          add_row(view, map, start, step,
                  voxels + VoxelVolume::kSide * (y + VoxelVolume::kSide * z));
        }
      }
    }
  });
}

}  // namespace tarsier::sfm
