// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/depth_fusion.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/surface/dark_background.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <iterator>
#include <optional>

namespace tarsier::sfm {
namespace {

constexpr double kVoxelPixels = 1.5;       // side of a voxel in px of a depth map
constexpr double kVoxelGrowth = 1.25;      // growth of the voxel per attempt
constexpr double kBytesPerBlock = 12'000;  // its voxels, crossings, and its part of the surface
// px at the edge of a dark background that do not count as free space
constexpr int kUncertainEdge_px = 2;
// of the truncation: distance from depths within which blocks are kept
constexpr double kBlockReach = 0.6;

TangentMap read_planes(const Workspace& workspace, int view, const VolumeOptions& options) {
  DepthMap map = workspace.read_depth_map(view);
  cv::Mat1b empty = dark_background(workspace, view, options.dark_level);
  if (!empty.empty()) map.depth.setTo(0, empty);
  TangentMap result = tangent_map(map, workspace.camera(view), workspace.pose(view),
                                  {options.min_cosine, options.trim_px});
  if (!empty.empty()) {
    cv::erode(empty, empty, cv::Mat(), {-1, -1}, kUncertainEdge_px);
    result.empty = empty;
  }
  return result;
}

// Views with a usable depth, and the median size of their pixels on the surface.
struct Views {
  std::vector<int> list;
  double footprint = 0;
};

Views usable_views(const Workspace& workspace, const VolumeOptions& options, Progress& progress,
                   const std::stop_token& stop) {
  Views views;
  std::vector<double> footprints;
  int maps = 0;
  progress.begin("depth maps", workspace.count(), "images");
  for (int i = 0; i < workspace.count(); ++i) {
    throw_if_stopped(stop);
    progress.advance();
    if (!workspace.has_depth_map(i)) continue;
    ++maps;
    const TangentMap planes = read_planes(workspace, i, options);
    if (!(planes.footprint > 0)) continue;
    views.list.push_back(i);
    footprints.push_back(planes.footprint);
  }
  progress.end();
  if (maps == 0)
    throw InputError(
        workspace.folder(),
        "has no depth maps (stereo/depth_maps/*.geometric.bin): run tarsier sfm dense");
  if (views.list.empty())
    throw InputError(workspace.folder(), "no depth map contains a depth: there is no surface");
  std::nth_element(footprints.begin(),
                   footprints.begin() + static_cast<std::ptrdiff_t>(footprints.size() / 2),
                   footprints.end());
  views.footprint = footprints[footprints.size() / 2];
  return views;
}

// For all views; empty where there are more than `limit`.
std::optional<std::vector<VoxelVolume::Key>> blocks_of(const Workspace& workspace,
                                                       const std::vector<int>& views, double voxel,
                                                       std::size_t limit,
                                                       const VolumeOptions& options,
                                                       const std::stop_token& stop) {
  std::vector<VoxelVolume::Key> all;
  for (const int view : views) {
    throw_if_stopped(stop);
    const auto blocks = blocks_near(read_planes(workspace, view, options), voxel,
                                    std::max(1.0, kBlockReach * options.truncation));
    std::vector<VoxelVolume::Key> merged;
    merged.reserve(all.size() + blocks.size());
    std::set_union(all.begin(), all.end(), blocks.begin(), blocks.end(),
                   std::back_inserter(merged));
    all = std::move(merged);
    if (all.size() > limit) return std::nullopt;
  }
  return all;
}

}  // namespace

FusedVolume fuse_depth_maps(const Workspace& workspace, const VolumeOptions& options,
                            Progress& progress, const std::stop_token& stop) {
  options.check();
  const Views views = usable_views(workspace, options, progress, stop);
  double voxel = options.voxel > 0 ? options.voxel : kVoxelPixels * views.footprint;
  const auto limit = static_cast<std::size_t>(options.memory_gb * 1e9 / kBytesPerBlock);
  FusedVolume result;
  result.views = static_cast<int>(views.list.size());
  result.views_without = workspace.count() - result.views;
  auto blocks = blocks_of(workspace, views.list, voxel, limit, options, stop);
  while (!blocks) {
    if (options.voxel > 0)
      throw UsageError(
          fmt::format("voxels of {:.4g} need more than {:.3g} GB of memory: set larger voxels "
                      "(option 'voxel') or a higher limit (option 'memory_gb')",
                      voxel, options.memory_gb));
    voxel *= kVoxelGrowth;
    result.coarser = true;
    blocks = blocks_of(workspace, views.list, voxel, limit, options, stop);
  }
  if (blocks->empty())
    throw InputError(
        workspace.folder(),
        fmt::format(
            "all depths are too large for voxels of {:.4g}: set larger voxels (option 'voxel')",
            voxel));
  result.volume = VoxelVolume(voxel);
  result.volume.allocate(std::move(*blocks));
  progress.begin("fuse", result.views, "images");
  for (const int view : views.list) {
    throw_if_stopped(stop);
    integrate(result.volume, read_planes(workspace, view, options),
              {options.truncation, options.carving});
    progress.advance();
  }
  progress.end();
  return result;
}

}  // namespace tarsier::sfm
