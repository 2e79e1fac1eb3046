// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/shard_commands.h"

#include <fmt/format.h>

namespace tarsier::sfm {

std::string shell_word(std::string_view text) {
  constexpr std::string_view kPlain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-+=.,/:@%";
  if (!text.empty() && text.find_first_not_of(kPlain) == std::string_view::npos)
    return std::string(text);
  std::string word = "'";
  for (const char c : text) {
    if (c == '\'')
      word += "'\\''";
    else
      word += c;
  }
  return word + "'";
}

std::string shard_command(const std::string& folder, ShardStage stage, int shard, int shards) {
  const std::string word = shell_word(folder);
  if (stage == ShardStage::kPairs) return fmt::format("tarsier sfm match {} --pairs-only", word);
  if (stage == ShardStage::kModel)
    return fmt::format("tarsier sfm map {} --cluster {}/{}", word, shard, shards);
  return fmt::format("tarsier sfm {} {} --shard {}/{}", name_of(stage), word, shard, shards);
}

std::vector<std::string> parallel_commands(const ClusterJob& job) {
  const std::string program = shell_word(job.program);
  const std::string folder = shell_word(job.folder);
  const auto shards_of = [&](const char* verb) {
    return fmt::format("seq {0} | parallel -q {1} sfm {2} {3} --threads 1 --quiet --shard {{}}/{0}",
                       job.shards, program, verb, folder);
  };
  std::vector<std::string> lines{shards_of("features")};
  if (job.has_pairs_stage)
    lines.push_back(fmt::format("{} sfm match {} --pairs-only --quiet", program, folder));
  lines.push_back(shards_of("match"));
  if (job.clusters > 0)
    lines.push_back(
        fmt::format("seq {0} | parallel -q {1} sfm map {2} --threads 1 --quiet --cluster {{}}/{0}",
                    job.clusters, program, folder));
  lines.push_back(fmt::format("{} sfm {} {} -o {}", program, job.clusters > 0 ? "merge" : "map",
                              folder, shell_word(job.model)));
  return lines;
}

std::string slurm_script(const ClusterJob& job) {
  std::string text = fmt::format(
      R"(#!/bin/bash
# Written by `tarsier sfm plan --slurm`. `bash {0} [flags of sbatch ..]` submits all stages, each after the one before.
# If shards fail, the next stage lists them. Run `bash {0}` again to compute what is missing.
set -eu
tarsier={1}
work={2}
model={3}
shards={4}
clusters={5}
threads=${{SLURM_CPUS_PER_TASK:-1}}
case ${{1:-}} in
stage-features) exec "$tarsier" sfm features "$work" --shard "$SLURM_ARRAY_TASK_ID/$shards" --threads "$threads" --quiet ;;
stage-pairs) exec "$tarsier" sfm match "$work" --pairs-only --threads "$threads" --quiet ;;
stage-match) exec "$tarsier" sfm match "$work" --shard "$SLURM_ARRAY_TASK_ID/$shards" --threads "$threads" --quiet ;;
stage-map) exec "$tarsier" sfm map "$work" -o "$model" --threads "$threads" --quiet ;;
stage-clusters) exec "$tarsier" sfm map "$work" --cluster "$SLURM_ARRAY_TASK_ID/$clusters" --threads "$threads" --quiet ;;
stage-merge) exec "$tarsier" sfm merge "$work" -o "$model" --threads "$threads" --quiet ;;
esac
script=$work/sfm.sbatch
submit() {{ # submit STAGE [FLAGS ..]: prints the job ID
  stage=$1
  shift
  sbatch --parsable --job-name "sfm-$stage" --output "$work/slurm-$stage-%j.log" --requeue "$@" "$script" "stage-$stage"
}}
job=$(submit features --array "1-$shards" "$@")
)",
      shell_word(job.folder + "/sfm.sbatch"), shell_word(job.program), shell_word(job.folder),
      shell_word(job.model), job.shards, job.clusters);
  if (job.has_pairs_stage)
    text += "job=$(submit pairs --dependency \"afterany:${job%%;*}\" \"$@\")\n";
  text += "job=$(submit match --dependency \"afterany:${job%%;*}\" --array \"1-$shards\" \"$@\")\n";
  if (job.clusters > 0) {
    text +=
        "job=$(submit clusters --dependency \"afterany:${job%%;*}\" --array \"1-$clusters\" "
        "\"$@\")\n"
        "job=$(submit merge --dependency \"afterany:${job%%;*}\" \"$@\")\n";
  } else {
    text += "job=$(submit map --dependency \"afterany:${job%%;*}\" \"$@\")\n";
  }
  text += "echo \"job ${job%%;*} writes the model $model\"\n";
  return text;
}

}  // namespace tarsier::sfm
