// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/global/view_graph_clusters.h"
#include "tarsier/sfm/joining/joined_mapper.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/sfm/pipelines/shard_folder.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// One reconstruction by many runs, on one machine or on several that share a folder. Each shard
// writes a file and a .done file to the folder of the plan (shard_files.h). map() makes the model
// from them. It is identical, byte by byte, to the model that Reconstructor makes of the same
// images with the same options. This holds for any number of shards and threads, as long as all
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
// A plan with a cluster size can be mapped by clusters instead (sfm/global/view_graph_clusters.h).
// Each cluster is mapped by its own run, in the memory of one cluster. merge() joins their models
// into one (sfm/joining/joined_mapper.h). That model is similar to the one of map(), but not
// identical.
//
//   for (int k = 1; k <= sharded.plan().clusters(); ++k) sharded.map_cluster(k, result, progress, {});
//   sharded.merge(result, progress, {});
//
// The class is const: any number of runs may use one folder. A completed shard is not computed
// again. An interrupted one starts from its beginning. All functions throw InputError for a file
// that is missing, damaged or of another plan (the error names the command that makes it),
// OutputError, Interrupted.
class ShardedReconstructor {
 public:
  // Throws InputError (plan).
  explicit ShardedReconstructor(std::string folder);

  [[nodiscard]] const Plan& plan() const { return shards_.plan(); }
  // Whether pairs are found by image retrieval. Then choosing them is a stage after all features
  // and before all matches.
  [[nodiscard]] bool has_pairs_stage() const;

  // Shards are 1..plan().shards. Holds the features of the shard in memory. Throws InputError also
  // for an image that changed after planning.
  ShardReport find_features(int shard, Progress& progress, const std::stop_token& stop) const;
  // Chooses the pairs of all images, unless that is done already. Holds the features of one shard
  // in memory. match() calls it where the pairs are missing; shards that start together would each
  // do it.
  ShardReport choose_pairs(Progress& progress, const std::stop_token& stop) const;
  // Holds in memory the features of the images in its pairs, and those of one more shard.
  ShardReport match(int shard, Progress& progress, const std::stop_token& stop) const;

  // Of `options`, only what the plan does not determine is used: the folder, the files to write,
  // scale and place, and the pipeline's cache_folder, memory_gb and checkpoint_s. Throws what
  // Reconstructor throws.
  [[nodiscard]] ReconstructorResult map(const ReconstructorOptions& options, Progress& progress,
                                        const std::stop_token& stop,
                                        const ReconstructorHooks& hooks = {}) const;

  // Clusters are 1..plan().clusters(). Holds the features of one cluster's images in memory. Each
  // run computes the assignment of images to clusters itself, from all matches. Of `options`, only
  // what belongs to one run is used: cache (checkpoints are kept in W/cache, or in the pipeline's
  // cache_folder), memory_gb and checkpoint_s.
  ShardReport map_cluster(int cluster, const ReconstructorOptions& options, Progress& progress,
                          const std::stop_token& stop) const;
  // Joins the models of all clusters into one, or into several where joining is refused. `options`
  // are as for map(). Holds the positions of all features and all matches in memory, as map() does.
  [[nodiscard]] ReconstructorResult merge(const ReconstructorOptions& options, Progress& progress,
                                          const std::stop_token& stop,
                                          const ReconstructorHooks& hooks = {}) const;

 private:
  // Adds features and matches of all shards.
  void load(MatchedImages& matched, const ReadableImages& readable,
            const std::vector<ImagePair>& pairs, const std::vector<ShardInfo>& matches,
            Progress& progress, const std::stop_token& stop) const;
  // The clusters of all readable images.
  [[nodiscard]] std::vector<ViewCluster> find_clusters(const ReadableImages& readable,
                                                       const std::vector<ImagePair>& pairs,
                                                       const std::vector<ShardInfo>& matches,
                                                       Progress& progress,
                                                       const std::stop_token& stop) const;
  // Adds those of a cluster's images only.
  void load_cluster(MatchedImages& matched, const ReadableImages& readable,
                    const std::vector<int>& images, const std::vector<ImagePair>& pairs,
                    const std::vector<ShardInfo>& matches, const std::stop_token& stop) const;
  [[nodiscard]] MappedParts load_parts(const std::vector<ShardInfo>& infos,
                                       const MapperInput& input) const;
  [[nodiscard]] ReconstructorOptions planned(const ReconstructorOptions& options) const;

  ShardFolder shards_;
};

}  // namespace tarsier::sfm
