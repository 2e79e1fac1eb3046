// SPDX-License-Identifier: MIT
#include "verbs/sfm/reconstruct_flags.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/camera_file.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/sfm/memory_flag.h"
#include "verbs/sfm/sfm.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

namespace tarsier::cli {
namespace {

void complete_lens(const ReconstructFlags& flags, sfm::ReconstructorOptions& all) {
  sfm::PipelineOptions& options = all.pipeline;
  if (!flags.camera.empty() && !flags.camera_file.empty())
    throw UsageError("--camera and --camera-file: give one of them");
  if (!flags.camera.empty()) options.camera = geometry::parse_camera(flags.camera);
  if (!flags.camera_file.empty()) options.camera = geometry::read_camera_file(flags.camera_file);
  if (options.camera && options.camera->lens != geometry::Lens::kPinhole) {
    throw InputError(flags.camera_file.empty() ? flags.camera : flags.camera_file,
                     fmt::format("has a {} lens, but reconstruction needs a pinhole camera: "
                                 "undistort the images first (tarsier calibrate --undistorted)",
                                 geometry::name_of(options.camera->lens)));
  }
  options.shared_camera = !flags.per_image_camera;
  for (const std::string& what : flags.refine) {
    if (what == "focal") options.mapper.refine_focal = true;
    if (what == "center") options.mapper.refine_center = true;
    if (what == "distortion") options.mapper.refine_distortion = true;
    if (what == "none") options.fixed_camera = true;
  }
}

void complete_matching(const ReconstructFlags& flags, sfm::ReconstructorOptions& all) {
  sfm::PipelineOptions& options = all.pipeline;
  static const std::map<std::string, sfm::FeatureKind> kinds{{"sift", sfm::FeatureKind::kSift},
                                                             {"orb", sfm::FeatureKind::kOrb},
                                                             {"akaze", sfm::FeatureKind::kAkaze}};
  sfm::use_features(options, kinds.at(flags.features));
  if (!(flags.downscale >= 1 && flags.downscale <= 16))
    throw UsageError(fmt::format("--downscale {}: expected 1..16", flags.downscale));
  options.features.max_pixels /= flags.downscale * flags.downscale;
  static const std::map<std::string, sfm::PairChoice> choices{
      {"auto", sfm::PairChoice::kAuto},
      {"exhaustive", sfm::PairChoice::kExhaustive},
      {"sequential", sfm::PairChoice::kSequential},
      {"retrieval", sfm::PairChoice::kRetrieval}};
  if (const auto choice = choices.find(flags.pairs); choice != choices.end()) {
    options.pairs = choice->second;
  } else {
    options.pairs = sfm::PairChoice::kList;
    options.pairs_file = flags.pairs;
    if (!std::filesystem::exists(flags.pairs))
      throw UsageError(
          fmt::format("--pairs '{}': expected auto, exhaustive, sequential, retrieval "
                      "or a file with two names a line",
                      flags.pairs));
  }
  static const std::map<std::string, sfm::MapperChoice> mappers{
      {"auto", sfm::MapperChoice::kAuto},
      {"incremental", sfm::MapperChoice::kIncremental},
      {"global", sfm::MapperChoice::kGlobal}};
  options.mapper.choice = mappers.at(flags.mapper);
  options.flow = flags.matches == "flow";
  if (!options.database.empty() && (options.flow || flags.online.online))
    throw UsageError(
        "--database contains the matches: not possible with --matches flow or --online, which "
        "compute matches themselves");
  if (options.features.wide && options.features.kind != sfm::FeatureKind::kSift)
    throw UsageError("--wide simulates views for SIFT: use --features sift");
  if (options.features.wide && (options.flow || !options.database.empty()))
    throw UsageError(
        "--wide detects features in images: not possible with --database or --matches flow");
  if (flags.inputs.empty()) {
    if (options.database.empty()) throw UsageError("PHOTOS is required");
    if (flags.dense || flags.mesh || flags.options.match_images ||
        std::find(flags.exports.begin(), flags.exports.end(), "undistorted") != flags.exports.end())
      throw UsageError(
          "--dense, --mesh, --match-images, --export undistorted: need the images, not only "
          "--database");
  }
  if (options.flow && flags.online.online)
    throw UsageError("--online compares descriptors: not possible with --matches flow");
}

void check_start(const ReconstructFlags& flags, const sfm::ReconstructorOptions& all) {
  const sfm::PipelineOptions& options = all.pipeline;
  if (options.start_model.empty()) {
    if (options.fixed_poses || options.only_start)
      throw UsageError("--fixed-poses, --only-start-images: need --start-model");
    return;
  }
  if (flags.mapper == "global")
    throw UsageError(
        "--start-model continues image by image: not possible with --mapper global, which computes "
        "all poses");
  if (flags.online.online)
    throw UsageError(
        "--start-model is not possible with --online, which begins with the first frames");
  if (options.fixed_poses && all.placement.any())
    throw UsageError("--fixed-poses: --align, --distance and --marker-size would move the poses");
}

void complete_placement(const ReconstructFlags& flags, sfm::ReconstructorOptions& all) {
  sfm::PlacementOptions& options = all.placement;
  if (flags.align == "gps") {
    options.alignment = sfm::Alignment::kGps;
  } else if (!flags.align.empty()) {
    options.alignment = sfm::Alignment::kPositions;
    options.positions_file = flags.align;
  }
  set_scale(flags.scale, options);
}

void add_lens_flags(Command& verb, ReconstructFlags& flags) {
  sfm::PipelineOptions& pipeline = flags.options.pipeline;
  const auto lens = [](Flag& flag) { flag.group("Lens"); };
  lens(verb.add_option("--camera", flags.camera,
                       "camera parameters fx,fy,cx,cy[,k1,k2,p1,p2[,k3]], px"));
  lens(verb.add_option("--camera-file", flags.camera_file,
                       "camera file: camera.yaml, OpenCV's YAML, COLMAP's cameras.txt"));
  lens(verb.add_option("--refine", flags.refine,
                       "camera parameters to refine: focal, center, distortion; or none")
           .delimiter(',')
           .check(one_of({"focal", "center", "distortion", "none"})));
  lens(bind_field(verb, pipeline, pipeline.ignore_exif));
  lens(verb.add_flag("--per-image-camera", flags.per_image_camera,
                     "estimate one camera for each image, not one for all images of a size"));
}

// `is_whole`: for a verb that runs all stages. It may also take matches from elsewhere.
void add_match_flags(Command& verb, ReconstructFlags& flags, bool is_whole) {
  sfm::PipelineOptions& pipeline = flags.options.pipeline;
  const auto match = [](Flag& flag) { flag.group("Features and matches"); };
  match(verb.add_option("--features", flags.features, "feature type: sift, orb, akaze")
            .check(one_of({"sift", "orb", "akaze"}))
            .show_default());
  bind_all(verb, pipeline.features, "Features and matches");
  match(verb.add_option("--downscale", flags.downscale,
                        "factor by which images are reduced for feature extraction")
            .show_default());
  match(verb.add_option("--pairs", flags.pairs,
                        "auto, exhaustive, sequential, retrieval; or a file with two names per "
                        "line")
            .suggest({"auto", "exhaustive", "sequential", "retrieval"})
            .show_default());
  match(bind_field(verb, pipeline, pipeline.overlap));
  match(bind_field(verb, pipeline, pipeline.nearest));
  if (is_whole) {
    match(verb.add_option(
        "--database", pipeline.database,
        "COLMAP database with features, matches and cameras of the images, by name"));
    match(verb.add_option("--matches", flags.matches,
                          "sift: match descriptors; flow: track points from frame to frame")
              .check(one_of({"sift", "flow"}))
              .show_default());
  }
  bind_all(verb, pipeline.matching, "Features and matches");
  bind_all(verb, pipeline.two_view, "Features and matches");
}

void add_mapping_flags(Command& verb, ReconstructFlags& flags) {
  verb.add_option("--mapper", flags.mapper,
                  "incremental: image by image; global: all at once; auto: global for large sets")
      .group("Mapping")
      .check(one_of({"auto", "incremental", "global"}))
      .show_default();
  bind_all(verb, flags.options.pipeline.mapper, "Mapping");
}

void add_start_flags(Command& verb, ReconstructFlags& flags) {
  sfm::PipelineOptions& pipeline = flags.options.pipeline;
  verb.add_option("--start-model", pipeline.start_model,
                  "start from the poses and cameras of this model (COLMAP or earlier run); images "
                  "match by name")
      .group("Mapping");
  verb.add_flag("--fixed-poses", pipeline.fixed_poses,
                "keep the poses of --start-model fixed; triangulate points, register other images")
      .group("Mapping");
  verb.add_flag("--only-start-images", pipeline.only_start,
                "use only images that are in --start-model")
      .group("Mapping");
}

// `is_whole`: for a verb that may take positions from a database.
void add_placement_flags(Command& verb, ReconstructFlags& flags, bool is_whole) {
  const auto out = [](Flag& flag) { flag.group("Result"); };
  out(verb.add_option("--align", flags.align,
                      std::string("align to camera positions: file of name,x,y,z lines; or gps: "
                                  "from EXIF") +
                          (is_whole ? ", else the pose priors of --database" : "")));
  add_scale_flags(verb, flags.scale, "Result");
  out(verb.add_option("--export", flags.exports,
                      "undistorted: images and model for dense tools; binary: COLMAP model; "
                      "database: COLMAP database.db")
          .check(one_of({"undistorted", "binary", "database"})));
}

void add_turntable_flag(Command& verb, ReconstructFlags& flags, const char* help) {
  verb.add_flag("--turntable", flags.options.turntable, help).group("Result");
}

void add_cache_flags(Command& verb, ReconstructFlags& flags) {
  sfm::PipelineOptions& pipeline = flags.options.pipeline;
  verb.add_flag("--no-cache", flags.no_cache, "do not cache features and matches for later runs")
      .group("Result");
  verb.add_option(
          "--memory", flags.memory,
          "move descriptors and matches to disk above this memory: 2GB, 800MB [when not in use]")
      .group("Result");
  bind_field(verb, pipeline, pipeline.checkpoint_s).group("Result");
}

// All options except those that determine the model.
sfm::ReconstructorOptions result_options(const ReconstructFlags& flags) {
  sfm::ReconstructorOptions options = flags.options;
  complete_placement(flags, options);
  const auto is_requested = [&](const char* what) {
    return std::find(flags.exports.begin(), flags.exports.end(), what) != flags.exports.end();
  };
  options.undistorted = is_requested("undistorted");
  options.binary = is_requested("binary");
  options.database = is_requested("database");
  options.cache = !flags.no_cache;
  if (!flags.memory.empty()) {
    if (flags.no_cache)
      throw UsageError(
          "--memory stores descriptors and matches in the cache folder: not possible with "
          "--no-cache");
    options.pipeline.memory_gb = parse_memory(flags.memory);
  }
  options.names_files = !is_in_studio();
  return options;
}

}  // namespace

sfm::ReconstructorOptions options_of(const ReconstructFlags& flags, const Context& context) {
  sfm::ReconstructorOptions options = result_options(flags);
  complete_lens(flags, options);
  complete_matching(flags, options);
  check_start(flags, options);
  options.pipeline.seed = context.seed;
  return options;
}

sfm::ReconstructorOptions map_options_of(const ReconstructFlags& flags) {
  return result_options(flags);
}

void add_plan_flags(Command& verb, ReconstructFlags& flags) {
  verb.add_option("PHOTOS", flags.inputs, "folder, images, glob, @list.txt or video")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.options.folder, "work folder of all shards").required();
  add_lens_flags(verb, flags);
  add_match_flags(verb, flags, false);
  add_mapping_flags(verb, flags);
  bind_all(verb, flags.options.keyframes, "Videos");
}

