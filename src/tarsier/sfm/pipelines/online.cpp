// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/online.h"

#include "tarsier/core/at.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/mapper/extend_model.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/reconstruction/reconstruct.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <set>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kMinMappedImages = 3;  // min images for mapping
// share of unregistered images that causes a new start
constexpr double kMaxUnregisteredShare = 0.4;
constexpr double kRetryGrowth = 1.5;  // growth factor of the number of images before the next trial

using Clock = std::chrono::steady_clock;
double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace

void OnlineOptions::check() const {
  check_fields(*this);
  pipeline.check();
}

struct OnlineMapper::State {
  // Cache entry for an image's pairs with later ones.
  struct CachedPairs {
    std::string key;
    Cache::Pairs pairs;
    bool is_new = false;
  };

  explicit State(const OnlineOptions& given)
      : options(given), cache(given.pipeline.cache_folder), image_set(given.pipeline) {}

  [[nodiscard]] std::vector<int> partners_of(int image) const {
    std::set<int> chosen;
    for (int k = 1; k <= options.overlap && k <= image; ++k) chosen.insert(image - k);
    for (int gap = 8; gap <= image; gap *= 2) chosen.insert(image - gap);
    for (const int other : neighbours_) chosen.insert(other);
    return {chosen.begin(), chosen.end()};
  }

  // Finds the images that share most points with the model's latest image and are not near it in
  // time anyway.
  void find_neighbours() {
    neighbours_.clear();
    int latest = -1;
    for (std::size_t i = 0; i < model.images.size(); ++i)
      if (model.images[i].registered) latest = static_cast<int>(i);
    if (latest < 0) return;
    std::vector<int> shared(model.images.size(), 0);
    for (const Point& point : model.points) {
      if (std::none_of(point.track.begin(), point.track.end(),
                       [&](const Observation& seen) { return seen.image == latest; })) {
        continue;
      }
      for (const Observation& seen : point.track) ++shared[at(seen.image)];
    }
    std::vector<std::pair<int, int>> order;
    for (int i = 0; i < latest - options.overlap; ++i)
      if (shared[at(i)] > 0) order.emplace_back(-shared[at(i)], i);
    std::sort(order.begin(), order.end());
    for (std::size_t k = 0; k < order.size() && k < at(options.neighbours); ++k)
      neighbours_.push_back(order[k].second);
  }

  // Writes one file for each image that got new pairs, once per growth.
  void save_pairs() {
    for (CachedPairs& entry : cached_pairs) {
      if (!entry.is_new) continue;
      cache.store(entry.key, entry.pairs);
      entry.is_new = false;
    }
  }

  OnlineOptions options;
  Cache cache;
  ImageSet image_set;
  // their points, colours and descriptors are in the vectors below
  std::vector<ImageFeatures> images;
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<cv::Mat> descriptors;
  std::vector<CachedPairs> cached_pairs;
  std::vector<Pair> pairs;
  std::vector<int> neighbours_;
  Model model;
  int adjusted_at = 0;
  int last_start_count = 0;  // number of images at the last trial from the start
  std::string no_model_reason;
  double adding_s = 0;  // s, after the last growth
  double seconds = 0;
};

OnlineMapper::OnlineMapper(const OnlineOptions& given) {
  given.check();
  OnlineOptions options = given;
  options.pipeline.mapper.seed = options.pipeline.two_view.seed = options.pipeline.seed;
  state_ = std::make_unique<State>(options);
}

OnlineMapper::~OnlineMapper() = default;

