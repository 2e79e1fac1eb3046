// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/pipeline.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/sfm/features/mapped_store.h"
#include "tarsier/sfm/mapper/center_uncertainty.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/cache.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/pipelines/mapper_key.h"
#include "tarsier/sfm/pipelines/matched_input.h"
#include "tarsier/sfm/pipelines/start_model.h"
#include "tarsier/sfm/pipelines/upright_model.h"
#include "tarsier/sfm/reconstruction/reconstruct.h"
#include "tarsier/sfm/reconstruction/strong_pairs.h"
#include "tarsier/sfm/scene/sensor_image.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kGoodTrust = 0.9;
// Changes of the logarithm of a focal length:
constexpr double kMinRemapChange = 0.15;  // the old value was wrong
constexpr double kMinReevaluateChange = 0.02;

class Stages {
 public:
  Stages(PipelineResult& result, Progress& progress) : result_(result), progress_(progress) {}
  void begin(const char* name, std::int64_t total, const char* unit) {
    progress_.begin(name, total, unit);
    start(name);
  }
  void end() {
    progress_.end();
    record();
  }
  // As above, for a stage with its own progress.
  void start(const char* name) {
    name_ = name;
    start_ = std::chrono::steady_clock::now();
    cpu_start_ = cpu_seconds();
  }
  void record() {
    result_.stages.push_back(
        {name_, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count(),
         cpu_seconds() - cpu_start_});
  }

 private:
  static double cpu_seconds() {
    timespec now{};
    if (clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) != 0) return 0;
    return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
  }

  PipelineResult& result_;
  Progress& progress_;
  std::string name_;
  std::chrono::steady_clock::time_point start_;
  double cpu_start_ = 0;
};

// Reads the files again, for the mapper. Files that can no longer be read or have changed are left
// out.
GrayImages gray_images(const std::vector<Input>& inputs, const std::vector<ImageFeatures>& images) {
  return [&inputs, &images](int image) {
    const ImageFeatures& features = images[at(image)];
    const std::string& path = inputs[at(features.input)].path;
    if (path.empty()) return cv::Mat();
    cv::Mat gray;
    try {
      gray = gray_of(read_sensor_image(path));
    } catch (const InputError&) {
      return cv::Mat();
    }
    return gray.size() == features.size ? gray : cv::Mat();
  };
}

enum class MappingRound {
  kFirst,
  kRemap,      // maps again with other lenses
  kReevaluate  // evaluates the earlier models with other lenses
};

// Returns the result of map(MappingRound::kFirst), or a better one. Where the result is not one
// trusted model of all images and indicates other lenses than guessed, its models are evaluated
// with these lenses. Where the lenses differ much, mapping is repeated, and the better result is
// taken.
template <typename Map>
Reconstruction map_with_lenses(ImageSet& image_set, std::vector<Pair>& pairs, bool partial,
                               const std::stop_token& stop, const Map& map) {
  Reconstruction made = map(MappingRound::kFirst);
  if (made.interrupted || made.models.empty()) return made;
  const bool is_whole =
      static_cast<std::size_t>(statistics_of(made.models[0]).registered) == made.outcomes.size();
  if (is_whole && made.trust[0] >= kGoodTrust) return made;
  const auto take = [&](double min_change, std::string_view why) {
    const std::vector<std::string> lines =
        image_set.adopt_focal_lengths(made.models, min_change, pairs, stop);
    for (const std::string& line : lines) made.log.push_back(fmt::format("{}: {}", line, why));
    return !lines.empty();
  };
  try {
    if (take(kMinRemapChange, "the images are mapped again with it")) {
      Reconstruction second = map(MappingRound::kRemap);
      if (!second.interrupted) return better_of(pairs, std::move(made), std::move(second));
      made.interrupted = true;
    } else if (take(kMinReevaluateChange, "the pairs are evaluated again with it")) {
      Reconstruction reevaluated = map(MappingRound::kReevaluate);
      if (reevaluated.interrupted) made.interrupted = true;
      if (reevaluated.interrupted || reevaluated.models.empty()) return made;
      reevaluated.log.insert(reevaluated.log.begin(), made.log.begin(), made.log.end());
      reevaluated.resumed = made.resumed;
      return reevaluated;
    }
  } catch (const Interrupted&) {
    if (!partial) throw;
    made.interrupted = true;
  }
  return made;
}

}  // namespace

