// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/pipelines/plan.h"
#include "tarsier/sfm/pipelines/shard_files.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

// The folder of a plan with the files of its shards: which are complete and belong together, and
// their checked contents.
namespace tarsier::sfm {

// The result of processing one shard.
struct ShardReport {
  ShardStage stage = ShardStage::kFeatures;
  int shard = 1;
  int shards = 1;
  std::int64_t count = 0;  // images with features, or pairs; for a cluster its images
  int left_out = 0;        // images that could not be read
  int own = 0;            // only of a cluster: its own images, without those shared from neighbours
  int registered = 0;     // only of a cluster: images in models
  int models = 0;         // only of a cluster: number of models
  bool was_done = false;  // an earlier run had completed the shard
  std::string path;       // path of the file
};
// {"stage", "shard": [i, N], "images" or "pairs", "left_out", "was_done", "output"}; for a cluster
// {"stage", "cluster": [i, N], "images", "own", "registered", "models", "was_done", "output"}.
[[nodiscard]] nlohmann::ordered_json to_json(const ShardReport& report);
// Sets what is known of a cluster.
void describe(const ClusterModels& cluster, ShardReport& report);

// The images whose features were found, in the order of the plan. Image indices are those among
// them.
class ReadableImages {
 public:
  // `features`: all feature shards of the plan.
  ReadableImages(const Plan& plan, std::vector<ShardInfo> features);

  [[nodiscard]] int count() const { return static_cast<int>(names_.size()); }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] const KnownPositions& places() const { return places_; }
  [[nodiscard]] const std::vector<ShardInfo>& infos() const { return infos_; }
  [[nodiscard]] const std::string& key() const { return key_; }  // checksum of all features
  // The index of an image in the plan.
  [[nodiscard]] int input_of(int image) const;
  // The index of the first image of infos()[shard].
  [[nodiscard]] int first_of(std::size_t shard) const { return first_[shard]; }
  [[nodiscard]] std::size_t shard_of(int image) const;

 private:
  std::vector<ShardInfo> infos_;
  std::vector<std::string> names_;
  std::vector<int> inputs_;
  KnownPositions places_;
  std::vector<int> first_;
  std::string key_;
};

// The pairs to match, and the checksum of what pairs and matches depend on.
struct PlannedPairs {
  std::vector<ImagePair> pairs;
  std::string key;
};

// Shards are 1..count_of(stage). `from`: checksum of what a file was made from (ShardInfo::from).
// The functions that read throw Error (kInput) for a file that is missing, damaged, or of another
// plan; the error names the command that makes it.
class ShardFolder {
 public:
  explicit ShardFolder(std::string path);  // throws InputError (plan)

  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] const Plan& plan() const { return plan_; }
  [[nodiscard]] int count_of(ShardStage stage) const;  // number of shards or clusters
  [[nodiscard]] std::string path_of(ShardStage stage, int shard) const;

  // The report of a shard that is complete; empty: it is to be processed.
  [[nodiscard]] std::optional<ShardReport> completed(ShardStage stage, int shard,
                                                     const std::string& from) const;
  // Writes FILE.done, once the file is written.
  [[nodiscard]] ShardReport finish(ShardInfo info) const;

  // The images of all feature shards.
  [[nodiscard]] ReadableImages readable_images() const;
  // Descriptions of all shards of a stage, by shard.
  [[nodiscard]] std::vector<ShardInfo> require_all(ShardStage stage, const std::string& from) const;
  [[nodiscard]] std::vector<ImageFeatures> features(const ShardInfo& info) const;
  [[nodiscard]] PlannedPairs pairs(const ReadableImages& readable) const;
  // The matches of a shard, for its part of the pairs.
  [[nodiscard]] std::vector<Pair> matches(const ShardInfo& info,
                                          const std::vector<ImagePair>& pairs) const;
  // Throws if a match of a shard refers to a feature that does not exist. `first`, `second`: number
  // of features of the images of the pair.
  void check_matches(const ShardInfo& info, const Pair& pair, std::size_t first,
                     std::size_t second) const;
  // Rethrows the error with the command that makes the shard.
  [[noreturn]] void fail(const InputError& error, ShardStage stage, int shard) const;

 private:
  [[nodiscard]] std::string command_of(ShardStage stage, int shard) const;
  [[nodiscard]] ShardInfo require(ShardStage stage, int shard, const std::string& from) const;

  std::string path_;
  Plan plan_;
};

// Checksum of shards and of what they were made from.
[[nodiscard]] std::string checksum_of_shards(const std::string& from,
                                             const std::vector<ShardInfo>& shards);

}  // namespace tarsier::sfm
