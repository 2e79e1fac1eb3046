// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/voxel_volume.h"

#include <stop_token>

namespace tarsier::sfm {

struct VolumeOptions {
  // World units, side of a voxel; 0: 1.5 times the width of a depth map's pixel on what it sees.
  double voxel = 0;
  double truncation = 4;     // voxels, that a distance is followed to
  double min_cosine = 0.15;  // of the angle between a pixel's ray and its normal
  int trim_px = 4;           // px of a depth map that are left out next to what is unknown in it
  double carving = 0.1;      // weight of free space; that of a surface: 1
  int dark_level = 24;   // grey level of a dark background (dark_background.h); 0: there is none
  double memory_gb = 2;  // of the volume and the surface in it

  [[nodiscard]] OptionFields fields() {
    return {{"voxel", voxel, at_least(0), "--voxel",
             "world units, side of a voxel; 0: 1.5 pixels of the depth maps"},
            {"truncation", truncation, range(2, 16)},
            {"min_cosine", min_cosine, range(0, 0.9)},
            {"trim_px", trim_px, range(0, 100), "--trim",
             "px of a depth map, left out next to what is unknown in it"},
            {"carving", carving, range(0, 1)},
            {"dark_level", dark_level, range(0, 255), "--dark-level",
             "grey level up to which a background is empty; 0: none is"},
            {"memory_gb", memory_gb, range(0.01, 1024)}};
  }
  void check() const { check_fields(*this); }  // throws std::invalid_argument
};

struct FusedVolume {
  VoxelVolume volume{1};
  int views = 0;          // with depth
  int views_without = 0;  // without a depth map, or without a usable depth in it
  bool coarser = false;   // than VolumeOptions asks for, because of the memory
};

// The signed distance to the surface that the depth maps of a workspace show. Depth maps are read
// one by one, twice or, to find the size of a voxel, three times. Throws InputError: no view has a
// depth map, none a usable depth, a broken file; UsageError where a voxel of the asked size
// needs more memory than there may be (without such a size they become larger); Interrupted.
[[nodiscard]] FusedVolume fuse_depth_maps(const Workspace& workspace, const VolumeOptions& options,
                                          Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
