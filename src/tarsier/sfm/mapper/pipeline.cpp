// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/pipeline.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/mapper/cache.h"
#include "tarsier/sfm/mapper/flow.h"
#include "tarsier/sfm/mapper/image_features.h"
#include "tarsier/sfm/mapper/pairs.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <ctime>
#include <mutex>
#include <span>

namespace tarsier::sfm {
namespace {

constexpr int kFewImages = 60;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

class Stages {
 public:
  Stages(PipelineResult& result, Progress& progress) : result_(result), progress_(progress) {}
  void begin(const char* name, std::int64_t total, const char* unit) {
    progress_.begin(name, total, unit);
    start(name);
  }
  void end() {
    progress_.end();
    note();
  }
  // The same for a stage that begins and ends its own progress.
  void start(const char* name) {
    name_ = name;
    start_ = std::chrono::steady_clock::now();
    cpu_start_ = cpu_seconds();
  }
  void note() {
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

// What followed points depend on: the bytes of all files, in their order.
std::string flow_key(const std::vector<Input>& inputs, const std::stop_token& stop) {
  const FlowOptions flow;
  std::string text = fmt::format("flow {} {} {} {} {}", flow.max_points, flow.grid, flow.reach,
                                 flow.back_px, flow.alike);
  for (const Input& input : inputs) {
    throw_if_stopped(stop);
    text += ' ';
    try {
      text += sha256_of_file(input.path);
    } catch (const InputError&) {
      text += "none";
    }
  }
  return cache_key(text);
}

// Features of all images that can be read, one after the other: each uses all threads.
std::vector<ImageFeatures> find_all_features(const std::vector<Input>& inputs,
                                             const PipelineOptions& options, const Cache& cache,
                                             Progress& progress, const std::stop_token& stop,
                                             PipelineResult& result) {
  std::vector<ImageFeatures> images;
  FlowTracker tracker{FlowOptions{}};
  const std::string flow_name = options.flow ? flow_key(inputs, stop) : "";
  std::optional<FlowResult> tracks;
  if (options.flow) tracks = cache.flow(flow_name);
  const bool is_known = tracks.has_value();
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    throw_if_stopped(stop);
    ImageReport& report = result.images[i];
    ImageFeatures image_features;
    image_features.input = static_cast<int>(i);
    try {
      const cv::Mat image = read_input_image(inputs[i], options, image_features);
      if (options.flow) {
        // A sequence has one size.
        if (!images.empty() && image.size() != images.front().size)
          throw InputError(
              inputs[i].path,
              fmt::format("{}x{}, but the sequence began with {}x{}", image.cols, image.rows,
                          images.front().size.width, images.front().size.height));
        if (image.cols < 64 || image.rows < 64)
          throw InputError(inputs[i].path, "too small to follow points in");
        if (!is_known) tracker.add(image);
        image_features.key = cache_key(fmt::format("{} {}", flow_name, images.size()));
      } else if (find_image_features(image, options, cache, image_features)) {
        ++result.from_cache;
      }
      report.read = true;
      report.features = static_cast<int>(image_features.features.points.size());
      images.push_back(std::move(image_features));
    } catch (const InputError& error) {
      report.outcome.reason = error.what();
      log_warning("{} (left out)", error.what());
    }
    progress.advance();
  }
  if (options.flow) {
    if (!is_known) {
      tracks = tracker.finish();
      if (!images.empty()) cache.store(flow_name, *tracks);
    } else {
      result.from_cache += static_cast<int>(images.size());
    }
    for (std::size_t k = 0; k < images.size() && k < tracks->features.size(); ++k) {
      images[k].features = std::move(tracks->features[k]);
      result.images[at(images[k].input)].features =
          static_cast<int>(images[k].features.points.size());
    }
    for (FlowMatches& pair : tracks->pairs) {
      if (at(std::max(pair.first, pair.second)) >= images.size()) continue;
      Pair made;
      made.first = pair.first;
      made.second = pair.second;
      made.matches = static_cast<int>(pair.matches.size());
      made.view.inliers = std::move(pair.matches);  // until they are verified
      result.pairs.push_back(std::move(made));
    }
  }
  return images;
}

std::vector<std::pair<int, int>> choose_pairs(const std::vector<ImageFeatures>& images,
                                              const std::vector<std::string>& names,
                                              const PipelineOptions& options) {
  const auto count = static_cast<int>(images.size());
  PairChoice choice = options.pairs;
  if (choice == PairChoice::kAuto)
    choice = count <= kFewImages ? PairChoice::kExhaustive : PairChoice::kRetrieval;
  switch (choice) {
    case PairChoice::kSequential:
      return sequential_pairs(count, options.overlap);
    case PairChoice::kList:
      return read_pairs_list(options.pairs_file, names);
    case PairChoice::kRetrieval: {
      RetrievalOptions retrieval;
      retrieval.nearest = options.nearest;
      retrieval.seed = options.seed;
      return Retrieval(
                 count, [&](int i) { return images[at(i)].features.descriptors; },
                 options.features.kind, retrieval)
          .pairs();
    }
    case PairChoice::kAuto:
    case PairChoice::kExhaustive:
      break;
  }
  return exhaustive_pairs(count);
}

// All that the mapper's work depends on.
std::string mapper_key(const std::vector<ImageFeatures>& images,
                       const std::vector<std::string>& names, const ImageSet& image_set,
                       const std::vector<Pair>& pairs, const PipelineOptions& options) {
  const MapperOptions& m = options.mapper;
  Sha256 sum;
  sum.add(fmt::format("mapper {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {}",
                      m.reprojection_px, m.min_angle_deg, m.first_angle_deg, m.first_inliers,
                      m.pose_inliers, m.pose_inlier_share, m.pose_px, m.min_views, m.min_images,
                      m.extend_px, m.extend_similarity, m.refine_focal, m.refine_center,
                      m.refine_distortion, m.seed, options.flow,
                      static_cast<int>(options.features.kind), options.shared_camera));
  for (std::size_t k = 0; k < images.size(); ++k) {
    sum.add(
        fmt::format("\n{} {} {}", partner_key(images[k]), image_set.images()[k].camera, names[k]));
  }
  for (const Pair& pair : pairs) {
    sum.add(fmt::format("\n{} {} {} {} {} {}", pair.first, pair.second, pair.matches,
                        pair.view.homography_inliers, pair.view.in_front, pair.view.median_angle));
    for (const double number : geometry::packed(pair.view.second_from_first))
      sum.add(fmt::format(" {}", number));
    sum.add(std::span(reinterpret_cast<const std::uint8_t*>(pair.view.inliers.data()),
                      pair.view.inliers.size() * sizeof(Match)));
  }
  return sum.hex().substr(0, 32);
}

}  // namespace

void PipelineOptions::check() const {
  check_fields(*this);
  features.check();
  matching.check();
  two_view.check();
  mapper.check();
  TARSIER_REQUIRE(pairs != PairChoice::kList || !pairs_file.empty(), "no list of pairs");
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
  PipelineOptions options = given;
  options.mapper.seed = options.two_view.seed = options.seed;
  PipelineResult result;
  for (const Input& input : inputs) {
    ImageReport report;
    report.name = input.name;
    result.images.push_back(std::move(report));
  }
  const Cache cache(options.cache_folder);
  Stages stages(result, progress);

  stages.begin("features", static_cast<std::int64_t>(inputs.size()), "images");
  std::vector<ImageFeatures> images =
      find_all_features(inputs, options, cache, progress, stop, result);
  stages.end();

  ImageSet image_set(options);
  std::vector<std::string> names;
  for (const ImageFeatures& image_features : images) {
    image_set.add(image_features, inputs[at(image_features.input)].name);
    names.push_back(inputs[at(image_features.input)].name);
    result.images[at(image_features.input)].focal_from = image_features.lens.from;
  }
  options.mapper = image_set.mapper_options();

  stages.begin("pairs", 1, "steps");
  if (!options.flow) {
    for (const auto& [first, second] : choose_pairs(images, names, options)) {
      Pair pair;
      pair.first = std::min(first, second);
      pair.second = std::max(first, second);
      result.pairs.push_back(std::move(pair));
    }
    std::sort(result.pairs.begin(), result.pairs.end(), [](const Pair& a, const Pair& b) {
      return std::pair(a.first, a.second) < std::pair(b.first, b.second);
    });
  }
  progress.advance();
  stages.end();

  // The pairs of one image are kept together as soon as all of them are done.
  stages.begin("match", static_cast<std::int64_t>(result.pairs.size()), "pairs");
  result.compared = static_cast<int>(result.pairs.size());
  std::mutex on_pair_mutex;
  std::atomic<int> from_cache{0};
  for (std::size_t start = 0; start < result.pairs.size();) {
    std::size_t end = start;
    while (end < result.pairs.size() && result.pairs[end].first == result.pairs[start].first) ++end;
    const int first = result.pairs[start].first;
    const bool use_cache = !hooks.on_pair;
    const std::string key = pairs_key(images[at(first)], options);
    Cache::Pairs kept = use_cache ? cache.pairs(key) : Cache::Pairs{};
    std::atomic<bool> fresh{false};
    const auto work = [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k) {
        if (stop.stop_requested()) return;
        Pair& pair = result.pairs[start + at(k)];
        if (const auto entry = kept.find(partner_key(images[at(pair.second)]));
            entry != kept.end()) {
          pair.matches = entry->second.matches;
          pair.view = entry->second.view;  // instead of what was followed, if anything
          ++from_cache;
        } else {
          const ImageFeatures& a = images[at(pair.first)];
          const ImageFeatures& b = images[at(pair.second)];
          const std::vector<Match> matches =
              options.flow ? std::move(pair.view.inliers)
                           : match_features(a.features.descriptors, b.features.descriptors,
                                            options.features.kind, options.matching);
          pair.matches = static_cast<int>(matches.size());
          pair.view = verify_image_pair(a, b, matches, options);
          fresh = true;
          if (hooks.on_pair) {
            const std::lock_guard lock(on_pair_mutex);
            hooks.on_pair({inputs[at(a.input)], inputs[at(b.input)], a.features.points,
                           b.features.points, matches, pair.view});
          }
        }
        progress.advance();
      }
    };
    cv::parallel_for_(cv::Range(0, static_cast<int>(end - start)), work);
    throw_if_stopped(stop);
    if (fresh && use_cache) {
      for (std::size_t k = start; k < end; ++k) {
        const Pair& pair = result.pairs[k];
        kept[partner_key(images[at(pair.second)])] = {pair.matches, pair.view};
      }
      cache.store(key, kept);
    }
    start = end;
  }
  result.from_cache += from_cache;
  result.verified =
      static_cast<int>(std::count_if(result.pairs.begin(), result.pairs.end(),
                                     [](const Pair& pair) { return !pair.view.inliers.empty(); }));
  stages.end();

  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<cv::Mat> descriptors;
  for (ImageFeatures& image_features : images) {
    colors.push_back(std::move(image_features.features.colors));
    if (!options.flow) descriptors.push_back(image_features.features.descriptors);
  }
  stages.start("reconstruct");
  MapperHooks mapping;
  mapping.watch = hooks.watch;
  mapping.show = hooks.show;
  mapping.partial = hooks.partial;
  mapping.keep_every_s = options.checkpoint_s;
  if (!options.cache_folder.empty()) {
    const std::string key = mapper_key(images, names, image_set, result.pairs, options);
    if (!hooks.watch) mapping.from = cache.checkpoint(key);
    // A full disk must not end the mapping.
    mapping.keep = [&cache, key, warned = false](const MapperState& state) mutable {
      try {
        cache.store(key, state);
      } catch (const OutputError& error) {
        if (!warned) log_warning("no checkpoint: {}", error.what());
        warned = true;
      }
    };
  }
  const MapperInput mapper_input{.cameras = image_set.cameras(),
                                 .images = image_set.images(),
                                 .colors = colors,
                                 .descriptors = descriptors,
                                 .kind = options.features.kind,
                                 .pairs = result.pairs};
  result.reconstruction = reconstruct(mapper_input, options.mapper, progress, stop, mapping);
  result.resumed = result.reconstruction.resumed;
  stages.note();
  for (std::size_t k = 0; k < images.size(); ++k)
    result.images[at(images[k].input)].outcome = result.reconstruction.outcomes[k];
  return result;
}

}  // namespace tarsier::sfm