void PipelineOptions::check() const {
  check_fields(*this);
  features.check();
  matching.check();
  two_view.check();
  mapper.check();
  TARSIER_REQUIRE(!features.wide || features.kind == FeatureKind::kSift,
                  "option 'wide' needs SIFT features");
  TARSIER_REQUIRE(
      !features.wide || (database.empty() && !flow),
      "option 'wide' needs feature detection: not possible with a database or optical flow");
  TARSIER_REQUIRE(memory_gb >= 0 && memory_gb <= 1024, "option 'memory_gb' is {}: expected 0..1024",
                  memory_gb);
  TARSIER_REQUIRE(database.empty() || !flow, "a database and optical flow exclude each other");
  TARSIER_REQUIRE(start_model.empty() || mapper.choice != MapperChoice::kGlobal,
                  "a start model is not possible with global mapping");
  TARSIER_REQUIRE(!start_model.empty() || !(fixed_poses || only_start),
                  "options 'fixed_poses' and 'only_start' need a start model");
  TARSIER_REQUIRE(pairs != PairChoice::kList || !pairs_file.empty(),
                  "no file with the image pairs");
  if (camera) {
    geometry::Camera sized = *camera;
    if (sized.width == 0) sized.width = sized.height = 1;
    sized.check();
  }
}

