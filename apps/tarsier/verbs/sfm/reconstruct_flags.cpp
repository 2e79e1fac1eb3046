// SPDX-License-Identifier: MIT
#include "verbs/sfm/reconstruct_flags.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/camera_file.h"

#include <fmt/format.h>

#include "framework/bind.h"
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
    throw InputError(
        flags.camera_file.empty() ? flags.camera : flags.camera_file,
        fmt::format("is of a {} lens, and reconstruction takes pinhole ones: straighten "
                    "the images first (tarsier calibrate --undistorted)",
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
  options.flow = flags.matches == "flow";
  if (options.flow && flags.online.online)
    throw UsageError("--online: compares descriptors, --matches flow is not possible");
}

void complete_placement(const ReconstructFlags& flags, sfm::ReconstructorOptions& all) {
  sfm::PlacementOptions& options = all.placement;
  if (flags.align == "gps") {
    options.alignment = sfm::Alignment::kGps;
  } else if (!flags.align.empty()) {
    options.alignment = sfm::Alignment::kPositions;
    options.positions_file = flags.align;
  }
  if (flags.distance_between.empty()) {
    if (flags.distance != 0) throw UsageError("--distance needs --distance-between");
    return;
  }
  if (!(flags.distance > 0 && std::isfinite(flags.distance)))
    throw UsageError("--distance-between needs --distance, above 0");
  if (flags.distance_between[0] == flags.distance_between[1])
    throw UsageError("--distance-between: expected the names of two images");
  options.distance =
      sfm::KnownDistance{flags.distance_between[0], flags.distance_between[1], flags.distance};
}

}  // namespace

sfm::ReconstructorOptions options_of(const ReconstructFlags& flags, const Context& context) {
  sfm::ReconstructorOptions options = flags.options;
  complete_lens(flags, options);
  complete_matching(flags, options);
  complete_placement(flags, options);
  options.undistorted = !flags.exports.empty();
  options.cache = !flags.no_cache;
  options.pipeline.seed = context.seed;
  return options;
}

void add_reconstruct_flags(Command& verb, ReconstructFlags& flags) {
  sfm::PipelineOptions& pipeline = flags.options.pipeline;
  verb.add_option("PHOTOS", flags.inputs,
                  "folder, images, glob, @list.txt, or a video; with --online also a camera")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.options.folder, "folder for the model").required();
  const auto lens = [](Flag& flag) { flag.group("Lens"); };
  lens(verb.add_option("--camera", flags.camera, "fx,fy,cx,cy[,k1,k2,p1,p2[,k3]], px"));
  lens(verb.add_option("--camera-file", flags.camera_file,
                       "camera.yaml, OpenCV's YAML, COLMAP's cameras.txt"));
  lens(verb.add_option("--refine", flags.refine, "focal, center, distortion; or none")
           .delimiter(',')
           .check(one_of({"focal", "center", "distortion", "none"})));
  lens(bind_field(verb, pipeline, pipeline.ignore_exif));
  lens(verb.add_flag("--per-image-camera", flags.per_image_camera,
                     "a camera for each image, not one for all of a size"));
  const auto match = [](Flag& flag) { flag.group("Features and matches"); };
  match(verb.add_option("--features", flags.features, "sift, orb, akaze")
            .check(one_of({"sift", "orb", "akaze"}))
            .show_default());
  bind_all(verb, pipeline.features, "Features and matches");
  match(verb.add_option("--downscale", flags.downscale, "look at images reduced by this")
            .show_default());
  match(verb.add_option("--pairs", flags.pairs,
                        "auto, exhaustive, sequential, retrieval, or a file with two names a line")
            .show_default());
  match(bind_field(verb, pipeline, pipeline.overlap));
  match(bind_field(verb, pipeline, pipeline.nearest));
  match(verb.add_option("--matches", flags.matches,
                        "sift: descriptors; flow: follow points from frame to frame")
            .check(one_of({"sift", "flow"}))
            .show_default());
  bind_all(verb, pipeline.matching, "Features and matches");
  bind_all(verb, pipeline.two_view, "Features and matches");
  bind_all(verb, pipeline.mapper, "Mapping");
  const auto out = [](Flag& flag) { flag.group("Result"); };
  out(verb.add_option("--align", flags.align,
                      "name,x,y,z lines with where images were taken; or gps: from EXIF"));
  out(verb.add_option("--distance", flags.distance,
                      "between two cameras, in any unit: the model's from then on [none]"));
  out(verb.add_option("--distance-between", flags.distance_between, "their images' names")
          .expected(2));
  out(verb.add_option("--export", flags.exports, "undistorted: images and model for dense tools")
          .check(one_of({"undistorted"})));
  out(verb.add_flag("--turntable", flags.options.turntable, "turntable.gif: the cloud, turning"));
  out(verb.add_flag("--match-images", flags.options.match_images,
                    "matches/: each pair, kept green, removed red"));
  out(verb.add_flag("--growing", flags.growing,
                    "growing/: the model so far, each second at most, until it is done"));
  out(verb.add_flag("--no-cache", flags.no_cache, "keep nothing for a second run"));
  out(bind_field(verb, pipeline, pipeline.checkpoint_s));
  bind_all(verb, flags.options.keyframes, "Videos");
  add_online_flags(verb, flags.online);
}

}  // namespace tarsier::cli
