// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/reconstructor.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/features/pairs.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/pipelines/model_files.h"
#include "tarsier/sfm/pipelines/report.h"
#include "tarsier/sfm/pipelines/results.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/colmap_binary.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

void write_report(const std::string& folder, const ReconstructorResult& result) {
  // The names of files may not be UTF-8.
  const std::string text =
      to_json(result).dump(1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  write_file_atomically((fs::path(folder) / "report.json").string(), text + "\n");
}

constexpr std::size_t kMaxStemBytes = 80;  // a file name has at most 255 bytes

// The name without extension, folders joined by "_": cam0_0001 for cam0/0001.jpg. Long names are
// cut off.
std::string flat_stem(const std::string& name) {
  std::string stem = fs::path(name).replace_extension().string();
  std::replace(stem.begin(), stem.end(), '/', '_');
  return stem.substr(0, kMaxStemBytes);
}

void write_match_image(const fs::path& folder, const ComparedPair& pair) {
  if (pair.matches.empty()) return;
  // Only the indices are unique: a/b.jpg and a_b.png have one stem.
  const std::string name =
      fmt::format("{}-{}-{}-{}.jpg", flat_stem(pair.first.name), flat_stem(pair.second.name),
                  pair.first_input, pair.second_input);
  write_image((folder / name).string(), draw_matches(pair));
}

void write_database(const std::string& path, const std::vector<ImageFeatures>& images,
                    const ImageSet& image_set, const std::vector<Pair>& pairs) {
  ColmapDatabase database;
  for (const geometry::Camera& camera : image_set.cameras()) database.cameras.push_back({camera});
  for (std::size_t k = 0; k < images.size(); ++k) {
    ColmapDatabase::DatabaseImage known;
    known.name = image_set.images()[k].name;
    known.camera = image_set.images()[k].camera;
    database.cameras[static_cast<std::size_t>(known.camera)].is_focal_known =
        std::string_view(images[k].lens.source) != "guess";
    known.features = images[k].features;
    // binary descriptors
    if (known.features.descriptors.cols != 128) known.features.descriptors.release();
    database.images.push_back(std::move(known));
  }
  for (const Pair& pair : pairs)
    if (!pair.view.inliers.empty())
      database.pairs.push_back({pair.first, pair.second, pair.view.inliers.copy(), pair.view});
  write_colmap_database(path, database);
}

}  // namespace

void ReconstructorOptions::check() const {
  pipeline.check();
  keyframes.check();
  placement.check();
  TARSIER_REQUIRE(
      !pipeline.camera || pipeline.camera->lens == geometry::Lens::kPinhole,
      "a {} lens, but reconstruction needs a pinhole camera: undistort the images first",
      geometry::name_of(pipeline.camera->lens));
  TARSIER_REQUIRE(
      !folder.empty() || !(undistorted || binary || database || turntable || match_images),
      "options 'undistorted', 'binary', 'database', 'turntable', 'match_images' need an output "
      "folder");
}

void use_features(PipelineOptions& options, FeatureKind kind) {
  options.features.kind = kind;
  if (kind == FeatureKind::kSift) return;
  options.matching.ratio = std::max(options.matching.ratio, 0.85);
  options.mapper.extend_similarity = 0.6;
}

nlohmann::ordered_json to_json(const ReconstructorResult& result) {
  nlohmann::ordered_json report = report_json(result.pipeline);
  if (nlohmann::ordered_json placed = to_json(result.placement); !placed.empty())
    report["placed"] = std::move(placed);
  if (!result.placement_error.empty()) report["not_placed"] = result.placement_error;
  return report;
}

Reconstructor::Reconstructor(ReconstructorOptions options) : options_(std::move(options)) {
  options_.check();
  if (options_.cache && options_.pipeline.cache_folder.empty() && !options_.folder.empty())
    options_.pipeline.cache_folder = (fs::path(options_.folder) / "cache").string();
  if (options_.placement.alignment == Alignment::kPositions)
    positions_ = read_positions_csv(options_.placement.positions_file);
}

std::string Reconstructor::frames_folder() const {
  return options_.folder.empty() ? "" : (fs::path(options_.folder) / "frames").string();
}

void Reconstructor::check_outputs() const {
  if (!options_.folder.empty()) {
    make_folder(options_.folder);
    // A run of this program leaves these files only beside a report: they would be lost.
    const bool has_report = fs::exists(fs::path(options_.folder) / "report.json");
    for (const char* name : {"cameras.bin", "rigs.txt", "frames.txt"})
      if (!has_report && fs::exists(fs::path(options_.folder) / name))
        throw OutputError(
            options_.folder,
            fmt::format(
                "the folder contains a model of another program ({}): choose another folder",
                name));
    // Throws where the folder is not writable.
    const AtomicFile writable((fs::path(options_.folder) / "report.json").string());
  }
  if (!options_.pipeline.cache_folder.empty()) make_folder(options_.pipeline.cache_folder);
}

// Detects before the work what would otherwise fail after it.
void Reconstructor::check_inputs(const std::vector<Input>& inputs) const {
  require_names(inputs);
  std::vector<std::string> names;
  for (const Input& input : inputs) {
    names.push_back(input.name);
    if (options_.undistorted && !is_image_path(input.name)) {
      throw InputError(input.path,
                       "undistorted images have the names of the input images, and this file "
                       "extension cannot be written: use .jpg, .png, .webp, .bmp, .ppm");
    }
  }
  if (options_.pipeline.pairs == PairChoice::kList)
    (void)read_pairs_list(options_.pipeline.pairs_file, names);
}

