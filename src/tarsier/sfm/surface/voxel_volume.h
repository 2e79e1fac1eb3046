// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/dense/depth_map.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

// A signed distance on a sparse grid, with blocks near surfaces only (Nießner, Zollhöfer, Izadi and
// Stamminger, "Real-time 3D reconstruction at scale using voxel hashing", TOG 2013).
namespace tarsier::sfm {

struct Voxel {
  // voxels, to the surface: > 0 in front of it, < 0 behind; limited by the truncation
  float distance = 0;
  float weight = 0;  // 0: not observed
};

// Blocks of 8 x 8 x 8 voxels, sorted by key. Voxel (x, y, z) is at `size() * (x, y, z)` in the
// world.
class VoxelVolume {
 public:
  static constexpr int kSide = 8;
  static constexpr int kVoxels = kSide * kSide * kSide;
  // max absolute coordinate of a block
  static constexpr int kMaxBlock = (1 << 20) - 2;
  using Index = Eigen::Vector3i;  // of a block
  using Key = std::uint64_t;

  explicit VoxelVolume(double size);  // world units, > 0

  [[nodiscard]] static Key key_of(const Index& block);
  [[nodiscard]] static Index index_of(Key key);

  [[nodiscard]] double size() const { return size_; }
  [[nodiscard]] int blocks() const { return static_cast<int>(keys_.size()); }
  [[nodiscard]] Index index(int block) const {
    return index_of(keys_[static_cast<std::size_t>(block)]);
  }
  [[nodiscard]] int find(const Index& block) const;  // -1: no such block
  // x varies fastest, then y.
  [[nodiscard]] std::span<const Voxel, kVoxels> voxels(int block) const {
    return std::span<const Voxel, kVoxels>(voxels_.data() + offset(block), kVoxels);
  }
  [[nodiscard]] std::span<Voxel, kVoxels> voxels(int block) {
    return std::span<Voxel, kVoxels>(voxels_.data() + offset(block), kVoxels);
  }

  // Creates empty blocks. `keys`: sorted, without duplicates.
  void allocate(std::vector<Key> keys);

 private:
  [[nodiscard]] static std::size_t offset(int block) {
    return static_cast<std::size_t>(block) * kVoxels;
  }

  double size_;
  std::vector<Key> keys_;
  std::vector<int> table_;  // open addressing; -1: free
  std::vector<Voxel> voxels_;
};

// A depth map in the form that integrate() needs: the tangent plane of the surface at each pixel.
struct TangentMap {
  geometry::Camera camera;  // of the map
  geometry::Rigid3 pose;    // camera_from_world
  cv::Mat planes;   // CV_32FC4: unit normal pointing to the camera, normal . point; camera frame
  cv::Mat weights;  // CV_32FC1: confidence x cosine of the viewing angle; 0: unknown
  cv::Mat1b empty;  // 255 where the ray is known to be empty; may have no data
  double footprint = 0;  // world units, median size of a pixel on the surface; 0: no depth
};
struct TangentOptions {
  double min_cosine = 0.15;  // of the viewing angle
  int trim_px = 4;
};
// Leaves out pixels with a cosine below `min_cosine`, numbers that are not finite, and pixels
// within `trim_px` of unknown ones, except for specks narrower than 2 trim_px. Next to unknown
// areas (sky, a black background), matching assigns outer pixels of the surface to the background.
[[nodiscard]] TangentMap tangent_map(const DepthMap& map, const geometry::Camera& camera,
                                     const geometry::Rigid3& pose, const TangentOptions& options);

// Keys of the blocks within `reach` voxels (along each axis) of a pixel's surface, sorted, without
// duplicates.
[[nodiscard]] std::vector<VoxelVolume::Key> blocks_near(const TangentMap& map, double voxel,
                                                        double reach);

struct Integration {
  // Voxels, up to which a distance is measured. Where a pixel is larger than a voxel, it grows by
  // that factor, up to 4: distant surfaces are measured less accurately.
  double truncation = 4;
  double carving = 0.1;  // weight of free space
};
// Adds a map to the weighted mean of the distances (Curless and Levoy, "A volumetric method for
// building complex models from range images", SIGGRAPH 1996). The distance of a voxel is that to
// the plane of the pixel that sees it, so that slanted surfaces are as accurate as frontal ones.
// Its weight is that of the pixel times (voxel / footprint)^2, in 0.1..4. The weight falls to 0
// behind the surface and is small (`carving`) in free space, which removes single outliers and
// preserves surfaces. Blocks are processed in parallel; the result does not depend on the number of
// threads.
void integrate(VoxelVolume& volume, const TangentMap& map, const Integration& options);

}  // namespace tarsier::sfm
