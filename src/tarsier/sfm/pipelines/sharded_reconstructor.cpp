// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/sharded_reconstructor.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <filesystem>
#include <map>
#include <optional>
#include <span>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kStopCheckPairs = 256;  // between two checks of the stop token
// Number of images that a cluster takes from each neighbour.
constexpr int kMinOverlap = 4;
constexpr int kMaxOverlap = 30;

std::string checksum_or_empty(const std::string& path) {
  try {
    return sha256_of_file(path);
  } catch (const InputError&) {
    return "";
  }
}

// The model with the images and cameras of all clusters.
Model model_of(const PackedModel& packed, const ClusterModels& cluster, const MapperInput& input) {
  Model model;
  model.cameras = input.cameras;
  model.images.resize(input.images.size());
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    model.images[i].name = input.images[i].name;
    model.images[i].camera = input.images[i].camera;
  }
  for (std::size_t k = 0; k < packed.registered.size(); ++k) {
    const std::size_t local = at(packed.registered[k]);
    Image& image = model.images[at(cluster.images[local])];
    image = input.images[at(cluster.images[local])];
    image.registered = true;
    image.pose = packed.poses[k];
    image.points.assign(image.features.size(), -1);
    model.cameras[at(image.camera)] = packed.cameras[at(cluster.cameras[local])];
  }
  auto next = packed.observations.begin();
  for (std::size_t k = 0; k < packed.point_indices.size(); ++k) {
    Point point;
    point.position = packed.positions[k];
    point.color = packed.colors[k];
    point.error = packed.errors[k];
    for (int v = 0; v < packed.track_lengths[k]; ++v, ++next) {
      const int image = cluster.images[at(next->image)];
      if (!model.images[at(image)].registered) continue;
      point.track.push_back({image, next->feature});
      model.images[at(image)].points[at(next->feature)] = static_cast<int>(model.points.size());
    }
    model.points.push_back(std::move(point));
  }
  return model;
}

int overlap_of(int cluster_size) { return std::clamp(cluster_size / 5, kMinOverlap, kMaxOverlap); }

}  // namespace

ShardedReconstructor::ShardedReconstructor(std::string folder) : shards_(std::move(folder)) {}

bool ShardedReconstructor::has_pairs_stage() const {
  return pair_choice(plan().options, static_cast<int>(plan().images.size())) ==
         PairChoice::kRetrieval;
}

ReconstructorOptions ShardedReconstructor::planned(const ReconstructorOptions& options) const {
  ReconstructorOptions how = options;
  how.pipeline = plan().options;
  how.pipeline.cache_folder = options.pipeline.cache_folder;
  how.pipeline.memory_gb = options.pipeline.memory_gb;
  how.pipeline.checkpoint_s = options.pipeline.checkpoint_s;
  return how;
}

ShardReport ShardedReconstructor::find_features(int shard, Progress& progress,
                                                const std::stop_token& stop) const {
  TARSIER_REQUIRE(shard >= 1 && shard <= plan().shards, "shard {}: expected 1..{}", shard,
                  plan().shards);
  if (const auto done = shards_.completed(ShardStage::kFeatures, shard, "")) return *done;
  ShardInfo info;
  info.stage = ShardStage::kFeatures;
  info.shard = shard;
  const ShardRange range =
      range_of_shard(static_cast<std::int64_t>(plan().images.size()), shard, plan().shards);
  const Cache none("");
  std::vector<ImageFeatures> images;
  progress.begin("features", range.size(), "images");
  for (std::int64_t i = range.first; i < range.last; ++i) {
    throw_if_stopped(stop);
    const PlannedImage& planned = plan().images[at(i)];
    ImageFeatures image;
    image.input = static_cast<int>(i);
    const auto expect_same = [&](bool same) {
      if (!same)
        throw InputError(planned.path,
                         "the image was changed after the plan was made: restore it, or run "
                         "`tarsier sfm plan` again");
    };
    try {
      const cv::Mat pixels = read_input_image({planned.name, planned.path}, plan().options, image);
      expect_same(image.key == features_key(planned.sha256, plan().options.features));
      (void)find_image_features(pixels, plan().options, none, image);
      images.push_back(std::move(image));
    } catch (const InputError& error) {
      // Left out only where it was unreadable during planning, too.
      expect_same(checksum_or_empty(planned.path) == planned.sha256);
      info.left_out.emplace_back(static_cast<int>(i), error.what());
      log_warning("{} (left out)", error.what());
    }
    progress.advance();
  }
  progress.end();
  info.count = static_cast<std::int64_t>(images.size());
  info.sha256 = write_feature_shard(shards_.path_of(info.stage, shard), images);
  return shards_.finish(std::move(info));
}

