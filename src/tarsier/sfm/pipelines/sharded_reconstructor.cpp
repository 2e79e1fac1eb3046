// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/sharded_reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/pipelines/shard_commands.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>

namespace tarsier::sfm {
namespace {

constexpr int kSiftColumns = 128;
constexpr std::int64_t kPairsAtOnce = 256;  // between looks at the stop token

std::size_t at(std::int64_t i) { return static_cast<std::size_t>(i); }

std::string sum_or_none(const std::string& path) {
  try {
    return sha256_of_file(path);
  } catch (const InputError&) {
    return "";
  }
}

std::string sum_of(const std::vector<std::string>& sums) {
  Sha256 sum;
  for (const std::string& text : sums) sum.add(text);
  return sum.hex();
}

void expect_matches_fit(const Pair& pair, std::size_t first, std::size_t second,
                        const std::string& path) {
  for (const Match& match : pair.view.inliers) {
    if (match.first < 0 || at(match.first) >= first || match.second < 0 ||
        at(match.second) >= second)
      throw InputError(path, "is damaged: a match of no feature");
  }
}

}  // namespace

// Indices of images are those of all that could be read, in the order of the plan.
class ShardedReconstructor::Readable {
 public:
  Readable(const Plan& plan, std::vector<ShardInfo> infos) : infos_(std::move(infos)) {
    std::vector<std::string> sums;
    for (const ShardInfo& info : infos_) {
      sums.push_back(info.sha256);
      first_.push_back(static_cast<int>(names_.size()));
      const ShardRange range =
          range_of_shard(static_cast<std::int64_t>(plan.images.size()), info.shard, info.shards);
      auto gone = info.left_out.begin();
      for (std::int64_t i = range.first; i < range.last; ++i) {
        if (gone != info.left_out.end() && gone->first == i)
          ++gone;
        else
          add(plan.images[at(i)]);
      }
    }
    key_ = sum_of(sums);
  }

  [[nodiscard]] int count() const { return static_cast<int>(names_.size()); }
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }
  [[nodiscard]] const KnownPlaces& places() const { return places_; }
  [[nodiscard]] const std::vector<ShardInfo>& infos() const { return infos_; }
  [[nodiscard]] const std::string& key() const { return key_; }  // of all features
  // The index of the first image of infos()[shard].
  [[nodiscard]] int first_of(std::size_t shard) const { return first_[shard]; }
  [[nodiscard]] std::size_t shard_of(int image) const {
    return at(std::upper_bound(first_.begin(), first_.end(), image) - first_.begin() - 1);
  }

 private:
  void add(const PlannedImage& image) {
    names_.push_back(image.name);
    places_.push_back(image.place);
  }

  std::vector<ShardInfo> infos_;
  std::vector<std::string> names_;
  KnownPlaces places_;
  std::vector<int> first_;
  std::string key_;
};

nlohmann::ordered_json to_json(const ShardReport& report) {
  return {{"stage", name_of(report.stage)},
          {"shard", {report.shard, report.shards}},
          {report.stage == ShardStage::kFeatures ? "images" : "pairs", report.count},
          {"left_out", report.left_out},
          {"was_done", report.was_done},
          {"output", report.path}};
}

ShardedReconstructor::ShardedReconstructor(std::string folder)
    : folder_(std::move(folder)), plan_(read_plan(folder_)) {
  plan_.options = seeded(plan_.options);
}

bool ShardedReconstructor::has_pairs_stage() const {
  return pair_choice(plan_.options, static_cast<int>(plan_.images.size())) ==
         PairChoice::kRetrieval;
}

std::string ShardedReconstructor::path_of(ShardStage stage, int shard) const {
  return shard_path(folder_, stage, shard, plan_.shards);
}

std::string ShardedReconstructor::command_of(ShardStage stage, int shard) const {
  return shard_command(folder_, stage, shard, plan_.shards);
}

bool ShardedReconstructor::is_done(ShardStage stage, int shard, const std::string& from,
                                   ShardReport& report) const {
  try {
    const ShardInfo info = require(stage, shard, from);
    report = {stage,
              info.shard,
              info.shards,
              info.count,
              static_cast<int>(info.left_out.size()),
              true,
              path_of(stage, shard)};
    if (stage == ShardStage::kFeatures) (void)load_features(info);
    if (stage == ShardStage::kPairs) (void)read_image_pairs(report.path, info.sha256);
    if (stage == ShardStage::kMatch) (void)read_match_shard(report.path, info.sha256);
    return true;
  } catch (const Error&) {
    return false;
  }
}

