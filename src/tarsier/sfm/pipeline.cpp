// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipeline.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/image_file.h"
#include "tarsier/io/sha256.h"
#include "tarsier/sfm/cache.h"
#include "tarsier/sfm/flow.h"
#include "tarsier/sfm/pairs.h"
#include "tarsier/sfm_io/exif.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <mutex>
#include <tuple>

namespace tarsier::sfm {
namespace {

constexpr std::int64_t kMostFileBytes = 512'000'000;
constexpr int kFewPhotographs = 60;
constexpr double kGuessedFocal = 1.2;  // of the larger side

std::size_t at(int i) { return static_cast<std::size_t>(i); }

class Stages {
 public:
  Stages(PipelineResult& result, Progress& progress) : result_(result), progress_(progress) {}
  void begin(const char* name, std::int64_t total, const char* unit) {
    progress_.begin(name, total, unit);
    name_ = name;
    start_ = std::chrono::steady_clock::now();
  }
  void end() {
    progress_.end();
    result_.stages.push_back(
        {name_, std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count()});
  }

 private:
  PipelineResult& result_;
  Progress& progress_;
  std::string name_;
  std::chrono::steady_clock::time_point start_;
};

// What is known of a photograph before its points are.
struct Shot {
  int input = 0;
  cv::Size size;
  double exif_focal = 0;  // px
  std::string lens;       // make and model
  std::string key;        // of its bytes and of how features are found
  Features features;
};

cv::Mat read_shot(const Input& input, const PipelineOptions& options, Shot& shot) {
  const std::string bytes = read_file(input.path, kMostFileBytes);
  Sha256 sum;
  sum.add(bytes);
  const FeatureOptions& f = options.features;
  shot.key = cache_key(fmt::format("{} features {} {} {} {}", sum.hex(), static_cast<int>(f.kind),
                                   f.most, f.most_pixels, f.contrast));
  const Exif exif = parse_exif(bytes);
  const std::span<const std::uint8_t> data(reinterpret_cast<const std::uint8_t*>(bytes.data()),
                                           bytes.size());
  cv::Mat image = decode_image(data, input.path);
  shot.size = image.size();
  shot.exif_focal = focal_px_of(exif, shot.size);
  shot.lens = exif.camera;
  return image;
}

// The given camera for a photograph of this size: scaled where the form is the same.
std::optional<geometry::Camera> fitting(geometry::Camera camera, cv::Size size) {
  if (camera.width == 0 || camera.height == 0 ||
      (camera.width == size.width && camera.height == size.height)) {
    camera.width = size.width;
    camera.height = size.height;
    return camera;
  }
  const double sx = static_cast<double>(size.width) / camera.width;
  const double sy = static_cast<double>(size.height) / camera.height;
  if (std::abs(sx - sy) > 0.01 * sx) return std::nullopt;
  camera.fx *= sx;
  camera.fy *= sy;
  camera.cx = (camera.cx + 0.5) * sx - 0.5;
  camera.cy = (camera.cy + 0.5) * sy - 0.5;
  camera.width = size.width;
  camera.height = size.height;
  return camera;
}

struct Lens {
  geometry::Camera camera;
  const char* from = "guess";
};

Lens lens_of(const Shot& shot, const PipelineOptions& options) {
  if (options.camera) {
    if (const auto camera = fitting(*options.camera, shot.size)) return {*camera, "given"};
  }
  Lens lens;
  lens.camera.width = shot.size.width;
  lens.camera.height = shot.size.height;
  lens.camera.cx = (shot.size.width - 1) / 2.0;
  lens.camera.cy = (shot.size.height - 1) / 2.0;
  const double larger = std::max(shot.size.width, shot.size.height);
  double focal = kGuessedFocal * larger;
  if (!options.ignore_exif && shot.exif_focal > 0.1 * larger && shot.exif_focal < 20 * larger) {
    focal = shot.exif_focal;
    lens.from = "EXIF";
  }
  lens.camera.fx = lens.camera.fy = focal;
  return lens;
}

// Features of all photographs that can be read, one after the other: each uses all threads.
std::vector<Shot> find_all_features(const std::vector<Input>& inputs,
                                    const PipelineOptions& options, const Cache& cache,
                                    Progress& progress, const std::stop_token& stop,
                                    PipelineResult& result) {
  std::vector<Shot> shots;
  FlowTracker tracker{FlowOptions{}};
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    throw_if_stopped(stop);
    PhotographReport& report = result.photographs[i];
    Shot shot;
    shot.input = static_cast<int>(i);
    try {
      const cv::Mat image = read_shot(inputs[i], options, shot);
      if (options.flow) {
        // A sequence has one size.
        if (!shots.empty() && image.size() != shots.front().size)
          throw InputError(
              inputs[i].path,
              fmt::format("{}x{}, but the sequence began with {}x{}", image.cols, image.rows,
                          shots.front().size.width, shots.front().size.height));
        if (image.cols < 64 || image.rows < 64)
          throw InputError(inputs[i].path, "too small to follow points in");
        tracker.add(image);
      } else if (auto known = cache.features(shot.key)) {
        shot.features = std::move(*known);
        ++result.from_cache;
      } else {
        shot.features = find_features(image, options.features);
        cache.store(shot.key, shot.features);
      }
      report.read = true;
      report.features = static_cast<int>(shot.features.points.size());
      shots.push_back(std::move(shot));
    } catch (const InputError& error) {
      report.outcome.reason = error.what();
      log_warning("{} (left out)", error.what());
    }
    progress.advance();
  }
  if (options.flow) {
    FlowResult tracks = tracker.finish();
    for (std::size_t k = 0; k < shots.size(); ++k) {
      shots[k].features = std::move(tracks.features[k]);
      result.photographs[at(shots[k].input)].features =
          static_cast<int>(shots[k].features.points.size());
    }
    for (FlowMatches& pair : tracks.pairs) {
      Pair made;
      made.first = pair.first;
      made.second = pair.second;
      made.matches = static_cast<int>(pair.matches.size());
      made.view.inliers = std::move(pair.matches);  // until they are verified
      result.pairs.push_back(std::move(made));
    }
  }
  return shots;
}

std::vector<std::pair<int, int>> choose_pairs(const std::vector<Shot>& shots,
                                              const std::vector<std::string>& names,
                                              const PipelineOptions& options) {
  const auto count = static_cast<int>(shots.size());
  PairChoice choice = options.pairs;
  if (choice == PairChoice::kAuto)
    choice = count <= kFewPhotographs ? PairChoice::kExhaustive : PairChoice::kRetrieval;
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
                 count, [&](int i) { return shots[at(i)].features.descriptors; },
                 options.features.kind, retrieval)
          .pairs();
    }
    case PairChoice::kAuto:
    case PairChoice::kExhaustive:
      break;
  }
  return exhaustive_pairs(count);
}