void add_map_flags(Command& verb, ReconstructFlags& flags, bool needs_output) {
  Flag& output = verb.add_option("-o,--output", flags.options.folder, "output folder of the model");
  if (needs_output) output.required();
  add_placement_flags(verb, flags, false);
  add_turntable_flag(verb, flags, "write turntable.gif, the rotating point cloud");
  add_cache_flags(verb, flags);
}

void add_reconstruct_flags(Command& verb, ReconstructFlags& flags) {
  verb.add_option("PHOTOS", flags.inputs,
                  "folder, images, glob, @list.txt or video; with --online also a camera; none: "
                  "all of --database")
      .type_name("");
  verb.add_option("-o,--output", flags.options.folder, "output folder of the model").required();
  add_lens_flags(verb, flags);
  add_match_flags(verb, flags, true);
  add_mapping_flags(verb, flags);
  add_start_flags(verb, flags);
  add_placement_flags(verb, flags, true);
  const auto out = [](Flag& flag) { flag.group("Result"); };
  out(verb.add_flag("--dense", flags.dense,
                    "also compute depth maps and a dense cloud in dense/, as `sfm dense` does"));
  out(verb.add_flag(
      "--mesh", flags.mesh,
      "also compute a textured surface: mesh.glb, mesh.png, mesh.html; implies --dense"));
  out(verb.add_option("--dense-quality", flags.dense_flags.quality,
                      "dense quality: draft, normal, high")
          .check(one_of({"draft", "normal", "high"}))
          .show_default());
  add_turntable_flag(verb, flags,
                     "write turntable.gif, the rotating point cloud; with --mesh also mesh.gif");
  out(verb.add_flag("--match-images", flags.options.match_images,
                    "write an image of each pair to matches/: inliers green, outliers red"));
  out(verb.add_flag("--growing", flags.growing,
                    "write the unfinished model to growing/, at most once a second"));
  add_cache_flags(verb, flags);
  bind_all(verb, flags.options.keyframes, "Videos");
  add_online_flags(verb, flags.online);
}

}  // namespace tarsier::cli