ShardReport ShardedReconstructor::finish(ShardInfo info) const {
  info.shards = plan_.shards;
  info.plan = plan_.key;
  const std::string path = path_of(info.stage, info.shard);
  write_shard_info(path, info);
  return {info.stage, info.shard, info.shards, info.count, static_cast<int>(info.left_out.size()),
          false,      path};
}

ShardInfo ShardedReconstructor::require(ShardStage stage, int shard,
                                        const std::string& from) const {
  const std::string path = path_of(stage, shard);
  const ShardInfo info = read_shard_info(path);
  if (info.stage != stage || info.shard != shard || info.shards != plan_.shards ||
      info.plan != plan_.key)
    throw InputError(path, "is of another plan");
  if (info.from != from) throw InputError(path, "was made of other features or pairs");
  if (stage == ShardStage::kFeatures) {
    const ShardRange range =
        range_of_shard(static_cast<std::int64_t>(plan_.images.size()), shard, plan_.shards);
    const bool fits = std::all_of(
        info.left_out.begin(), info.left_out.end(),
        [&](const auto& entry) { return entry.first >= range.first && entry.first < range.last; });
    if (!fits || info.count + static_cast<std::int64_t>(info.left_out.size()) != range.size())
      throw InputError(path + ".done", "does not describe a shard");
  }
  return info;
}

std::vector<ShardInfo> ShardedReconstructor::require_all(ShardStage stage,
                                                         const std::string& from) const {
  std::vector<ShardInfo> infos;
  std::vector<int> missing;
  std::string first;
  for (int shard = 1; shard <= plan_.shards; ++shard) {
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
    constexpr std::size_t kNamed = 10;
    const std::span<const int> named = std::span(missing).first(std::min(kNamed, missing.size()));
    first += fmt::format(", and so are others: {} of {} shards, {}{}", missing.size(), plan_.shards,
                         fmt::join(named, " "), missing.size() > kNamed ? " .." : "");
  }
  throw Error(ExitStatus::kBadInput, fmt::format("{}; run: {}", first, command));
}

ShardReport ShardedReconstructor::find_features(int shard, Progress& progress,
                                                const std::stop_token& stop) const {
  TARSIER_REQUIRE(shard >= 1 && shard <= plan_.shards, "shard {}: expected 1..{}", shard,
                  plan_.shards);
  ShardReport report;
  if (is_done(ShardStage::kFeatures, shard, "", report)) return report;
  ShardInfo info;
  info.stage = ShardStage::kFeatures;
  info.shard = shard;
  const ShardRange range =
      range_of_shard(static_cast<std::int64_t>(plan_.images.size()), shard, plan_.shards);
  const Cache none("");
  std::vector<ImageFeatures> images;
  progress.begin("features", range.size(), "images");
  for (std::int64_t i = range.first; i < range.last; ++i) {
    throw_if_stopped(stop);
    const PlannedImage& planned = plan_.images[at(i)];
    ImageFeatures image;
    image.input = static_cast<int>(i);
    const auto expect_same = [&](bool same) {
      if (!same)
        throw InputError(planned.path,
                         "is not the image that was planned: plan again, or put it back");
    };
    try {
      const cv::Mat pixels = read_input_image({planned.name, planned.path}, plan_.options, image);
      expect_same(image.key == features_key(planned.sha256, plan_.options.features));
      (void)find_image_features(pixels, plan_.options, none, image);
      images.push_back(std::move(image));
    } catch (const InputError& error) {
      // Left out only where it could not be read either when it was planned.
      expect_same(sum_or_none(planned.path) == planned.sha256);
      info.left_out.emplace_back(static_cast<int>(i), error.what());
      log_warning("{} (left out)", error.what());
    }
    progress.advance();
  }
  progress.end();
  info.count = static_cast<std::int64_t>(images.size());
  info.sha256 = write_feature_shard(path_of(info.stage, shard), images);
  return finish(std::move(info));
}

