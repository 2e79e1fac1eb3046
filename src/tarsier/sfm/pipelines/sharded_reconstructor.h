// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/global/view_graph_clusters.h"
#include "tarsier/sfm/mapper/joined_mapper.h"
#include "tarsier/sfm/pipelines/plan.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/sfm/pipelines/shard_files.h"

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm {

// What one shard did.
struct ShardReport {
  ShardStage stage = ShardStage::kFeatures;
  int shard = 1;
  int shards = 1;
  std::int64_t count = 0;  // images with features, or pairs; of a cluster its images
  int left_out = 0;        // images that cannot be read
  int own = 0;             // of a cluster: images that others have as shared ones only
  int registered = 0;      // .. that are in models
  int models = 0;          // .. of which there are so many
  bool was_done = false;   // by an earlier run: nothing was left to do
  std::string path;        // of the file
};
// {"stage", "shard": [i, N], "images" or "pairs", "left_out", "was_done", "output"}; of a cluster {"stage", "cluster":
// [i, N], "images", "own", "registered", "models", "was_done", "output"}.
[[nodiscard]] nlohmann::ordered_json to_json(const ShardReport& report);

// One reconstruction by many runs, on one machine or on several that see the same folder. Each shard leaves a file
// and a .done in the folder of the plan (shard_files.h), and map() makes of them the model that Reconstructor makes
// of the same images with the same options, to the byte: for any number of shards and threads, as long as all
// machines choose the same vector instructions (core/cpu.h).
//
//   NoProgress progress;
//   sfm::write_plan("work", images, options, 2, progress, {});
//   const sfm::ShardedReconstructor sharded("work");
//   for (int shard = 1; shard <= 2; ++shard) sharded.find_features(shard, progress, {});
//   for (int shard = 1; shard <= 2; ++shard) sharded.match(shard, progress, {});
//   sfm::ReconstructorOptions result;
//   result.folder = "model";
//   sharded.map(result, progress, {});
//
// A plan with a cluster size can be mapped by clusters instead (sfm/global/view_graph_clusters.h), each by a run of its own,
// in the memory of one cluster; merge() makes one model of theirs (sfm/mapper/joined_mapper.h). It is near to that of map(),
// but not the same.
//
//   for (int k = 1; k <= sharded.plan().clusters(); ++k) sharded.map_cluster(k, result, progress, {});
//   sharded.merge(result, progress, {});
//
// Const: any number of runs may use one folder. A shard that is done is left alone; one that was stopped or killed
// begins again. All throw InputError for a file that is missing, damaged, or of another plan (it names the command
// that makes it), OutputError, and Interrupted.
class ShardedReconstructor {
 public:
  // Throws InputError (plan).
  explicit ShardedReconstructor(std::string folder);

  [[nodiscard]] const Plan& plan() const { return plan_; }
  // Whether the pairs are found by what images show: they come after all features and before any match.
  [[nodiscard]] bool has_pairs_stage() const;

  // Shards are 1..plan().shards. Holds the features of the shard in memory. Throws InputError also for an image that
  // is not as it was planned.
  ShardReport find_features(int shard, Progress& progress, const std::stop_token& stop) const;
  // The pairs of all images, unless they are there. Holds the features of one shard in memory. match() does it where
  // it is missing; shards that begin together would each do it.
  ShardReport choose_pairs(Progress& progress, const std::stop_token& stop) const;
  // Holds the features of the images of its pairs and of one more shard in memory.
  ShardReport match(int shard, Progress& progress, const std::stop_token& stop) const;

  // Of `options`, what is not planned counts: the folder, what is written, scale and place, and of the pipeline
  // cache_folder, memory_gb and checkpoint_s. Throws what Reconstructor throws.
  [[nodiscard]] ReconstructorResult map(const ReconstructorOptions& options, Progress& progress,
                                        const std::stop_token& stop,
                                        const ReconstructorHooks& hooks = {}) const;

  // Clusters are 1..plan().clusters(). Holds the features of the images of one in memory. Which image is in which follows
  // from all matches, so that each run finds it by itself. Of `options` what belongs to one run counts: cache (checkpoints
  // are kept in W/cache, or in the pipeline's cache_folder), memory_gb and checkpoint_s.
  ShardReport map_cluster(int cluster, const ReconstructorOptions& options, Progress& progress,
                          const std::stop_token& stop) const;
  // One model of those of all clusters, or several where joining is refused. `options` as of map(). Holds the places of all
  // features and all matches in memory, as map() does.
  [[nodiscard]] ReconstructorResult merge(const ReconstructorOptions& options, Progress& progress,
                                          const std::stop_token& stop,
                                          const ReconstructorHooks& hooks = {}) const;

 private:
  class Readable;  // the images that could be read, and where their features are

  [[nodiscard]] int count_of(ShardStage stage) const;  // shards or clusters
  [[nodiscard]] std::string path_of(ShardStage stage, int shard) const;
  [[nodiscard]] std::string command_of(ShardStage stage, int shard) const;
  [[nodiscard]] bool is_done(ShardStage stage, int shard, const std::string& from,
                             ShardReport& report) const;
  [[nodiscard]] ShardReport finish(ShardInfo info) const;
  [[nodiscard]] ShardInfo require(ShardStage stage, int shard, const std::string& from) const;
  [[nodiscard]] std::vector<ShardInfo> require_all(ShardStage stage, const std::string& from) const;
  [[nodiscard]] std::vector<ImageFeatures> load_features(const ShardInfo& info) const;
  // All pairs, and the sum of what they and the matches depend on.
  [[nodiscard]] std::pair<std::vector<ImagePair>, std::string> pairs_of(
      const Readable& readable) const;
  void load(MatchedImages& matched, const Readable& readable, const std::vector<ImagePair>& pairs,
            const std::vector<ShardInfo>& matches, Progress& progress,
            const std::stop_token& stop) const;

  // Matches of a shard, checked against its pairs.
  [[nodiscard]] std::vector<Pair> load_matches(const ShardInfo& info,
                                               const std::vector<ImagePair>& pairs) const;
  // The clusters of all images that could be read.
  [[nodiscard]] std::vector<ViewCluster> find_clusters(const Readable& readable,
                                                       const std::vector<ImagePair>& pairs,
                                                       const std::vector<ShardInfo>& matches,
                                                       Progress& progress,
                                                       const std::stop_token& stop) const;
  void load_cluster(MatchedImages& matched, const Readable& readable,
                    const std::vector<int>& images, const std::vector<ImagePair>& pairs,
                    const std::vector<ShardInfo>& matches, const std::stop_token& stop) const;
  [[nodiscard]] MappedParts load_parts(const std::vector<ShardInfo>& infos,
                                       const MapperInput& input) const;
  [[nodiscard]] ReconstructorOptions planned(const ReconstructorOptions& options) const;

  std::string folder_;
  Plan plan_;
};

}  // namespace tarsier::sfm
