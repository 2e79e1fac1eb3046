// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/pipeline.h"

#include <Eigen/Core>

#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// What the shards of one reconstruction agree on, wherever they run: the images with their sums, the options,
// and how many shards there are.
namespace tarsier::sfm {

constexpr int kMaxShards = 100'000;
constexpr int kMinClusterSize = 4;

struct PlannedImage {
  std::string name;    // in the model
  std::string path;    // of the file, as the folder of the plan is named
  std::string sha256;  // of its bytes; "": it could not be read
  std::optional<Eigen::Vector3d> place = std::nullopt;  // as Input has it
};

struct Plan {
  std::vector<PlannedImage> images;
  // Without what belongs to one run: cache_folder, memory_gb and checkpoint_s. Of kList, pairs_file is a copy in the folder
  // of the plan. There is no database, and no points are followed.
  PipelineOptions options;
  int shards = 1;  // 1..kMaxShards
  // Own images of a cluster that is mapped apart, at most; 0: all images are mapped together.
  int cluster_size = 0;
  std::string key;    // SHA-256 of the file of the plan
  std::string pairs;  // SHA-256 of the list of pairs; empty: no list

  [[nodiscard]] std::vector<Input> inputs() const;
  // As many as hold all images; 0 where they are mapped together.
  [[nodiscard]] int clusters() const;
};

// Writes plan.json, and of kList pairs.txt, to `folder`. The same images and options give the same bytes. `cluster_size`:
// 0, or kMinClusterSize and more, so that there are at most kMaxShards. Throws
// std::invalid_argument (options, shards, cluster_size; a database; points that are followed), InputError (fewer than two
// images, a name or path that no file can hold, a list of pairs with other names), OutputError, Interrupted. An
// image that cannot be read is no error: it is left out.
Plan write_plan(const std::string& folder, const std::vector<Input>& inputs,
                const PipelineOptions& options, int shards, Progress& progress,
                const std::stop_token& stop, int cluster_size = 0);

// Checks all that can be checked without the images. Throws InputError.
[[nodiscard]] Plan read_plan(const std::string& folder);

}  // namespace tarsier::sfm
