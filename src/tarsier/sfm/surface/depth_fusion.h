// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/voxel_volume.h"

#include <stop_token>

namespace tarsier::sfm {

struct VolumeOptions {
  // Side of a voxel, world units; 0: 1.5 times the size of a depth map's pixel on the surface.
  double voxel = 0;
  double truncation = 4;     // voxels, up to which a distance is measured
  double min_cosine = 0.15;  // between a pixel's ray and its normal
  int trim_px = 4;           // px of a depth map that are left out next to unknown pixels
  double carving = 0.1;      // weight of free space, relative to a surface's
  int dark_level = 24;   // max grey level of a dark background (dark_background.h); 0 disables it
  double memory_gb = 2;  // for the volume and its surface

  [[nodiscard]] OptionFields fields() {
    return {
        {"voxel", voxel, at_least(0), "--voxel",
         "voxel size, world units; 0: 1.5 pixels of the depth maps"},
        {"truncation", truncation, range(2, 16)},
        {"min_cosine", min_cosine, range(0, 0.9)},
        {"trim_px", trim_px, range(0, 100), "--trim",
         "px of each depth map removed next to unknown depth"},
        {"carving", carving, range(0, 1)},
        {"dark_level", dark_level, range(0, 255), "--dark-level",
         "maximum grey level of a dark background, taken as empty space; 0: no such background"},
        {"memory_gb", memory_gb, range(0.01, 1024)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

struct FusedVolume {
  VoxelVolume volume{1};
  int views = 0;          // views with depth
  int views_without = 0;  // views without a depth map or without usable depths
  bool coarser = false;   // voxels are larger than requested, because of the memory limit
};

// Fuses the depth maps of a workspace to a signed distance volume. Depth maps are read one by one,
// twice, or three times to determine the voxel size. Throws InputError: no view has a depth map,
// none has usable depths, a broken file; UsageError where voxels of the requested size exceed the
// memory limit (without a requested size they become larger); Interrupted.
[[nodiscard]] FusedVolume fuse_depth_maps(const Workspace& workspace, const VolumeOptions& options,
                                          Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
