// SPDX-License-Identifier: MIT
// A reconstruction by shards: plan, features, match, map, merge.
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/pipelines/model_merger.h"
#include "tarsier/sfm/pipelines/plan.h"
#include "tarsier/sfm/pipelines/report.h"
#include "tarsier/sfm/pipelines/shard_commands.h"
#include "tarsier/sfm/pipelines/sharded_reconstructor.h"
#include "tarsier/sfm/scene/align.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "framework/part_info.h"
#include "verbs/sfm/reconstruct_flags.h"
#include "verbs/sfm/sfm.h"
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

struct PlanFlags {
  ReconstructFlags reconstruct;
  int shards = 1;
  int cluster_size = 0;
  std::string positions;
  bool slurm = false;
};

// The positions of a file; throws InputError where none is of an input.
sfm::Positions positions_for(const std::string& file, const std::vector<sfm::Input>& inputs) {
  if (file.empty()) return {};
  sfm::Positions known = sfm::read_positions_csv(file);
  if (std::none_of(inputs.begin(), inputs.end(),
                   [&](const sfm::Input& input) { return known.contains(input.name); }))
    throw InputError(file, fmt::format("no name belongs to an image (the first image is '{}')",
                                       printable(inputs.front().name)));
  return known;
}

std::string clusters_text(int clusters) {
  return clusters == 0 ? "" : fmt::format(", {} cluster{}", clusters, clusters == 1 ? "" : "s");
}

ExitStatus make_plan(const PlanFlags& flags, Context& context) {
  const sfm::ReconstructorOptions options = options_of(flags.reconstruct, context);
  options.check();
  const std::string folder = fs::absolute(options.folder).lexically_normal().string();
  const std::vector<std::string>& sources = flags.reconstruct.inputs;
  expect_files(sources);
  const std::vector<sfm::Input> inputs =
      sfm::find_inputs(sources, options.keyframes, (fs::path(folder) / "frames").string(),
                       *context.progress, context.stop);
  sfm::require_two_images(inputs, sources.front());
  const sfm::Plan plan =
      sfm::write_plan(options.folder, inputs, options.pipeline, flags.shards, *context.progress,
                      context.stop, flags.cluster_size, positions_for(flags.positions, inputs));
  const auto unreadable =
      std::count_if(plan.images.begin(), plan.images.end(),
                    [](const sfm::PlannedImage& image) { return image.sha256.empty(); });
  sfm::ClusterJob job;
  job.program = (fs::path(program_folder()) / "tarsier").string();
  job.folder = folder;
  job.model = (fs::path(folder) / "model").string();
  job.shards = plan.shards;
  job.clusters = plan.clusters();
  job.has_pairs_stage = sfm::ShardedReconstructor(options.folder).has_pairs_stage();
  const std::string script = (fs::path(options.folder) / "sfm.sbatch").string();
  if (flags.slurm) write_file_atomically(script, sfm::slurm_script(job));
  const std::vector<std::string> commands = sfm::parallel_commands(job);
  if (context.json) {
    nlohmann::ordered_json line{{"output", options.folder},
                                {"images", plan.images.size()},
                                {"unreadable", unreadable},
                                {"shards", plan.shards},
                                {"commands", commands}};
    if (plan.clusters() > 0) line["clusters"] = plan.clusters();
    if (flags.slurm) line["slurm"] = script;
    print_json(line);
    return ExitStatus::kDone;
  }
  std::string text =
      fmt::format("{}: {} images{}, {} shard{}{}\n", options.folder, plan.images.size(),
                  unreadable > 0 ? fmt::format(" ({} cannot be read)", unreadable) : "",
                  plan.shards, plan.shards == 1 ? "" : "s", clusters_text(plan.clusters()));
  if (flags.slurm) text += fmt::format("with Slurm:\n  bash {}\n", sfm::shell_word(script));
  text += fmt::format("with GNU parallel:\n  {}\n", fmt::join(commands, "\n  "));
  print_text(text);
  return ExitStatus::kDone;
}