std::string camera_text(const Lens& lens) {
  const geometry::Camera& c = lens.camera;
  return fmt::format("{} {} {} {} {} {} {} {} {} {} {} {}", c.width, c.height, c.fx, c.fy, c.cx,
                     c.cy, fmt::join(c.distortion, " "), lens.from, 0, 0, 0, 0);
}

}  // namespace

void PipelineOptions::check() const {
  features.check();
  matching.check();
  two_view.check();
  mapper.check();
  TARSIER_REQUIRE(overlap >= 1 && overlap <= 1000, "overlap {}", overlap);
  TARSIER_REQUIRE(nearest >= 1 && nearest <= 1000, "nearest {}", nearest);
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
    PhotographReport report;
    report.name = input.name;
    result.photographs.push_back(std::move(report));
  }
  const Cache cache(options.cache_folder);
  Stages stages(result, progress);

  stages.begin("features", static_cast<std::int64_t>(inputs.size()), "photographs");
  std::vector<Shot> shots = find_all_features(inputs, options, cache, progress, stop, result);
  stages.end();

  // One camera for the photographs of a size and lens, or one each.
  std::vector<geometry::Camera> cameras;
  std::vector<Lens> lenses;  // of each photograph
  std::vector<Photograph> images;
  std::vector<std::string> names;
  std::map<std::tuple<int, int, double, std::string>, int> known;
  bool any_guess = false;
  for (const Shot& shot : shots) {
    const Lens lens = lens_of(shot, options);
    const std::tuple key(shot.size.width, shot.size.height, lens.camera.fx, shot.lens);
    auto [entry, fresh] = known.try_emplace(key, static_cast<int>(cameras.size()));
    if (fresh || !options.shared_camera) {
      entry->second = static_cast<int>(cameras.size());
      cameras.push_back(lens.camera);
    }
    any_guess = any_guess || std::string_view(lens.from) != "given";
    Photograph image;
    image.name = inputs[at(shot.input)].name;
    image.camera = entry->second;
    image.features = shot.features.points;
    image.sizes = shot.features.sizes;
    images.push_back(std::move(image));
    names.push_back(inputs[at(shot.input)].name);
    lenses.push_back(lens);
    result.photographs[at(shot.input)].focal_from = lens.from;
  }
  if (any_guess && !options.fixed_camera) {
    options.mapper.refine_focal = true;
    options.mapper.refine_distortion = true;
  }

  stages.begin("pairs", 1, "steps");
  if (!options.flow) {
    for (const auto& [first, second] : choose_pairs(shots, names, options)) {
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

  // The pairs of one photograph are kept together as soon as all of them are done.
  stages.begin("match", static_cast<std::int64_t>(result.pairs.size()), "pairs");
  result.compared = static_cast<int>(result.pairs.size());
  const TwoViewOptions& two_view = options.two_view;
  const auto pair_key = [&](int image) {
    return cache_key(fmt::format("{} {} pairs {} {} {}", shots[at(image)].key,
                                 camera_text(lenses[at(image)]), options.matching.ratio,
                                 two_view.threshold_px, two_view.least_inliers) +
                     std::to_string(two_view.seed));
  };
  const auto partner_key = [&](int image) {
    return shots[at(image)].key + camera_text(lenses[at(image)]);
  };
  std::mutex on_pair_mutex;
  std::atomic<int> from_cache{0};
  for (std::size_t start = 0; start < result.pairs.size();) {
    std::size_t end = start;
    while (end < result.pairs.size() && result.pairs[end].first == result.pairs[start].first) ++end;
    const int first = result.pairs[start].first;
    const bool use_cache = !options.flow && !hooks.on_pair;
    const std::string key = pair_key(first);
    Cache::Pairs kept = use_cache ? cache.pairs(key) : Cache::Pairs{};
    std::atomic<bool> fresh{false};
    const auto work = [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k) {
        if (stop.stop_requested()) return;
        Pair& pair = result.pairs[start + at(k)];
        if (const auto entry = kept.find(partner_key(pair.second)); entry != kept.end()) {
          pair.matches = entry->second.matches;
          pair.view = entry->second.view;
          ++from_cache;
        } else {
          const Shot& a = shots[at(pair.first)];
          const Shot& b = shots[at(pair.second)];
          const std::vector<Match> matches =
              options.flow ? std::move(pair.view.inliers)
                           : match_features(a.features.descriptors, b.features.descriptors,
                                            options.features.kind, options.matching);
          pair.matches = static_cast<int>(matches.size());
          TwoViewOptions how = two_view;
          how.known_focal = std::string_view(lenses[at(pair.first)].from) != "guess" &&
                            std::string_view(lenses[at(pair.second)].from) != "guess";
          pair.view =
              verify_pair(a.features.points, b.features.points, matches,
                          lenses[at(pair.first)].camera, lenses[at(pair.second)].camera, how);
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
        kept[partner_key(pair.second)] = {pair.matches, pair.view};
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
  for (Shot& shot : shots) {
    colors.push_back(std::move(shot.features.colors));
    if (!options.flow) descriptors.push_back(shot.features.descriptors);
  }
  const auto start = std::chrono::steady_clock::now();
  result.reconstruction = reconstruct(cameras, images, colors, descriptors, options.features.kind,
                                      result.pairs, options.mapper, progress, stop, hooks.watch);
  result.stages.push_back(
      {"reconstruct",
       std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()});
  for (std::size_t k = 0; k < shots.size(); ++k)
    result.photographs[at(shots[k].input)].outcome = result.reconstruction.outcomes[k];
  return result;
}

}  // namespace tarsier::sfm
