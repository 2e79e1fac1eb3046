// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/pipelines/pipeline.h"
#include "tarsier/sfm/pipelines/placement.h"

#include <Eigen/Core>

#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// The plan of a sharded reconstruction, which all shards share wherever they run: the images with
// their checksums, the options, and the number of shards.
namespace tarsier::sfm {

constexpr int kMaxShards = 100'000;
constexpr int kMinClusterSize = 4;

struct PlannedImage {
  std::string name;    // name in the model
  std::string path;    // of the file: the folder of the plan and a path relative to it
  std::string sha256;  // of the file's bytes; "" where it could not be read
  std::optional<Eigen::Vector3d> place = std::nullopt;  // as in Input
};

struct Plan {
  std::vector<PlannedImage> images;
  // Without what belongs to a single run: cache_folder, memory_gb and checkpoint_s. With kList,
  // pairs_file is a copy in the folder of the plan. Databases and optical flow are not supported.
  PipelineOptions options;
  int shards = 1;  // 1..kMaxShards
  // Max number of a cluster's own images, where clusters are mapped separately. 0 maps all images
  // together.
  int cluster_size = 0;
  std::string key;    // SHA-256 of the plan's file
  std::string pairs;  // SHA-256 of the list of pairs; empty where there is no list

  [[nodiscard]] std::vector<Input> inputs() const;
  // Number of clusters that hold all images; 0 where all images are mapped together.
  [[nodiscard]] int clusters() const;
};

// Writes plan.json, and pairs.txt with kList, to `folder`. The same images and options give the
// same bytes. `cluster_size` is 0, or at least kMinClusterSize and large enough for at most
// kMaxShards clusters. Where retrieval chooses the pairs, camera positions guide it: `known`, or
// those of EXIF (with_camera_positions()). An image that cannot be read is no error: it is left
// out. Throws std::invalid_argument (options, shards, cluster_size, a database, optical flow),
// InputError (fewer than two images, a name or path that a file cannot hold, a list of pairs with
// other names), OutputError, Interrupted.
Plan write_plan(const std::string& folder, const std::vector<Input>& inputs,
                const PipelineOptions& options, int shards, Progress& progress,
                const std::stop_token& stop, int cluster_size = 0, const Positions& known = {});

// Reads the plan and checks all that can be checked without the images. Throws InputError.
[[nodiscard]] Plan read_plan(const std::string& folder);

}  // namespace tarsier::sfm