void OnlineMapper::add(const Input& input, const std::stop_token& stop) {
  const Clock::time_point start = Clock::now();
  State& p = *state_;
  const PipelineOptions& options = p.options.pipeline;
  ImageFeatures image_features;
  image_features.input = count();
  const cv::Mat image = read_input_image(input, options, image_features);
  (void)find_image_features(image, options, p.cache, image_features);
  p.image_set.add(image_features, input.name);
  p.colors.push_back(image_features.features.colors);
  p.descriptors.push_back(image_features.features.descriptors);
  p.images.push_back(std::move(image_features));
  const ImageFeatures& latest = p.images.back();
  p.cached_pairs.push_back({pairs_key(latest, options), {}, false});
  p.cached_pairs.back().pairs = p.cache.pairs(p.cached_pairs.back().key);

  const std::vector<int> partners = p.partners_of(latest.input);
  std::vector<Pair> pairs(partners.size());
  std::vector<char> done(partners.size(), 0);
  std::vector<char> is_new(partners.size(), 0);
  cv::parallel_for_(cv::Range(0, static_cast<int>(partners.size())), [&](const cv::Range& range) {
    for (int k = range.start; k < range.end; ++k) {
      if (stop.stop_requested()) return;
      Pair& pair = pairs[at(k)];
      pair.first = partners[at(k)];
      pair.second = latest.input;
      const ImageFeatures& other = p.images[at(pair.first)];
      const Cache::Pairs& cached = p.cached_pairs[at(pair.first)].pairs;
      if (const auto entry = cached.find(partner_key(latest)); entry != cached.end()) {
        pair.matches = entry->second.matches;
        pair.view = entry->second.view;
      } else {
        compare_images(other, latest, options, pair);
        is_new[at(k)] = 1;
      }
      done[at(k)] = 1;
    }
  });
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (done[k] == 0) continue;
    if (is_new[k] != 0) {
      State::CachedPairs& entry = p.cached_pairs[at(pairs[k].first)];
      entry.pairs[partner_key(latest)] = {pairs[k].matches, pairs[k].view};
      entry.is_new = true;
    }
    p.pairs.push_back(std::move(pairs[k]));
  }
  p.adding_s += seconds_since(start);
  throw_if_stopped(stop);
}

void OnlineMapper::grow(const std::stop_token& stop) { update(false, stop); }
void OnlineMapper::refine(const std::stop_token& stop) { update(true, stop); }

void OnlineMapper::update(bool adjust_all, const std::stop_token& stop) {
  const Clock::time_point start = Clock::now();
  State& p = *state_;
  p.save_pairs();
  if (count() < kMinMappedImages) return;
  const MapperOptions mapper = p.image_set.mapper_options();
  const auto input_of = [&p](const std::vector<Pair>& pairs) {
    return MapperInput{.cameras = p.image_set.cameras(),
                       .images = p.image_set.images(),
                       .colors = p.colors,
                       .descriptors = p.descriptors,
                       .kind = p.options.pipeline.features.kind,
                       .pairs = pairs};
  };
  if (!p.model.images.empty()) {
    ExtendedModel extended =
        extend_model(p.model, input_of(p.pairs), mapper,
                     {.adjusted_at = p.adjusted_at, .adjust_all = adjust_all}, stop);
    p.model = std::move(extended.model);
    p.adjusted_at = extended.adjusted_at;
  }
  const bool needs_new_start =
      p.model.images.empty() || (registered() < (1 - kMaxUnregisteredShare) * count() &&
                                 count() >= kRetryGrowth * p.last_start_count);
  if (needs_new_start) {
    p.last_start_count = count();
    NoProgress progress;
    std::vector<Pair> pairs = p.pairs;
    std::sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) {
      return std::pair(a.first, a.second) < std::pair(b.first, b.second);
    });
    (void)p.image_set.estimate_focal_lengths(pairs, stop);  // more pairs determine them better
    Reconstruction made = reconstruct(input_of(pairs), mapper, progress, stop);
    if (!made.models.empty() && statistics_of(made.models[0]).registered > registered()) {
      p.model = std::move(made.models[0]);
      p.adjusted_at = registered();
    }
    p.no_model_reason = p.model.images.empty() ? made.no_model : "";
  }
  p.find_neighbours();
  p.seconds = p.adding_s + seconds_since(start);
  p.adding_s = 0;
}

int OnlineMapper::count() const { return static_cast<int>(state_->images.size()); }
int OnlineMapper::registered() const {
  const auto& images = state_->model.images;
  return static_cast<int>(std::count_if(images.begin(), images.end(),
                                        [](const Image& image) { return image.registered; }));
}
const Model& OnlineMapper::model() const { return state_->model; }
const Features& OnlineMapper::features(int image) const {
  return state_->images.at(at(image)).features;
}
const std::vector<Pair>& OnlineMapper::pairs() const { return state_->pairs; }
const std::string& OnlineMapper::no_model_reason() const { return state_->no_model_reason; }
double OnlineMapper::seconds() const { return state_->seconds; }

}  // namespace tarsier::sfm
