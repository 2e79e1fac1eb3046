// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipeline.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/cache.h"
#include "tarsier/sfm/flow.h"
#include "tarsier/sfm/pairs.h"
#include "tarsier/sfm/shots.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>

namespace tarsier::sfm {
namespace {

constexpr int kFewPhotographs = 60;

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
      } else if (find_shot_features(image, options, cache, shot)) {
        ++result.from_cache;
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

  Lineup lineup(options);
  std::vector<std::string> names;
  for (const Shot& shot : shots) {
    lineup.add(shot, inputs[at(shot.input)].name);
    names.push_back(inputs[at(shot.input)].name);
    result.photographs[at(shot.input)].focal_from = shot.lens.from;
  }
  options.mapper = lineup.mapper_options();

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
  std::mutex on_pair_mutex;
  std::atomic<int> from_cache{0};
  for (std::size_t start = 0; start < result.pairs.size();) {
    std::size_t end = start;
    while (end < result.pairs.size() && result.pairs[end].first == result.pairs[start].first) ++end;
    const int first = result.pairs[start].first;
    const bool use_cache = !options.flow && !hooks.on_pair;
    const std::string key = pairs_key(shots[at(first)], options);
    Cache::Pairs kept = use_cache ? cache.pairs(key) : Cache::Pairs{};
    std::atomic<bool> fresh{false};
    const auto work = [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k) {
        if (stop.stop_requested()) return;
        Pair& pair = result.pairs[start + at(k)];
        if (const auto entry = kept.find(partner_key(shots[at(pair.second)]));
            entry != kept.end()) {
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
          pair.view = verify_shots(a, b, matches, options);
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
        kept[partner_key(shots[at(pair.second)])] = {pair.matches, pair.view};
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
  result.reconstruction =
      reconstruct(lineup.cameras(), lineup.images(), colors, descriptors, options.features.kind,
                  result.pairs, options.mapper, progress, stop, hooks.watch);
  result.stages.push_back(
      {"reconstruct",
       std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count()});
  for (std::size_t k = 0; k < shots.size(); ++k)
    result.photographs[at(shots[k].input)].outcome = result.reconstruction.outcomes[k];
  return result;
}

}  // namespace tarsier::sfm
