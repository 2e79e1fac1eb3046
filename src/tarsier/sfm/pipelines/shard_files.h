// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/checkpoint.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/pipelines/plan.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// The files through which the shards of a reconstruction exchange results: a packed file
// (sfm/mapper/packed_file.h) and FILE.done beside it, which is written last. Each is written
// completely or not at all. Readers throw InputError for a file that is missing, damaged or of
// another plan.
namespace tarsier::sfm {

enum class ShardStage {
  kFeatures,  // features of the images of a shard
  kPairs,     // pairs of all images, where pairs are found by image retrieval
  kMatch,     // matches of the pairs of a shard
  kModel,     // models of a cluster; the "shards" of this stage are clusters
};
[[nodiscard]] std::string_view name_of(ShardStage stage);

// "W/features-3-of-8", "W/model-3-of-8"; for pairs "W/pairs".
[[nodiscard]] std::string shard_path(const std::string& folder, ShardStage stage, int shard,
                                     int shards);

// The part [first, last) of `count` ordered items that belongs to a shard. Sizes of shards differ
// by at most one.
struct ShardRange {
  std::int64_t first = 0;
  std::int64_t last = 0;
  [[nodiscard]] std::int64_t size() const { return last - first; }
};
[[nodiscard]] ShardRange range_of_shard(std::int64_t count, int shard, int shards);

// The content of FILE.done.
struct ShardInfo {
  ShardStage stage = ShardStage::kFeatures;
  int shard = 1;  // 1..shards
  int shards = 1;
  std::string plan;  // Plan::key
  std::string from;  // SHA-256 of the files it was made from; "" where it was made from images only
  std::string sha256;      // PackedReader::sum() of the file
  std::int64_t count = 0;  // images or pairs in the file; for a cluster its input images
  // inputs that could not be read, with the reason
  std::vector<std::pair<int, std::string>> left_out;
};
void write_shard_info(const std::string& path, const ShardInfo& info);
[[nodiscard]] ShardInfo read_shard_info(const std::string& path);

// The models of one cluster of images (sfm/global/view_graph_clusters.h).
struct ClusterModels {
  std::vector<int> images;           // indices among all readable images, ascending
  std::vector<char> is_own;          // per image: 0 where it is another cluster's own image
  std::vector<int> cameras;          // per image: index of its camera in the models
  std::vector<std::string> reasons;  // per image: why it is in no model; or ""
  std::vector<PackedModel> models;   // largest first; their images are indices into `images`
  // pairs that the mapper rejected; indices among all readable images
  std::vector<ImagePair> rejected_pairs;
  [[nodiscard]] int registered() const;  // number of images in models
};

// The writers return the SHA-256 of the file.
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