PipelineResult run_pipeline(const std::vector<Input>& inputs, const PipelineOptions& given,
                            Progress& progress, const std::stop_token& stop,
                            const PipelineHooks& hooks) {
  given.check();
  PipelineOptions options = seeded(given);
  PipelineResult result;
  for (const Input& input : inputs) {
    ImageReport report;
    report.name = input.name;
    report.path = input.path;
    result.images.push_back(std::move(report));
  }
  std::optional<StartModel> start;
  if (!options.start_model.empty()) start.emplace(options.start_model, inputs);
  const Cache cache(options.cache_folder);
  MappedStore store(options.cache_folder, static_cast<std::size_t>(options.memory_gb * 1e9));
  Stages stages(result, progress);

  std::vector<ImageFeatures> images;
  if (hooks.matched) {
    stages.start("load");
    images = load_all(hooks, store, result);
    stages.record();
  } else {
    stages.begin("features", static_cast<std::int64_t>(inputs.size()), "images");
    images = find_all_features(inputs, options, cache, start, store, progress, stop, result);
    stages.end();
  }
  const std::vector<char> is_of_start =
      start ? start->set_lenses(inputs, images) : std::vector<char>(images.size(), 0);

  ImageSet image_set(options);
  std::vector<std::string> names;
  KnownPositions positions;
  for (const ImageFeatures& image_features : images) {
    positions.push_back(inputs[at(image_features.input)].position);
    image_set.add(image_features, inputs[at(image_features.input)].name);
    names.push_back(inputs[at(image_features.input)].name);
    result.images[at(image_features.input)].focal_from =
        is_of_start[names.size() - 1] != 0 ? "start model" : image_features.lens.source;
  }
  options.mapper = image_set.mapper_options();
  std::optional<StartPoses> start_poses;
  if (start) {
    std::vector<int> cameras;
    for (const Image& image : image_set.images()) cameras.push_back(image.camera);
    const MapperOptions& requested = given.mapper;
    start_poses = start->poses(
        inputs, images, cameras, options.fixed_poses,
        requested.refine_focal || requested.refine_center || requested.refine_distortion);
  }

  if (!hooks.matched) {
    stages.begin("pairs", 1, "steps");
    const bool has_matches = options.flow || !options.database.empty();
    if (!has_matches) {
      const auto descriptors = [&](int i) { return images[at(i)].features.descriptors; };
      for (const auto& [first, second] : choose_pairs(names, positions, descriptors, options)) {
        Pair pair;
        pair.first = first;
        pair.second = second;
        result.pairs.push_back(std::move(pair));
      }
    }
    store.trim();
    progress.advance();
    stages.end();
    stages.begin("match", static_cast<std::int64_t>(result.pairs.size()), "pairs");
    compare_all(inputs, images, has_matches, options, cache, hooks, store, progress, stop, result);
    stages.end();
  }
  result.compared = static_cast<int>(result.pairs.size());
  result.verified =
      static_cast<int>(std::count_if(result.pairs.begin(), result.pairs.end(),
                                     [](const Pair& pair) { return !pair.view.inliers.empty(); }));

  if (hooks.on_matched) hooks.on_matched(images, image_set, result.pairs);
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<cv::Mat> descriptors;
  for (ImageFeatures& image_features : images) {
    colors.push_back(std::move(image_features.features.colors));
    if (!options.flow) descriptors.push_back(image_features.features.descriptors);
  }
  // A database may lack descriptors of some images: then tracks are not extended.
  if (std::any_of(images.begin(), images.end(), [](const ImageFeatures& image) {
        return static_cast<std::size_t>(image.features.descriptors.rows) <
               image.features.points.size();
      })) {
    descriptors.clear();
  }
  // image_set has copies.
  for (ImageFeatures& image_features : images) {
    image_features.features.points = {};
    image_features.features.sizes = {};
  }
  const MapperInput mapper_input{.cameras = image_set.cameras(),
                                 .images = image_set.images(),
                                 .colors = colors,
                                 .descriptors = descriptors,
                                 .release_memory = [&store] { store.trim(); },
                                 .kind = options.features.kind,
                                 .pairs = result.pairs,
                                 .tracked = options.flow,
                                 .gray = gray_images(inputs, images),
                                 .start = start_poses};
  stages.start("reconstruct");
  const std::vector<std::string> log = image_set.estimate_focal_lengths(result.pairs, stop);
  const std::string key =
      options.cache_folder.empty()
          ? ""
          : mapper_key(images, names, image_set, result.pairs, start_poses, options);
  std::optional<MapperState> last;  // state with the guessed lenses
  // Hooks with checkpoints of this name; "": without.
  const auto hooks_with = [&](const std::string& checkpoint) {
    MapperHooks mapping;
    mapping.watch = hooks.watch;
    mapping.show = hooks.show;
    mapping.partial = hooks.partial;
    mapping.save_interval_s = options.checkpoint_s;
    if (checkpoint.empty()) return mapping;
    if (!hooks.watch) mapping.resume_from = cache.checkpoint(checkpoint);
    mapping.save_checkpoint = [&cache, checkpoint,
                               warned = false](const MapperState& state) mutable {
      // A full disk must not stop the mapping.
      try {
        cache.store(checkpoint, state);
      } catch (const OutputError& error) {
        if (!warned) log_warning("cannot write a checkpoint: {}", error.what());
        warned = true;
      }
    };
    return mapping;
  };
  const auto map = [&](MappingRound round) {
    const bool reevaluates = round == MappingRound::kReevaluate;
    std::string checkpoint = key;
    if (!key.empty() && round != MappingRound::kFirst)
      checkpoint += reevaluates ? Cache::kReevaluatedSuffix : Cache::kRemappedSuffix;
    MapperHooks mapping = hooks_with(checkpoint);
    mapping.save_checkpoint = [&, reevaluates,
                               store = mapping.save_checkpoint](const MapperState& state) {
      if (image_set.has_guess() && !reevaluates) {
        last = state;
        last->patch_rejections.clear();
        last->attempts.clear();  // with the previous lenses
      }
      if (store) store(state);
    };
    if (!reevaluates) return reconstruct(mapper_input, options.mapper, progress, stop, mapping);
    const auto known = static_cast<std::ptrdiff_t>(last->log.size());
    if (!mapping.resume_from || !mapping.resume_from->done)
      mapping.resume_from = std::exchange(last, std::nullopt);
    mapping.watch = {};
    Reconstruction reevaluated = reconstruct(mapper_input, options.mapper, progress, stop, mapping);
    reevaluated.log.erase(reevaluated.log.begin(), reevaluated.log.begin() + known);
    return reevaluated;
  };
  if (hooks.map) {
    const bool has_checkpoints = !key.empty() && !hooks.map_key.empty();
    result.reconstruction = hooks.map(
        mapper_input, options.mapper,
        hooks_with(has_checkpoints ? cache_key(fmt::format("{} {}", key, hooks.map_key)) : ""));
  } else {
    result.reconstruction = map_with_lenses(image_set, result.pairs, hooks.partial, stop, map);
  }
  result.reconstruction.log.insert(result.reconstruction.log.begin(), log.begin(), log.end());
  for (Model& model : result.reconstruction.models) turn_upright(model);
  // Skipped after an interruption, when the user waits for the result, and for given poses, which
  // the observations do not determine.
  if (!result.reconstruction.interrupted && !options.fixed_poses)
    add_uncertainty(options.mapper, result.reconstruction);
  stages.record();
  result.resumed = result.reconstruction.resumed;
  if (start) {
    StartSummary summary = start->summary();
    summary.registered = result.reconstruction.start_images;
    summary.fixed_poses = options.fixed_poses;
    result.start = std::make_shared<const StartSummary>(std::move(summary));
  }
  for (std::size_t k = 0; k < images.size(); ++k) {
    ImageReport& report = result.images[at(images[k].input)];
    report.outcome = result.reconstruction.outcomes[k];
    if (image_set.is_estimated(static_cast<int>(k))) report.focal_from = "pairs";
  }
  return result;
}

}  // namespace tarsier::sfm