void add_flags(Command& verb, PlanFlags& flags) {
  add_plan_flags(verb, flags.reconstruct);
  verb.add_option("--shards", flags.shards, "number of shards for features and matches")
      .check(range(1, sfm::kMaxShards))
      .show_default();
  verb.add_option(
          "--cluster-size", flags.cluster_size,
          "map clusters of this many images separately, for `sfm merge` [all images together]")
      .check(range(sfm::kMinClusterSize, 1'000'000));
  verb.add_option(
      "--positions", flags.positions,
      "camera positions that guide the choice of pairs by retrieval: file of name,x,y,z "
      "lines [from EXIF]");
  verb.add_flag("--slurm", flags.slurm, "write sfm.sbatch, a script that submits all stages");
}

struct ShardFlags {
  std::string folder;
  std::string shard;
  bool pairs_only = false;
};

// The requested shards: one, or all.
Shard first_and_last(const ShardFlags& flags, const sfm::Plan& plan) {
  if (flags.shard.empty()) return {1, plan.shards};
  const Shard shard = parse_shard(flags.shard);
  if (shard.count != plan.shards)
    throw UsageError(fmt::format("--shard {}: the plan has {} shard{}", flags.shard, plan.shards,
                                 plan.shards == 1 ? "" : "s"));
  return {shard.number, shard.number};
}

void print_report(const sfm::ShardReport& report, const Context& context) {
  if (context.json) {
    print_json(sfm::to_json(report));
    return;
  }
  if (context.quiet) return;
  if (report.stage == sfm::ShardStage::kModel) {
    print_text(fmt::format("cluster {}/{}: {} images ({} of its own), {} in {} model{}{}\n",
                           report.shard, report.shards, report.count, report.own, report.registered,
                           report.models, report.models == 1 ? "" : "s",
                           report.was_done ? " (done before)" : ""));
    return;
  }
  const bool is_images = report.stage == sfm::ShardStage::kFeatures;
  const std::string which = report.stage == sfm::ShardStage::kPairs
                                ? std::string()
                                : fmt::format(" {}/{}", report.shard, report.shards);
  print_text(fmt::format("{}{}: {} {}{}{}\n", sfm::name_of(report.stage), which, report.count,
                         is_images ? "images" : "pairs",
                         report.left_out > 0 ? fmt::format(", {} left out", report.left_out) : "",
                         report.was_done ? " (done before)" : ""));
}

ExitStatus find_features(const ShardFlags& flags, Context& context) {
  const sfm::ShardedReconstructor sharded(flags.folder);
  const Shard selected = first_and_last(flags, sharded.plan());
  for (int shard = selected.number; shard <= selected.count; ++shard)
    print_report(sharded.find_features(shard, *context.progress, context.stop), context);
  return ExitStatus::kDone;
}

ExitStatus match(const ShardFlags& flags, Context& context) {
  const sfm::ShardedReconstructor sharded(flags.folder);
  if (flags.pairs_only) {
    if (!flags.shard.empty())
      throw UsageError("--pairs-only selects the pairs of all shards: omit --shard");
    print_report(sharded.choose_pairs(*context.progress, context.stop), context);
    return ExitStatus::kDone;
  }
  const Shard selected = first_and_last(flags, sharded.plan());
  for (int shard = selected.number; shard <= selected.count; ++shard)
    print_report(sharded.match(shard, *context.progress, context.stop), context);
  return ExitStatus::kDone;
}

void add_work_folder(Command& verb, std::string& folder) {
  verb.add_option("WORK", folder, "work folder of `sfm plan`").required().type_name("");
}

void add_shard_flags(Command& verb, ShardFlags& flags) {
  add_work_folder(verb, flags.folder);
  verb.add_option("--shard", flags.shard, "shard i of N, 3/8 [all unfinished shards]");
}

void add_match_flags(Command& verb, ShardFlags& flags) {
  add_shard_flags(verb, flags);
  verb.add_flag("--pairs-only", flags.pairs_only,
                "only select the image pairs, once for all shards");
}

struct MapFlags {
  std::string folder;
  std::string cluster;
  ReconstructFlags reconstruct;
};

