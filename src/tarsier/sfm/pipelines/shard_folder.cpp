// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/shard_folder.h"

#include "tarsier/core/at.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/pipelines/shard_commands.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <span>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kSiftColumns = 128;

std::string checksum_of(const std::vector<std::string>& sums) {
  Sha256 sum;
  for (const std::string& text : sums) sum.add(text);
  return sum.hex();
}

}  // namespace

nlohmann::ordered_json to_json(const ShardReport& report) {
  if (report.stage == ShardStage::kModel) {
    return {{"stage", "map"},
            {"cluster", {report.shard, report.shards}},
            {"images", report.count},
            {"own", report.own},
            {"registered", report.registered},
            {"models", report.models},
            {"was_done", report.was_done},
            {"output", report.path}};
  }
  return {{"stage", name_of(report.stage)},
          {"shard", {report.shard, report.shards}},
          {report.stage == ShardStage::kFeatures ? "images" : "pairs", report.count},
          {"left_out", report.left_out},
          {"was_done", report.was_done},
          {"output", report.path}};
}

void describe(const ClusterModels& cluster, ShardReport& report) {
  report.count = static_cast<std::int64_t>(cluster.images.size());
  report.own = static_cast<int>(std::count(cluster.is_own.begin(), cluster.is_own.end(), 1));
  report.registered = cluster.registered();
  report.models = static_cast<int>(cluster.models.size());
}

std::string checksum_of_shards(const std::string& from, const std::vector<ShardInfo>& shards) {
  std::vector<std::string> sums{from};
  for (const ShardInfo& info : shards) sums.push_back(info.sha256);
  return checksum_of(sums);
}

ReadableImages::ReadableImages(const Plan& plan, std::vector<ShardInfo> features)
    : infos_(std::move(features)) {
  std::vector<std::string> sums;
  for (const ShardInfo& info : infos_) {
    sums.push_back(info.sha256);
    first_.push_back(static_cast<int>(names_.size()));
    const ShardRange range =
        range_of_shard(static_cast<std::int64_t>(plan.images.size()), info.shard, info.shards);
    auto left_out = info.left_out.begin();
    for (std::int64_t i = range.first; i < range.last; ++i) {
      if (left_out != info.left_out.end() && left_out->first == i) {
        ++left_out;
        continue;
      }
      const PlannedImage& image = plan.images[at(i)];
      inputs_.push_back(static_cast<int>(i));
      names_.push_back(image.name);
      places_.push_back(image.place);
    }
  }
  key_ = checksum_of(sums);
}

int ReadableImages::input_of(int image) const { return inputs_[at(image)]; }

std::size_t ReadableImages::shard_of(int image) const {
  return at(std::upper_bound(first_.begin(), first_.end(), image) - first_.begin() - 1);
}

ShardFolder::ShardFolder(std::string path) : path_(std::move(path)), plan_(read_plan(path_)) {
  plan_.options = seeded(plan_.options);
}

int ShardFolder::count_of(ShardStage stage) const {
  return stage == ShardStage::kModel ? plan_.clusters() : plan_.shards;
}

std::string ShardFolder::path_of(ShardStage stage, int shard) const {
  return shard_path(path_, stage, shard, count_of(stage));
}

std::string ShardFolder::command_of(ShardStage stage, int shard) const {
  return shard_command(path_, stage, shard, count_of(stage));
}

std::optional<ShardReport> ShardFolder::completed(ShardStage stage, int shard,
                                                  const std::string& from) const {
  try {
    const ShardInfo info = require(stage, shard, from);
    ShardReport report;
    report.stage = stage;
    report.shard = info.shard;
    report.shards = info.shards;
    report.count = info.count;
    report.left_out = static_cast<int>(info.left_out.size());
    report.was_done = true;
    report.path = path_of(stage, shard);
    if (stage == ShardStage::kFeatures) (void)features(info);
    if (stage == ShardStage::kPairs) (void)read_image_pairs(report.path, info.sha256);
    if (stage == ShardStage::kMatch) (void)read_match_shard(report.path, info.sha256);
    if (stage == ShardStage::kModel)
      describe(read_cluster_models(report.path, info.sha256), report);
    return report;
  } catch (const Error&) {
    return std::nullopt;
  }
}

void ShardFolder::fail(const InputError& error, ShardStage stage, int shard) const {
  throw Error(ErrorKind::kInput,
              fmt::format("{}; run: {}", error.what(), command_of(stage, shard)));
}

ReadableImages ShardFolder::readable_images() const {
  return {plan_, require_all(ShardStage::kFeatures, "")};
}

ShardReport ShardFolder::finish(ShardInfo info) const {
  info.shards = count_of(info.stage);
  info.plan = plan_.key;
  ShardReport report;
  report.path = path_of(info.stage, info.shard);
  write_shard_info(report.path, info);
  report.stage = info.stage;
  report.shard = info.shard;
  report.shards = info.shards;
  report.count = info.count;
  report.left_out = static_cast<int>(info.left_out.size());
  return report;
}