ReconstructorResult Reconstructor::run(const std::vector<std::string>& sources, Progress& progress,
                                       const std::stop_token& stop,
                                       const ReconstructorHooks& hooks) const {
  TARSIER_REQUIRE(!sources.empty(), "no images to reconstruct from");
  check_outputs();
  const std::vector<Input> inputs =
      find_inputs(sources, options_.keyframes, frames_folder(), progress, stop);
  require_two_images(inputs, sources.front());
  return run_images(inputs, progress, stop, hooks);
}

ReconstructorResult Reconstructor::run_images(const std::vector<Input>& inputs, Progress& progress,
                                              const std::stop_token& stop,
                                              const ReconstructorHooks& hooks) const {
  check_outputs();
  require_two_images(inputs, inputs.empty() ? "images" : inputs.front().path);
  check_inputs(inputs);
  const PlacementContext context{
      inputs,
      positions_of(options_.placement, positions_, inputs, stop, options_.pipeline.database),
      progress, stop};

  PipelineHooks pipeline_hooks;
  pipeline_hooks.partial = true;
  pipeline_hooks.watch = hooks.watch;
  pipeline_hooks.show = hooks.show;
  pipeline_hooks.matched = hooks.matched;
  pipeline_hooks.map = hooks.map;
  pipeline_hooks.map_key = hooks.map_key;
  if (options_.match_images) {
    const fs::path folder = fs::path(options_.folder) / "matches";
    make_folder(folder.string());
    pipeline_hooks.on_pair = [folder, warned = false](const ComparedPair& pair) mutable {
      try {
        write_match_image(folder, pair);
      } catch (const Error& error) {
        if (!warned) log_warning("cannot write an image of matches: {}", error.what());
        warned = true;
      }
    };
  }
  if (options_.database) {
    pipeline_hooks.on_matched = [&](const std::vector<ImageFeatures>& images,
                                    const ImageSet& image_set, const std::vector<Pair>& pairs) {
      write_database((fs::path(options_.folder) / "database.db").string(), images, image_set,
                     pairs);
    };
  }
  ReconstructorResult result;
  // Other runs have chosen their pairs already.
  result.pipeline = run_pipeline(
      hooks.matched ? inputs : with_camera_positions(inputs, positions_, options_.pipeline, stop),
      options_.pipeline, progress, stop, pipeline_hooks);
  result.pipeline.names_files = options_.names_files;
  write_models(result, context);
  if (hooks.on_models) hooks.on_models(result);
  if (result.interrupted()) return result;
  for (std::size_t m = 0; m < result.models().size(); ++m) {
    const std::string folder = model_folder(options_.folder, static_cast<int>(m));
    if (options_.binary) write_colmap_binary(folder, result.models()[m]);
    if (options_.turntable) write_turntable(folder, result.models()[m]);
    if (options_.undistorted) write_undistorted(folder, result.models()[m], inputs, progress, stop);
  }
  return result;
}

void Reconstructor::place_largest(ReconstructorResult& result,
                                  const PlacementContext& context) const {
  Model& model = result.pipeline.reconstruction.models[0];
  const auto path_of = [&](const std::string& name) {
    const auto input = std::find_if(context.inputs.begin(), context.inputs.end(),
                                    [&](const Input& each) { return each.name == name; });
    return input == context.inputs.end() ? name : input->path;
  };
  try {
    std::optional<MarkerScale> markers;
    if (options_.placement.markers)
      markers =
          marker_scale(model, path_of, *options_.placement.markers, context.progress, context.stop);
    result.placement =
        place(model, options_.placement, context.known, options_.pipeline.seed, markers);
  } catch (const Interrupted&) {
    throw;
  } catch (const Error& error) {
    result.placement_error = error.what();
  }
}

void Reconstructor::write_models(ReconstructorResult& result,
                                 const PlacementContext& context) const {
  const std::vector<Model>& models = result.models();
  const std::string& folder = options_.folder;
  const bool is_placed = !models.empty() && options_.placement.any();
  if (folder.empty()) {
    if (is_placed) place_largest(result, context);
    return;
  }
  const auto earlier = earlier_run(folder);
  if (result.interrupted() && earlier && !earlier->partial &&
      earlier->registered >= statistics_of(models.front()).registered) {
    log_warning("interrupted: the finished model of an earlier run in {} was not replaced", folder);
    result.kept_earlier_model = true;
    return;
  }
  const auto folder_of = [&](std::size_t m) { return model_folder(folder, static_cast<int>(m)); };
  for (std::size_t m = 0; m < models.size(); ++m) {
    remove_replaced_files(folder_of(m));
    if (m > 0) begin_model_folder(folder, static_cast<int>(m));
    write_model(folder_of(m), models[m]);
  }
  write_report(folder, result);
  if (!models.empty()) remove_old_models(folder, static_cast<int>(models.size()), earlier);
  if (is_placed) {
    place_largest(result, context);
    if (result.placement_error.empty()) write_model(folder, models[0]);
    write_report(folder, result);
  }
  for (std::size_t m = 0; m < models.size(); ++m) write_views(folder_of(m), models[m]);
}

}  // namespace tarsier::sfm