// The requested clusters: one, or all.
Shard first_and_last_cluster(const std::string& text, const sfm::Plan& plan) {
  const int clusters = plan.clusters();
  if (clusters == 0)
    throw UsageError(
        "--cluster: the plan has no clusters: make a plan with `tarsier sfm plan --cluster-size`");
  if (text == "all") return {1, clusters};
  const Shard selected = parse_shard(text, "--cluster");
  if (selected.count != clusters)
    throw UsageError(fmt::format("--cluster {}: the plan has {} cluster{}", text, clusters,
                                 clusters == 1 ? "" : "s"));
  return {selected.number, selected.number};
}

ExitStatus map(const MapFlags& flags, Context& context) {
  const sfm::ReconstructorOptions options = map_options_of(flags.reconstruct);
  if (flags.cluster.empty() == options.folder.empty())
    throw UsageError(flags.cluster.empty()
                         ? "-o is required, or --cluster"
                         : "-o: --cluster writes into WORK; `sfm merge` computes the whole model");
  const sfm::ShardedReconstructor sharded(flags.folder);
  if (!flags.cluster.empty()) {
    if (options.placement.any() || options.binary || options.undistorted || options.database ||
        options.turntable)
      throw UsageError(
          "--align, --distance, --marker-size, --export, --turntable: pass them to `sfm merge`, "
          "not with --cluster");
    const Shard selected = first_and_last_cluster(flags.cluster, sharded.plan());
    for (int cluster = selected.number; cluster <= selected.count; ++cluster)
      print_report(sharded.map_cluster(cluster, options, *context.progress, context.stop), context);
    return ExitStatus::kDone;
  }
  sfm::ReconstructorHooks hooks;
  hooks.on_models = [&](const sfm::ReconstructorResult& result) {
    print_models(result, options.folder, context);
  };
  const sfm::ReconstructorResult result =
      sharded.map(options, *context.progress, context.stop, hooks);
  return status_of(result);
}

void add_flags(Command& verb, MapFlags& flags) {
  add_work_folder(verb, flags.folder);
  verb.add_option("--cluster", flags.cluster, "cluster i of N, 3/8; all: all unfinished clusters");
  add_map_flags(verb, flags.reconstruct, false);
}

struct ModelMergeFlags {
  std::vector<std::string> folders;
  ReconstructFlags reconstruct;
};

ExitStatus merge(const ModelMergeFlags& flags, Context& context) {
  sfm::ReconstructorOptions options = map_options_of(flags.reconstruct);
  options.pipeline.seed = context.seed;
  sfm::ReconstructorHooks hooks;
  hooks.on_models = [&](const sfm::ReconstructorResult& result) {
    print_models(result, options.folder, context);
  };
  if (flags.folders.size() == 1) {
    const sfm::ShardedReconstructor sharded(flags.folders.front());
    return status_of(sharded.merge(options, *context.progress, context.stop, hooks));
  }
  if (options.undistorted || options.database || flags.reconstruct.align == "gps" ||
      options.placement.markers)
    throw UsageError(
        "--export undistorted and database, --align gps, --marker-size: need the images of a plan, "
        "not only models");
  return status_of(
      sfm::merge_models(flags.folders, options, *context.progress, context.stop, hooks));
}

void add_flags(Command& verb, ModelMergeFlags& flags) {
  verb.add_option(
          "WORK", flags.folders,
          "work folder of `sfm plan` with mapped clusters, or folders of two or more models")
      .required()
      .type_name("");
  add_map_flags(verb, flags.reconstruct, true);
}

}  // namespace

void add_sfm_shards(Command& sfm, Context& context) {
  add_verb<PlanFlags>(sfm, "plan", "plan a reconstruction that is divided among several runs",
                      context, add_flags, make_plan);
  add_verb<ShardFlags>(sfm, "features", "extract the features of one shard", context,
                       add_shard_flags, find_features);
  add_verb<ShardFlags>(sfm, "match", "match the image pairs of one shard", context, add_match_flags,
                       match);
  add_verb<MapFlags>(sfm, "map", "compute the model of a plan from its finished shards", context,
                     add_flags, map);
  add_verb<ModelMergeFlags>(sfm, "merge",
                            "merge models that share images, if the merge is reliable", context,
                            add_flags, merge);
}

}  // namespace tarsier::cli
