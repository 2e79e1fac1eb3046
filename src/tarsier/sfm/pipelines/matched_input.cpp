// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/matched_input.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/sha256.h"
#include "tarsier/sfm/features/flow.h"
#include "tarsier/sfm/pipelines/known_features.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <mutex>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

bool is_left_out(const Input& input, const PipelineOptions& options,
                 const std::optional<StartModel>& start) {
  return options.only_start && !start->has(input.name);
}

// Cache key of tracked points: all that decides which images are tracked. These are the bytes of
// the files, in their order, and the sizes that a start model expects.
std::string flow_key(const std::vector<Input>& inputs, const PipelineOptions& options,
                     const std::optional<StartModel>& start, const std::stop_token& stop) {
  const FlowOptions flow;
  std::string text = fmt::format("flow-2 {} {} {} {} {}", flow.max_points, flow.grid, flow.reach,
                                 flow.back_px, flow.min_correlation);
  for (const Input& input : inputs) {
    throw_if_stopped(stop);
    if (is_left_out(input, options, start)) continue;
    if (start)
      if (const auto size = start->size_of(input.name))
        text += fmt::format(" {}x{}", size->width, size->height);
    text += ' ';
    try {
      text += sha256_of_file(input.path);
    } catch (const InputError&) {
      text += "none";
    }
  }
  return cache_key(text);
}

}  // namespace

std::vector<ImageFeatures> find_all_features(const std::vector<Input>& inputs,
                                             const PipelineOptions& options, const Cache& cache,
                                             const std::optional<StartModel>& start,
                                             MappedStore& store, Progress& progress,
                                             const std::stop_token& stop, PipelineResult& result) {
  std::vector<ImageFeatures> images;
  FlowTracker tracker{FlowOptions{}};
  const std::string flow_name = options.flow ? flow_key(inputs, options, start, stop) : "";
  std::optional<FlowResult> tracks;
  if (options.flow) tracks = cache.flow(flow_name);
  const bool is_known = tracks.has_value();
  std::optional<KnownFeatures> known;
  if (!options.database.empty()) known.emplace(options.database);
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    throw_if_stopped(stop);
    ImageReport& report = result.images[i];
    ImageFeatures image_features;
    image_features.input = static_cast<int>(i);
    if (is_left_out(inputs[i], options, start)) {
      report.outcome.reason = "the image is not in the start model";
      progress.advance();
      continue;
    }
    try {
      TARSIER_REQUIRE(known || !inputs[i].path.empty(), "image '{}' has no file", inputs[i].name);
      const cv::Mat image =
          inputs[i].path.empty() ? cv::Mat() : read_input_image(inputs[i], options, image_features);
      if (known) known->fill(inputs[i], image, image_features, options);
      if (start) start->check_size(inputs[i], image_features.size);
      if (known) {
        ++result.from_cache;
      } else if (options.flow) {
        // All images of a sequence have the same size.
        if (!images.empty() && image.size() != images.front().size)
          throw InputError(
              inputs[i].path,
              fmt::format(
                  "the image has {}x{} px, but the first image of the sequence has {}x{} px",
                  image.cols, image.rows, images.front().size.width, images.front().size.height));
        if (image.cols < 64 || image.rows < 64)
          throw InputError(inputs[i].path,
                           "the image is too small for optical flow: 64x64 px or more are needed");
        if (!is_known) tracker.add(image);
        image_features.key = cache_key(fmt::format("{} {}", flow_name, images.size()));
      } else if (find_image_features(image, options, cache, image_features)) {
        ++result.from_cache;
      }
      image_features.features.descriptors = store.add(image_features.features.descriptors);
      report.read = true;
      report.features = static_cast<int>(image_features.features.points.size());
      images.push_back(std::move(image_features));
    } catch (const InputError& error) {
      report.outcome.reason = error.what();
      log_warning("{} (left out)", error.what());
    }
    progress.advance();
  }
  if (known) result.pairs = known->pairs(images, inputs);
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
      made.view.inliers = std::move(pair.matches);  // until verification
      result.pairs.push_back(std::move(made));
    }
  }
  return images;
}

std::vector<ImageFeatures> load_all(const PipelineHooks& hooks, MappedStore& store,
                                    PipelineResult& result) {
  MatchedImages matched;
  hooks.matched(matched);
  for (ImageFeatures& image : matched.images) {
    image.features.descriptors = store.add(image.features.descriptors);
    ImageReport& report = result.images[at(image.input)];
    report.read = true;
    report.features = static_cast<int>(image.features.points.size());
  }
  for (auto& [input, reason] : matched.left_out)
    result.images[at(input)].outcome.reason = std::move(reason);
  result.pairs = std::move(matched.pairs);
  for (Pair& pair : result.pairs) pair.view.inliers = store.add(pair.view.inliers);
  return std::move(matched.images);
}

void compare_all(const std::vector<Input>& inputs, const std::vector<ImageFeatures>& images,
                 bool has_matches, const PipelineOptions& options, const Cache& cache,
                 const PipelineHooks& hooks, MappedStore& store, Progress& progress,
                 const std::stop_token& stop, PipelineResult& result) {
  std::mutex on_pair_mutex;
  std::atomic<int> from_cache{0};
  for (std::size_t start = 0; start < result.pairs.size();) {
    std::size_t end = start;
    while (end < result.pairs.size() && result.pairs[end].first == result.pairs[start].first) ++end;
    const int first = result.pairs[start].first;
    const bool use_cache = !hooks.on_pair;
    const std::string key = pairs_key(images[at(first)], options);
    Cache::Pairs cached_pairs = use_cache ? cache.pairs(key) : Cache::Pairs{};
    std::atomic<bool> fresh{false};
    const auto work = [&](const cv::Range& range) {
      for (int k = range.start; k < range.end; ++k) {
        if (stop.stop_requested()) return;
        Pair& pair = result.pairs[start + at(k)];
        if (const auto entry = cached_pairs.find(partner_key(images[at(pair.second)]));
            entry != cached_pairs.end()) {
          pair.matches = entry->second.matches;
          pair.view = entry->second.view;  // replaces tracked matches, if any
          ++from_cache;
        } else {
          const ImageFeatures& a = images[at(pair.first)];
          const ImageFeatures& b = images[at(pair.second)];
          std::vector<Match> matches;
          if (has_matches) {
            matches = pair.view.inliers.copy();
            pair.matches = static_cast<int>(matches.size());
            pair.view = verify_image_pair(a, b, matches, options);
          } else {
            compare_images(a, b, options, pair, &matches);
          }
          fresh = true;
          if (hooks.on_pair) {
            const std::lock_guard lock(on_pair_mutex);
            hooks.on_pair({inputs[at(a.input)], inputs[at(b.input)], a.features.points,
                           b.features.points, matches, pair.view, a.input, b.input});
          }
        }
        progress.advance();
      }
    };
    cv::parallel_for_(cv::Range(0, static_cast<int>(end - start)), work);
    throw_if_stopped(stop);
    store.trim();
    if (fresh && use_cache) {
      for (std::size_t k = start; k < end; ++k) {
        const Pair& pair = result.pairs[k];
        cached_pairs[partner_key(images[at(pair.second)])] = {pair.matches, pair.view};
      }
      cache.store(key, cached_pairs);
    }
    for (std::size_t k = start; k < end; ++k) {
      MatchList& inliers = result.pairs[k].view.inliers;
      inliers = store.add(inliers);
    }
    start = end;
  }
  result.from_cache += from_cache;
}

}  // namespace tarsier::sfm