ShardReport ShardedReconstructor::choose_pairs(Progress& progress,
                                               const std::stop_token& stop) const {
  const ReadableImages readable = shards_.readable_images();
  ShardReport report;
  if (pair_choice(plan().options, readable.count()) != PairChoice::kRetrieval) {
    report.stage = ShardStage::kPairs;
    report.shards = plan().shards;
    report.count = static_cast<std::int64_t>(shards_.pairs(readable).pairs.size());
    report.was_done = true;
    return report;
  }
  if (const auto done = shards_.completed(ShardStage::kPairs, 1, readable.key())) return *done;
  // Images are requested in their order, so only one shard is in memory.
  std::optional<std::size_t> loaded;
  std::vector<ImageFeatures> images;
  const auto descriptors = [&](int image) {
    throw_if_stopped(stop);
    const std::size_t shard = readable.shard_of(image);
    if (loaded != shard) {
      images = shards_.features(readable.infos()[shard]);
      loaded = shard;
    }
    return images[at(image - readable.first_of(shard))].features.descriptors;
  };
  progress.begin("pairs", 1, "steps");
  const std::vector<ImagePair> pairs =
      sfm::choose_pairs(readable.names(), readable.places(), descriptors, plan().options);
  progress.advance();
  progress.end();
  ShardInfo info;
  info.stage = ShardStage::kPairs;
  info.from = readable.key();
  info.count = static_cast<std::int64_t>(pairs.size());
  info.sha256 = write_image_pairs(shards_.path_of(info.stage, 1), pairs);
  return shards_.finish(std::move(info));
}

