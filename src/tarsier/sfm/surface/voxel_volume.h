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

// A signed distance on a grid of which only the blocks near surfaces are kept (Nießner, Zollhöfer,
// Izadi and Stamminger, "Real-time 3D reconstruction at scale using voxel hashing", TOG 2013).
namespace tarsier::sfm {

struct Voxel {
  float distance =
      0;  // voxels, to the surface: > 0 in front of it, < 0 behind; the truncation at most
  float weight = 0;  // 0: nothing saw it
};

// Blocks of 8 x 8 x 8 voxels, in the order of their keys. Voxel (x, y, z) is at
// `size() * (x, y, z)` in the world.
class VoxelVolume {
 public:
  static constexpr int kSide = 8;
  static constexpr int kVoxels = kSide * kSide * kSide;
  static constexpr int kMaxBlock =
      (1 << 20) - 2;              // of the coordinates of a block, either side of 0
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
  [[nodiscard]] int find(const Index& block) const;  // -1: there is none
  // x runs fastest, then y.
  [[nodiscard]] std::span<const Voxel, kVoxels> voxels(int block) const {
    return std::span<const Voxel, kVoxels>(voxels_.data() + offset(block), kVoxels);
  }
  [[nodiscard]] std::span<Voxel, kVoxels> voxels(int block) {
    return std::span<Voxel, kVoxels>(voxels_.data() + offset(block), kVoxels);
  }

  // All blocks, empty. `keys`: sorted, each once.
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

// A depth map as fuse() needs it: of each pixel the plane that touches the surface there.
struct TangentMap {
  geometry::Camera camera;  // of the map
  geometry::Rigid3 pose;    // camera_from_world
  cv::Mat planes;        // CV_32FC4: unit normal towards the camera, normal . point; camera frame
  cv::Mat weights;       // CV_32FC1: confidence x cosine of the angle of view; 0: nothing is known
  cv::Mat1b empty;       // 255 where nothing is along the ray; or no matrix: nothing is known of it
  double footprint = 0;  // world units, that a pixel is wide on what it sees: median; 0: no depth
};
struct TangentOptions {
  double min_cosine = 0.15;  // of the angle of view
  int trim_px = 4;
};
// Leaves out what is seen under a smaller cosine than `min_cosine`, numbers that are not finite, and
// pixels within `trim_px` of unknown ones, specks narrower than 2 trim_px excepted: where nothing is known beside
// a surface (sky, a black background), matching gives its outermost pixels to the background.
[[nodiscard]] TangentMap tangent_map(const DepthMap& map, const geometry::Camera& camera,
                                     const geometry::Rigid3& pose, const TangentOptions& options);

// Keys of the blocks within `reach` voxels (along each axis) of a pixel's surface: sorted, each once.
[[nodiscard]] std::vector<VoxelVolume::Key> blocks_near(const TangentMap& map, double voxel,
                                                        double reach);

struct Integration {
  // Voxels, that a distance is followed to; where a pixel is wider than a voxel, that many times
  // more, up to 4 times: far surfaces are measured less exactly.
  double truncation = 4;
  double carving = 0.1;  // weight of free space
};
// Adds a map to the weighted mean of the distances (Curless and Levoy, "A volumetric method for
// building complex models from range images", SIGGRAPH 1996). The distance of a voxel is that to
// the plane of the pixel that sees it, so that slanted surfaces are measured as well as frontal
// ones. Its weight is that of the pixel times (voxel / footprint)^2, in 0.1..4; it falls to 0 behind the
// surface, and is small (`carving`) in free space, which removes single outliers and spares
// surfaces. Blocks in parallel; the same for any number of threads.
void integrate(VoxelVolume& volume, const TangentMap& map, const Integration& options);

}  // namespace tarsier::sfm
