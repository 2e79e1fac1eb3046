// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/shard_files.h"

#include <string>
#include <string_view>
#include <vector>

// The command lines that process the shards of a plan.
namespace tarsier::sfm {

// The text as one shell word: unchanged, or in single quotes.
[[nodiscard]] std::string shell_word(std::string_view text);

// The command that makes one shard: "tarsier sfm features W --shard 3/8", or for a cluster "tarsier
// sfm map W --cluster 3/8".
[[nodiscard]] std::string shard_command(const std::string& folder, ShardStage stage, int shard,
                                        int shards);

struct ClusterJob {
  std::string program = "tarsier";  // name of the program on the nodes
  std::string folder;               // folder of the plan
  std::string model;                // folder of the model
  int shards = 1;
  bool has_pairs_stage = false;
  int clusters = 0;  // 0: all images are mapped together
};

// Commands for GNU parallel, one line per stage: features, pairs (where they are a stage), match,
// map. With clusters, the last stage is replaced by the map of each cluster and merge.
[[nodiscard]] std::vector<std::string> parallel_commands(const ClusterJob& job);

// A bash script that submits itself to Slurm: an array job for features, then pairs, an array job
// for match, then map (with clusters: an array job for map, then merge). Each stage starts after
// the end of the previous one (afterany: a lost node must not block the others, and each stage
// reports missing shards). The script's arguments are passed to each sbatch.
[[nodiscard]] std::string slurm_script(const ClusterJob& job);

}  // namespace tarsier::sfm