std::vector<ImageFeatures> ShardedReconstructor::load_features(const ShardInfo& info) const {
  const std::string path = path_of(ShardStage::kFeatures, info.shard);
  try {
    std::vector<ImageFeatures> images = read_feature_shard(path, info.sha256);
    const ShardRange range =
        range_of_shard(static_cast<std::int64_t>(plan_.images.size()), info.shard, info.shards);
    std::size_t k = 0;
    auto gone = info.left_out.begin();
    for (std::int64_t i = range.first; i < range.last; ++i) {
      if (gone != info.left_out.end() && gone->first == i) {
        ++gone;
        continue;
      }
      if (k == images.size() || images[k].input != i ||
          images[k].key != features_key(plan_.images[at(i)].sha256, plan_.options.features)) {
        throw InputError(path, "holds features of other images or options");
      }
      const cv::Mat& descriptors = images[k++].features.descriptors;
      if (plan_.options.features.kind == FeatureKind::kSift && !descriptors.empty() &&
          descriptors.cols != kSiftColumns)
        throw InputError(path, "is damaged: descriptors of another length");
    }
    if (k != images.size()) throw InputError(path, "holds features of other images or options");
    return images;
  } catch (const InputError& error) {
    throw Error(ExitStatus::kBadInput,
                fmt::format("{}; run: {}", error.what(), command_of(info.stage, info.shard)));
  }
}

ShardReport ShardedReconstructor::choose_pairs(Progress& progress,
                                               const std::stop_token& stop) const {
  const Readable readable(plan_, require_all(ShardStage::kFeatures, ""));
  ShardReport report;
  if (pair_choice(plan_.options, readable.count()) != PairChoice::kRetrieval) {
    report.stage = ShardStage::kPairs;
    report.shards = plan_.shards;
    report.count = static_cast<std::int64_t>(pairs_of(readable).first.size());
    report.was_done = true;
    return report;
  }
  if (is_done(ShardStage::kPairs, 1, readable.key(), report)) return report;
  // Images are asked for in their order: one shard at a time.
  std::optional<std::size_t> loaded;
  std::vector<ImageFeatures> images;
  const auto descriptors = [&](int image) {
    throw_if_stopped(stop);
    const std::size_t shard = readable.shard_of(image);
    if (loaded != shard) {
      images = load_features(readable.infos()[shard]);
      loaded = shard;
    }
    return images[at(image - readable.first_of(shard))].features.descriptors;
  };
  progress.begin("pairs", 1, "steps");
  const std::vector<ImagePair> pairs =
      sfm::choose_pairs(readable.names(), readable.places(), descriptors, plan_.options);
  progress.advance();
  progress.end();
  ShardInfo info;
  info.stage = ShardStage::kPairs;
  info.from = readable.key();
  info.count = static_cast<std::int64_t>(pairs.size());
  info.sha256 = write_image_pairs(path_of(info.stage, 1), pairs);
  return finish(std::move(info));
}

std::pair<std::vector<ImagePair>, std::string> ShardedReconstructor::pairs_of(
    const Readable& readable) const {
  if (pair_choice(plan_.options, readable.count()) != PairChoice::kRetrieval)
    return {sfm::choose_pairs(readable.names(), readable.places(), {}, plan_.options),
            readable.key()};
  const std::string path = path_of(ShardStage::kPairs, 1);
  try {
    const ShardInfo info = require(ShardStage::kPairs, 1, readable.key());
    std::vector<ImagePair> pairs = read_image_pairs(path, info.sha256);
    for (const auto& [first, second] : pairs)
      if (second >= readable.count()) throw InputError(path, "is damaged: a pair of no images");
    return {std::move(pairs), sum_of({readable.key(), info.sha256})};
  } catch (const InputError& error) {
    throw Error(ExitStatus::kBadInput,
                fmt::format("{}; run: {}", error.what(), command_of(ShardStage::kPairs, 1)));
  }
}

