// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/growth.h"

#include "tarsier/core/stop.h"

#include <algorithm>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kGrowth = 1.25;  // growth of the model after which the whole is adjusted
// Efforts of adjustments while the model still changes, and at the end.
constexpr IncrementalMapper::Effort kRough{
    .tolerance = 1e-3, .points_per_image = 600, .max_observations = 40};
constexpr IncrementalMapper::Effort kFine{.tolerance = 1e-5};
constexpr int kMaxObservations = 1'000'000;  // per adjustment: 400 to 700 bytes each
constexpr int kMinSeen = 6;                  // min points that an image sees to be tried
constexpr double kMuch = 0.1;  // share of all observations gained by tracks: extend once more

enum ExtendRound { kExtendMore = 1, kExtendEnough };  // state after the extension of tracks
enum Stage { kAdd, kRefine, kExtend, kExtendAgain, kLast, kDone };

// The final effort: all points, or as many as memory allows, but not fewer than before.
IncrementalMapper::Effort fine_effort(const IncrementalMapper& mapper) {
  IncrementalMapper::Effort effort = kFine;
  if (mapper.observations() > kMaxObservations) {
    effort.points_per_image =
        std::max(kRough.points_per_image, kMaxObservations / std::max(1, mapper.registered()));
    effort.max_observations = kRough.max_observations;
  }
  return effort;
}

void step(const GrowthHooks& hooks) {
  if (hooks.step) hooks.step();
}

void pass_troubles(IncrementalMapper& mapper, const GrowthHooks& hooks) {
  for (std::string& line : mapper.take_troubles())
    if (hooks.trouble) hooks.trouble(std::move(line));
}

// The images that may be added now, the best first.
std::vector<int> candidates(const IncrementalMapper& mapper, const std::vector<bool>& used,
                            const std::map<int, int>& failed) {
  std::vector<std::pair<double, int>> scored;
  for (std::size_t i = 0; i < used.size(); ++i) {
    const int image = static_cast<int>(i);
    if (used[i] || mapper.model().images[i].registered) continue;
    const int seen = mapper.seen(image);
    if (seen < kMinSeen) continue;
    const auto before = failed.find(image);
    if (before != failed.end() && seen < 1.1 * before->second + 5) continue;
    scored.emplace_back(-mapper.next_best_view_score(image), image);
  }
  std::sort(scored.begin(), scored.end());
  std::vector<int> images;
  for (const auto& [score, image] : scored) images.push_back(image);
  return images;
}

// Adds the best image that can be added; false: none can be.
bool add_one(IncrementalMapper& mapper, const std::vector<bool>& used, Growth& growth,
             const GrowthHooks& hooks, const std::stop_token& stop) {
  for (const int image : candidates(mapper, used, growth.failed)) {
    std::string why;
    const bool added = mapper.add(image, stop, why);
    if (hooks.tried) hooks.tried(image, added, added ? std::string() : why);
    pass_troubles(mapper, hooks);
    if (added) return true;
    growth.failed[image] = mapper.seen(image);
  }
  return false;
}

void adjust(IncrementalMapper& mapper, Growth& growth, const std::stop_token& stop) {
  mapper.refine_all(1, kRough, stop);
  growth.adjusted_at = mapper.registered();
}

}  // namespace

void add_images(IncrementalMapper& mapper, const std::vector<bool>& used, bool thorough,
                Growth& growth, const GrowthHooks& hooks, const std::stop_token& stop) {
  for (;;) {
    throw_if_stopped(stop);
    step(hooks);
    if (mapper.registered() >= kGrowth * growth.adjusted_at) adjust(mapper, growth, stop);
    if (add_one(mapper, used, growth, hooks, stop)) continue;
    if (!thorough || growth.adjusted_at == mapper.registered()) break;
    adjust(mapper, growth, stop);
  }
}

void grow(IncrementalMapper& mapper, const std::vector<bool>& used, Growth& growth,
          const GrowthHooks& hooks, const std::stop_token& stop) {
  const auto enter = [&](int stage) {
    growth.stage = stage;
    growth.round = 0;
  };
  while (growth.stage != kDone) {
    step(hooks);
    switch (growth.stage) {
      case kAdd:
        add_images(mapper, used, true, growth, hooks, stop);
        enter(kRefine);
        break;
      case kRefine: {
        const bool changed = mapper.refine_once(kRough, stop);
        if (++growth.round == 3 || !changed) enter(kExtend);
        break;
      }
      case kExtend:
      case kExtendAgain:
        if (growth.round == 0) {
          growth.between_states = true;
          const int gained = mapper.extend_tracks(stop);
          growth.between_states = false;
          if (gained == 0) {
            enter(kLast);
          } else {
            growth.round = gained >= kMuch * static_cast<double>(mapper.observations())
                               ? kExtendMore
                               : kExtendEnough;
          }
        } else {
          const bool is_enough = growth.round == kExtendEnough;
          mapper.refine_once(kRough, stop);
          enter(is_enough ? kLast : growth.stage + 1);
        }
        break;
      default: {
        const bool changed = mapper.refine_once(fine_effort(mapper), stop);
        if (++growth.round == 2 || !changed) enter(kDone);
      }
    }
    pass_troubles(mapper, hooks);
  }
}

}  // namespace tarsier::sfm
