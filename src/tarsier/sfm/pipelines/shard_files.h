// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/mapper/image_features.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/pipelines/plan.h"

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// What the shards of a reconstruction leave for each other: a packed file (sfm/mapper/packed_file.h) and beside it
// FILE.done, which is written last. Both are written whole or not at all. Readers throw InputError for what is
// missing, damaged or not of the plan.
namespace tarsier::sfm {

enum class ShardStage {
  kFeatures,  // of the images of a shard
  kPairs,     // of all images, where they are found by what images show
  kMatch,     // the pairs of a shard
  kModel,     // the models of a cluster; here the "shards" are clusters
};
[[nodiscard]] std::string_view name_of(ShardStage stage);

// "W/features-3-of-8", "W/model-3-of-8"; of pairs "W/pairs".
[[nodiscard]] std::string shard_path(const std::string& folder, ShardStage stage, int shard,
                                     int shards);

// Of `count` things in their order, those of a shard: from `first` up to `last`, which is not among them. Shares
// differ by at most one.
struct ShardRange {
  std::int64_t first = 0;
  std::int64_t last = 0;
  [[nodiscard]] std::int64_t size() const { return last - first; }
};
[[nodiscard]] ShardRange range_of_shard(std::int64_t count, int shard, int shards);

// FILE.done.
struct ShardInfo {
  ShardStage stage = ShardStage::kFeatures;
  int shard = 1;  // 1..shards
  int shards = 1;
  std::string plan;        // Plan::key
  std::string from;        // SHA-256 of the files that it was made of; "": of the images alone
  std::string sha256;      // PackedReader::sum() of the file
  std::int64_t count = 0;  // images or pairs in it; of a cluster the images that it was made of
  std::vector<std::pair<int, std::string>> left_out;  // inputs that could not be read, and why
};
void write_shard_info(const std::string& path, const ShardInfo& info);
[[nodiscard]] ShardInfo read_shard_info(const std::string& path);

// What was made of a cluster of images (sfm/global/view_graph_clusters.h).
struct ClusterModels {
  std::vector<int> images;               // among all that could be read, ascending
  std::vector<char> is_own;              // of each: 0 for one that is another cluster's own
  std::vector<int> cameras;              // of each: which of a model's cameras took it
  std::vector<std::string> reasons;      // of each: why it is in no model; or ""
  std::vector<PackedModel> models;       // largest first; their images are indices into `images`
  std::vector<ImagePair> refused;        // pairs that the mapper did not use, of all images
  [[nodiscard]] int registered() const;  // images in models
};

// The writers return the sum of the file.
std::string write_feature_shard(const std::string& path, std::span<const ImageFeatures> images);
[[nodiscard]] std::vector<ImageFeatures> read_feature_shard(const std::string& path,
                                                            const std::string& sum);
std::string write_image_pairs(const std::string& path, std::span<const ImagePair> pairs);
[[nodiscard]] std::vector<ImagePair> read_image_pairs(const std::string& path,
                                                      const std::string& sum);
std::string write_match_shard(const std::string& path, std::span<const Pair> pairs);
[[nodiscard]] std::vector<Pair> read_match_shard(const std::string& path, const std::string& sum);
std::string write_cluster_models(const std::string& path, const ClusterModels& cluster);
[[nodiscard]] ClusterModels read_cluster_models(const std::string& path, const std::string& sum);

}  // namespace tarsier::sfm