ShardReport ShardedReconstructor::match(int shard, Progress& progress,
                                        const std::stop_token& stop) const {
  TARSIER_REQUIRE(shard >= 1 && shard <= plan_.shards, "shard {}: expected 1..{}", shard,
                  plan_.shards);
  (void)choose_pairs(progress, stop);
  const Readable readable(plan_, require_all(ShardStage::kFeatures, ""));
  const auto [all, from] = pairs_of(readable);
  ShardReport report;
  if (is_done(ShardStage::kMatch, shard, from, report)) return report;

  const ShardRange range =
      range_of_shard(static_cast<std::int64_t>(all.size()), shard, plan_.shards);
  const std::span<const ImagePair> chosen =
      std::span(all).subspan(at(range.first), at(range.size()));
  std::vector<bool> is_needed(at(readable.count()), false);
  for (const auto& [first, second] : chosen) is_needed[at(first)] = is_needed[at(second)] = true;
  std::vector<ImageFeatures> images(at(readable.count()));
  progress.begin("load", static_cast<std::int64_t>(readable.infos().size()), "shards");
  for (std::size_t s = 0; s < readable.infos().size(); ++s) {
    throw_if_stopped(stop);
    const auto first = at(readable.first_of(s));
    const auto last = first + at(readable.infos()[s].count);
    if (std::find(is_needed.begin() + static_cast<std::ptrdiff_t>(first),
                  is_needed.begin() + static_cast<std::ptrdiff_t>(last),
                  true) != is_needed.begin() + static_cast<std::ptrdiff_t>(last)) {
      std::vector<ImageFeatures> loaded = load_features(readable.infos()[s]);
      for (std::size_t k = 0; k < loaded.size(); ++k)
        if (is_needed[first + k]) images[first + k] = std::move(loaded[k]);
    }
    progress.advance();
  }
  progress.end();

  std::vector<Pair> pairs(chosen.size());
  progress.begin("match", range.size(), "pairs");
  for (std::int64_t start = 0; start < range.size(); start += kPairsAtOnce) {
    const std::int64_t end = std::min(range.size(), start + kPairsAtOnce);
    cv::parallel_for_(
        cv::Range(static_cast<int>(start), static_cast<int>(end)), [&](const cv::Range& some) {
          for (int k = some.start; k < some.end; ++k) {
            if (stop.stop_requested()) return;
            Pair& pair = pairs[at(k)];
            pair.first = chosen[at(k)].first;
            pair.second = chosen[at(k)].second;
            compare_images(images[at(pair.first)], images[at(pair.second)], plan_.options, pair);
            progress.advance();
          }
        });
    throw_if_stopped(stop);
  }
  progress.end();
  ShardInfo info;
  info.stage = ShardStage::kMatch;
  info.shard = shard;
  info.from = from;
  info.count = range.size();
  info.sha256 = write_match_shard(path_of(info.stage, shard), pairs);
  return finish(std::move(info));
}

void ShardedReconstructor::load(MatchedImages& matched, const Readable& readable,
                                const std::vector<ImagePair>& pairs,
                                const std::vector<ShardInfo>& matches, Progress& progress,
                                const std::stop_token& stop) const {
  progress.begin("load", static_cast<std::int64_t>(readable.infos().size() + matches.size()),
                 "shards");
  for (const ShardInfo& info : readable.infos()) {
    throw_if_stopped(stop);
    for (ImageFeatures& image : load_features(info)) matched.images.push_back(std::move(image));
    matched.left_out.insert(matched.left_out.end(), info.left_out.begin(), info.left_out.end());
    progress.advance();
  }
  for (const ShardInfo& info : matches) {
    throw_if_stopped(stop);
    const std::string path = path_of(ShardStage::kMatch, info.shard);
    const ShardRange range =
        range_of_shard(static_cast<std::int64_t>(pairs.size()), info.shard, info.shards);
    try {
      std::vector<Pair> some = read_match_shard(path, info.sha256);
      if (static_cast<std::int64_t>(some.size()) != range.size())
        throw InputError(path, "holds other pairs than were chosen");
      for (std::size_t k = 0; k < some.size(); ++k) {
        const auto& [first, second] = pairs[at(range.first) + k];
        if (some[k].first != first || some[k].second != second)
          throw InputError(path, "holds other pairs than were chosen");
        expect_matches_fit(some[k], matched.images[at(first)].features.points.size(),
                           matched.images[at(second)].features.points.size(), path);
        matched.pairs.push_back(std::move(some[k]));
      }
    } catch (const InputError& error) {
      throw Error(ExitStatus::kBadInput, fmt::format("{}; run: {}", error.what(),
                                                     command_of(ShardStage::kMatch, info.shard)));
    }
    progress.advance();
  }
  progress.end();
}

ReconstructorResult ShardedReconstructor::map(const ReconstructorOptions& options,
                                              Progress& progress, const std::stop_token& stop,
                                              const ReconstructorHooks& hooks) const {
  const Readable readable(plan_, require_all(ShardStage::kFeatures, ""));
  const auto [pairs, from] = pairs_of(readable);
  const std::vector<ShardInfo> matches = require_all(ShardStage::kMatch, from);
  ReconstructorOptions how = options;
  how.pipeline = plan_.options;
  how.pipeline.cache_folder = options.pipeline.cache_folder;
  how.pipeline.memory_gb = options.pipeline.memory_gb;
  how.pipeline.checkpoint_s = options.pipeline.checkpoint_s;
  ReconstructorHooks mapping = hooks;
  mapping.matched = [&, &chosen = pairs](MatchedImages& matched) {
    load(matched, readable, chosen, matches, progress, stop);
  };
  return Reconstructor(how).run_images(plan_.inputs(), progress, stop, mapping);
}

}  // namespace tarsier::sfm