ShardReport ShardedReconstructor::match(int shard, Progress& progress,
                                        const std::stop_token& stop) const {
  TARSIER_REQUIRE(shard >= 1 && shard <= plan().shards, "shard {}: expected 1..{}", shard,
                  plan().shards);
  (void)choose_pairs(progress, stop);
  const ReadableImages readable = shards_.readable_images();
  const auto [all, from] = shards_.pairs(readable);
  if (const auto done = shards_.completed(ShardStage::kMatch, shard, from)) return *done;

  const ShardRange range =
      range_of_shard(static_cast<std::int64_t>(all.size()), shard, plan().shards);
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
      std::vector<ImageFeatures> loaded = shards_.features(readable.infos()[s]);
      for (std::size_t k = 0; k < loaded.size(); ++k)
        if (is_needed[first + k]) images[first + k] = std::move(loaded[k]);
    }
    progress.advance();
  }
  progress.end();

  std::vector<Pair> pairs(chosen.size());
  progress.begin("match", range.size(), "pairs");
  for (std::int64_t start = 0; start < range.size(); start += kStopCheckPairs) {
    const std::int64_t end = std::min(range.size(), start + kStopCheckPairs);
    cv::parallel_for_(
        cv::Range(static_cast<int>(start), static_cast<int>(end)), [&](const cv::Range& some) {
          for (int k = some.start; k < some.end; ++k) {
            if (stop.stop_requested()) return;
            Pair& pair = pairs[at(k)];
            pair.first = chosen[at(k)].first;
            pair.second = chosen[at(k)].second;
            compare_images(images[at(pair.first)], images[at(pair.second)], plan().options, pair);
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
  info.sha256 = write_match_shard(shards_.path_of(info.stage, shard), pairs);
  return shards_.finish(std::move(info));
}

void ShardedReconstructor::load(MatchedImages& matched, const ReadableImages& readable,
                                const std::vector<ImagePair>& pairs,
                                const std::vector<ShardInfo>& matches, Progress& progress,
                                const std::stop_token& stop) const {
  progress.begin("load", static_cast<std::int64_t>(readable.infos().size() + matches.size()),
                 "shards");
  for (const ShardInfo& info : readable.infos()) {
    throw_if_stopped(stop);
    for (ImageFeatures& image : shards_.features(info)) matched.images.push_back(std::move(image));
    matched.left_out.insert(matched.left_out.end(), info.left_out.begin(), info.left_out.end());
    progress.advance();
  }
  for (const ShardInfo& info : matches) {
    throw_if_stopped(stop);
    for (Pair& pair : shards_.matches(info, pairs)) {
      shards_.check_matches(info, pair, matched.images[at(pair.first)].features.points.size(),
                            matched.images[at(pair.second)].features.points.size());
      matched.pairs.push_back(std::move(pair));
    }
    progress.advance();
  }
  progress.end();
}

std::vector<ViewCluster> ShardedReconstructor::find_clusters(const ReadableImages& readable,
                                                             const std::vector<ImagePair>& pairs,
                                                             const std::vector<ShardInfo>& matches,
                                                             Progress& progress,
                                                             const std::stop_token& stop) const {
  std::vector<WeightedEdge> edges;
  progress.begin("clusters", static_cast<std::int64_t>(matches.size()), "shards");
  for (const ShardInfo& info : matches) {
    throw_if_stopped(stop);
    for (const Pair& pair : shards_.matches(info, pairs))
      if (!pair.view.inliers.empty())
        edges.push_back({pair.first, pair.second, static_cast<double>(pair.view.inliers.size())});
    progress.advance();
  }
  progress.end();
  ClusterOptions how;
  how.clusters = plan().clusters();
  how.max_size = plan().cluster_size;
  how.overlap = overlap_of(plan().cluster_size);
  how.seed = plan().options.seed;
  return cluster_view_graph(readable.count(), edges, how, stop);
}

void ShardedReconstructor::load_cluster(MatchedImages& matched, const ReadableImages& readable,
                                        const std::vector<int>& images,
                                        const std::vector<ImagePair>& pairs,
                                        const std::vector<ShardInfo>& matches,
                                        const std::stop_token& stop) const {
  std::vector<int> index_of(at(readable.count()), -1);
  for (std::size_t k = 0; k < images.size(); ++k) index_of[at(images[k])] = static_cast<int>(k);
  matched.images.resize(images.size());
  for (std::size_t s = 0; s < readable.infos().size(); ++s) {
    throw_if_stopped(stop);
    const int first = readable.first_of(s);
    const auto last = first + static_cast<int>(readable.infos()[s].count);
    const auto begin = std::lower_bound(images.begin(), images.end(), first);
    if (begin == images.end() || *begin >= last) continue;
    std::vector<ImageFeatures> loaded = shards_.features(readable.infos()[s]);
    for (auto image = begin; image != images.end() && *image < last; ++image) {
      ImageFeatures& features = matched.images[at(index_of[at(*image)])];
      features = std::move(loaded[at(*image - first)]);
      features.input = index_of[at(*image)];
    }
  }
  for (const ShardInfo& info : matches) {
    throw_if_stopped(stop);
    for (Pair& pair : shards_.matches(info, pairs)) {
      pair.first = index_of[at(pair.first)];
      pair.second = index_of[at(pair.second)];
      if (pair.first < 0 || pair.second < 0) continue;
      shards_.check_matches(info, pair, matched.images[at(pair.first)].features.points.size(),
                            matched.images[at(pair.second)].features.points.size());
      matched.pairs.push_back(std::move(pair));
    }
  }
}

ShardReport ShardedReconstructor::map_cluster(int cluster, const ReconstructorOptions& options,
                                              Progress& progress,
                                              const std::stop_token& stop) const {
  const int count = plan().clusters();
  TARSIER_REQUIRE(cluster >= 1 && cluster <= count, "cluster {}: expected 1..{}", cluster, count);
  const ReadableImages readable = shards_.readable_images();
  const auto [pairs, from_pairs] = shards_.pairs(readable);
  const std::vector<ShardInfo> matches = shards_.require_all(ShardStage::kMatch, from_pairs);
  const std::string from = checksum_of_shards(from_pairs, matches);
  if (const auto done = shards_.completed(ShardStage::kModel, cluster, from)) return *done;

  const ViewCluster chosen =
      find_clusters(readable, pairs, matches, progress, stop)[at(cluster - 1)];
  ClusterModels made;
  made.images = chosen.images();
  for (const int image : made.images)
    made.is_own.push_back(std::binary_search(chosen.own.begin(), chosen.own.end(), image) ? 1 : 0);
  made.cameras.assign(made.images.size(), 0);
  made.reasons.assign(made.images.size(), "");
  if (made.images.size() < 2) {
    std::fill(made.reasons.begin(), made.reasons.end(), "the image is the only one in its cluster");
  } else {
    PipelineOptions how = planned(options).pipeline;
    if (!options.cache)
      how.cache_folder.clear();
    else if (how.cache_folder.empty())
      how.cache_folder = (std::filesystem::path(shards_.path()) / "cache").string();
    if (!how.cache_folder.empty()) make_folder(how.cache_folder);
    std::vector<Input> inputs;
    const std::vector<Input> all = plan().inputs();
    inputs.reserve(made.images.size());
    for (const int image : made.images) inputs.push_back(all[at(readable.input_of(image))]);
    PipelineHooks hooks;
    hooks.matched = [&, &chosen_pairs = pairs](MatchedImages& matched) {
      load_cluster(matched, readable, made.images, chosen_pairs, matches, stop);
    };
    const PipelineResult result = run_pipeline(inputs, how, progress, stop, hooks);
    for (const Model& model : result.reconstruction.models) {
      made.models.push_back(packed(model));
      for (std::size_t k = 0; k < made.cameras.size(); ++k)
        made.cameras[k] = model.images[k].camera;
    }
    for (std::size_t k = 0; k < made.reasons.size(); ++k)
      made.reasons[k] = result.reconstruction.outcomes[k].reason;
    for (const RefusedPair& refused : result.reconstruction.refused)
      made.rejected_pairs.emplace_back(made.images[at(refused.first)],
                                       made.images[at(refused.second)]);
    std::sort(made.rejected_pairs.begin(), made.rejected_pairs.end());
    made.rejected_pairs.erase(std::unique(made.rejected_pairs.begin(), made.rejected_pairs.end()),
                              made.rejected_pairs.end());
  }
  ShardInfo info;
  info.stage = ShardStage::kModel;
  info.shard = cluster;
  info.from = from;
  info.count = static_cast<std::int64_t>(made.images.size());
  info.sha256 = write_cluster_models(shards_.path_of(info.stage, cluster), made);
  ShardReport report = shards_.finish(std::move(info));
  describe(made, report);
  return report;
}

MappedParts ShardedReconstructor::load_parts(const std::vector<ShardInfo>& infos,
                                             const MapperInput& input) const {
  MappedParts parts;
  parts.reasons.assign(input.images.size(), "");
  std::map<ImagePair, std::size_t> pairs;
  for (std::size_t k = 0; k < input.pairs.size(); ++k)
    pairs[{input.pairs[k].first, input.pairs[k].second}] = k;
  for (const ShardInfo& info : infos) {
    const std::string path = shards_.path_of(ShardStage::kModel, info.shard);
    try {
      const ClusterModels cluster = read_cluster_models(path, info.sha256);
      std::vector<Image> images;
      for (std::size_t k = 0; k < cluster.images.size(); ++k) {
        if (at(cluster.images[k]) >= input.images.size())
          throw InputError(path, "is damaged: it refers to an image that is not in the plan");
        images.push_back(input.images[at(cluster.images[k])]);
        if (cluster.is_own[k] != 0) parts.reasons[at(cluster.images[k])] = cluster.reasons[k];
      }
      for (const ImagePair& pair : cluster.rejected_pairs)
        if (const auto found = pairs.find(pair); found != pairs.end())
          parts.refused_pairs.push_back(found->second);
      for (std::size_t m = 0; m < cluster.models.size(); ++m) {
        const PackedModel& packed = cluster.models[m];
        if (!fits(packed, packed.cameras.size(), images))
          throw InputError(path, "is damaged: its models do not fit their images");
        MappedPart& part = parts.parts.emplace_back();
        part.name = m == 0 ? fmt::format("cluster {}", info.shard)
                           : fmt::format("cluster {}, model {}", info.shard, m);
        part.model = model_of(packed, cluster, input);
      }
      parts.log.push_back(fmt::format("cluster {}: {} of {} images in {} models", info.shard,
                                      cluster.registered(), cluster.images.size(),
                                      cluster.models.size()));
    } catch (const InputError& error) {
      shards_.fail(error, ShardStage::kModel, info.shard);
    }
  }
  return parts;
}

ReconstructorResult ShardedReconstructor::merge(const ReconstructorOptions& options,
                                                Progress& progress, const std::stop_token& stop,
                                                const ReconstructorHooks& hooks) const {
  if (plan().clusters() == 0)
    throw InputError(shards_.path(),
                     "the plan has no clusters: make a plan with `tarsier sfm plan "
                     "--cluster-size`, or map all images together with `tarsier sfm map`");
  const ReadableImages readable = shards_.readable_images();
  const auto [pairs, from] = shards_.pairs(readable);
  const std::vector<ShardInfo> matches = shards_.require_all(ShardStage::kMatch, from);
  const std::vector<ShardInfo> clusters =
      shards_.require_all(ShardStage::kModel, checksum_of_shards(from, matches));
  ReconstructorHooks mapping = hooks;
  mapping.matched = [&, &chosen = pairs](MatchedImages& matched) {
    load(matched, readable, chosen, matches, progress, stop);
  };
  mapping.map = [&](const MapperInput& input, const MapperOptions& mapper,
                    const MapperHooks& checkpoints) {
    return map_joined(input, mapper, load_parts(clusters, input), progress, stop, checkpoints);
  };
  mapping.map_key = checksum_of_shards("", clusters);
  return Reconstructor(planned(options)).run_images(plan().inputs(), progress, stop, mapping);
}

ReconstructorResult ShardedReconstructor::map(const ReconstructorOptions& options,
                                              Progress& progress, const std::stop_token& stop,
                                              const ReconstructorHooks& hooks) const {
  const ReadableImages readable = shards_.readable_images();
  const auto [pairs, from] = shards_.pairs(readable);
  const std::vector<ShardInfo> matches = shards_.require_all(ShardStage::kMatch, from);
  ReconstructorHooks mapping = hooks;
  mapping.matched = [&, &chosen = pairs](MatchedImages& matched) {
    load(matched, readable, chosen, matches, progress, stop);
  };
  return Reconstructor(planned(options)).run_images(plan().inputs(), progress, stop, mapping);
}

}  // namespace tarsier::sfm