ShardInfo ShardFolder::require(ShardStage stage, int shard, const std::string& from) const {
  const std::string path = path_of(stage, shard);
  ShardInfo info = read_shard_info(path);
  if (info.stage != stage || info.shard != shard || info.shards != count_of(stage) ||
      info.plan != plan_.key)
    throw InputError(path, "belongs to another plan");
  if (info.from != from)
    throw InputError(path, "was computed from other features, pairs or matches");
  if (stage == ShardStage::kFeatures) {
    const ShardRange range =
        range_of_shard(static_cast<std::int64_t>(plan_.images.size()), shard, plan_.shards);
    const bool fits = std::all_of(
        info.left_out.begin(), info.left_out.end(),
        [&](const auto& entry) { return entry.first >= range.first && entry.first < range.last; });
    if (!fits || info.count + static_cast<std::int64_t>(info.left_out.size()) != range.size())
      throw InputError(path + ".done", "is not a valid description of a shard");
  }
  return info;
}

std::vector<ShardInfo> ShardFolder::require_all(ShardStage stage, const std::string& from) const {
  std::vector<ShardInfo> infos;
  std::vector<int> missing;
  std::string first;
  const int count = count_of(stage);
  for (int shard = 1; shard <= count; ++shard) {
    try {
      infos.push_back(require(stage, shard, from));
    } catch (const InputError& error) {
      if (missing.empty()) first = error.what();
      missing.push_back(shard);
    }
  }
  if (missing.empty()) return infos;
  const std::string command = command_of(stage, missing.front());
  if (missing.size() > 1) {
    constexpr std::size_t kMaxListed = 10;
    const std::span<const int> listed =
        std::span(missing).first(std::min(kMaxListed, missing.size()));
    first += fmt::format("; {} of {} {} cannot be used: {}{}", missing.size(), count,
                         stage == ShardStage::kModel ? "clusters" : "shards",
                         fmt::join(listed, " "), missing.size() > kMaxListed ? " .." : "");
  }
  throw Error(ErrorKind::kInput, fmt::format("{}; run: {}", first, command));
}

std::vector<ImageFeatures> ShardFolder::features(const ShardInfo& info) const {
  const std::string path = path_of(ShardStage::kFeatures, info.shard);
  try {
    std::vector<ImageFeatures> images = read_feature_shard(path, info.sha256);
    const ShardRange range =
        range_of_shard(static_cast<std::int64_t>(plan_.images.size()), info.shard, info.shards);
    std::size_t k = 0;
    auto left_out = info.left_out.begin();
    for (std::int64_t i = range.first; i < range.last; ++i) {
      if (left_out != info.left_out.end() && left_out->first == i) {
        ++left_out;
        continue;
      }
      if (k == images.size() || images[k].input != i ||
          images[k].key != features_key(plan_.images[at(i)].sha256, plan_.options.features)) {
        throw InputError(path, "contains features of other images or options");
      }
      const cv::Mat& descriptors = images[k++].features.descriptors;
      if (plan_.options.features.kind == FeatureKind::kSift && !descriptors.empty() &&
          descriptors.cols != kSiftColumns)
        throw InputError(path, "is damaged: descriptors have a wrong length");
    }
    if (k != images.size()) throw InputError(path, "contains features of other images or options");
    return images;
  } catch (const InputError& error) {
    fail(error, info.stage, info.shard);
  }
}

PlannedPairs ShardFolder::pairs(const ReadableImages& readable) const {
  if (pair_choice(plan_.options, readable.count()) != PairChoice::kRetrieval)
    return {choose_pairs(readable.names(), readable.places(), {}, plan_.options), readable.key()};
  const std::string path = path_of(ShardStage::kPairs, 1);
  try {
    const ShardInfo info = require(ShardStage::kPairs, 1, readable.key());
    std::vector<ImagePair> chosen = read_image_pairs(path, info.sha256);
    for (const auto& [first, second] : chosen)
      if (second >= readable.count())
        throw InputError(path, "is damaged: a pair refers to an image that does not exist");
    return {std::move(chosen), checksum_of({readable.key(), info.sha256})};
  } catch (const InputError& error) {
    fail(error, ShardStage::kPairs, 1);
  }
}

std::vector<Pair> ShardFolder::matches(const ShardInfo& info,
                                       const std::vector<ImagePair>& pairs) const {
  const std::string path = path_of(ShardStage::kMatch, info.shard);
  const ShardRange range =
      range_of_shard(static_cast<std::int64_t>(pairs.size()), info.shard, info.shards);
  try {
    std::vector<Pair> some = read_match_shard(path, info.sha256);
    bool fits = static_cast<std::int64_t>(some.size()) == range.size();
    for (std::size_t k = 0; fits && k < some.size(); ++k)
      fits = ImagePair(some[k].first, some[k].second) == pairs[at(range.first) + k];
    if (!fits) throw InputError(path, "contains other pairs than the selected ones");
    return some;
  } catch (const InputError& error) {
    fail(error, ShardStage::kMatch, info.shard);
  }
}

void ShardFolder::check_matches(const ShardInfo& info, const Pair& pair, std::size_t first,
                                std::size_t second) const {
  for (const Match& match : pair.view.inliers) {
    if (match.first < 0 || at(match.first) >= first || match.second < 0 ||
        at(match.second) >= second)
      fail(InputError(path_of(ShardStage::kMatch, info.shard),
                      "is damaged: a match refers to a feature that does not exist"),
           ShardStage::kMatch, info.shard);
  }
}

}  // namespace tarsier::sfm
