// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/shard_files.h"

#include <string>
#include <string_view>
#include <vector>

// The command lines that work through the shards of a plan.
namespace tarsier::sfm {

// The text as one word of a shell: as it is, or in single quotes.
[[nodiscard]] std::string shell_word(std::string_view text);

// The command that makes one shard: "tarsier sfm features W --shard 3/8"; of a cluster "tarsier sfm map W --cluster 3/8".
[[nodiscard]] std::string shard_command(const std::string& folder, ShardStage stage, int shard,
                                        int shards);

struct ClusterJob {
  std::string program = "tarsier";  // as the nodes find it
  std::string folder;               // of the plan
  std::string model;                // folder for the model
  int shards = 1;
  bool has_pairs_stage = false;
  int clusters = 0;  // 0: all images are mapped together
};

// One line each: features, pairs where they are a stage, match, map; or, with clusters, map of each and merge. With GNU
// parallel.
[[nodiscard]] std::vector<std::string> parallel_commands(const ClusterJob& job);

// A script for bash that submits itself to Slurm: an array of features, then pairs, an array of matches, and the
// map (with clusters an array of them and the merge), each after the end of the one before (afterany: a lost node must not hold up the others, and each stage says
// which shards are missing). Its words go to each sbatch.
[[nodiscard]] std::string slurm_script(const ClusterJob& job);

}  // namespace tarsier::sfm
