// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/growth.h"

#include "tarsier/core/stop.h"

#include <algorithm>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kAdjustmentGrowth = 1.25;  // growth of the model after which the whole is adjusted
// Efforts of adjustments while the model still changes, and at the end.
constexpr IncrementalMapper::RefineOptions kGrowthRefinement{
    .tolerance = 1e-3, .points_per_image = 600, .max_observations = 40};
constexpr IncrementalMapper::RefineOptions kFineRefinement{.tolerance = 1e-5};
constexpr int kMaxAdjustedObservations = 1'000'000;  // per adjustment: 400 to 700 bytes each
constexpr int kMinVisiblePoints = 6;                 // min points that an image sees to be tried
// share of all observations gained by tracks: extend once more
constexpr double kMinExtensionGain = 0.1;

enum ExtendRound { kNotConverged = 1, kConverged };  // state after the extension of tracks
enum Stage { kAdd, kRefine, kExtend, kExtendAgain, kLast, kDone };

// The final effort: all points, or as many as memory allows, but not fewer than before.
IncrementalMapper::RefineOptions fine_refinement(const IncrementalMapper& mapper) {
  IncrementalMapper::RefineOptions refinement = kFineRefinement;
  if (mapper.observations() > kMaxAdjustedObservations) {
    refinement.points_per_image =
        std::max(kGrowthRefinement.points_per_image,
                 kMaxAdjustedObservations / std::max(1, mapper.registered()));
    refinement.max_observations = kGrowthRefinement.max_observations;
  }
  return refinement;
}

void step(const GrowthHooks& hooks) {
  if (hooks.step) hooks.step();
}

void pass_warnings(IncrementalMapper& mapper, const GrowthHooks& hooks) {
  for (std::string& line : mapper.take_warnings())
    if (hooks.warning) hooks.warning(std::move(line));
}

// The images that may be added now, the best first.
std::vector<int> candidates(const IncrementalMapper& mapper, const std::vector<bool>& used,
                            const std::map<int, int>& failed) {
  std::vector<std::pair<double, int>> scored;
  for (std::size_t i = 0; i < used.size(); ++i) {
    const int image = static_cast<int>(i);
    if (used[i] || mapper.model().images[i].registered) continue;
    const int visible_points = mapper.visible_count(image);
    if (visible_points < kMinVisiblePoints) continue;
    const auto before = failed.find(image);
    if (before != failed.end() && visible_points < 1.1 * before->second + 5) continue;
    scored.emplace_back(-mapper.next_best_view_score(image), image);
  }
  std::sort(scored.begin(), scored.end());
  std::vector<int> images;
  images.reserve(scored.size());
  for (const auto& [score, image] : scored) images.push_back(image);
  return images;
}

// Adds the best image that can be added; false: none can be.
bool add_one(IncrementalMapper& mapper, const std::vector<bool>& used, Growth& growth,
             const GrowthHooks& hooks, const std::stop_token& stop) {
  for (const int image : candidates(mapper, used, growth.failed)) {
    std::string why;
    const bool added = mapper.add(image, stop, why);
    if (hooks.attempted) hooks.attempted(image, added, added ? std::string() : why);
    pass_warnings(mapper, hooks);
    if (added) return true;
    growth.failed[image] = mapper.visible_count(image);
  }
  return false;
}

void adjust(IncrementalMapper& mapper, Growth& growth, const std::stop_token& stop) {
  mapper.refine_all(1, kGrowthRefinement, stop);
  growth.adjusted_at = mapper.registered();
}

}  // namespace

void add_images(IncrementalMapper& mapper, const std::vector<bool>& used, bool thorough,
                Growth& growth, const GrowthHooks& hooks, const std::stop_token& stop) {
  for (;;) {
    throw_if_stopped(stop);
    step(hooks);
    if (mapper.registered() >= kAdjustmentGrowth * growth.adjusted_at) adjust(mapper, growth, stop);
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
        const bool changed = mapper.refine_once(kGrowthRefinement, stop);
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
            growth.round = gained >= kMinExtensionGain * static_cast<double>(mapper.observations())
                               ? kNotConverged
                               : kConverged;
          }
        } else {
          const bool is_converged = growth.round == kConverged;
          mapper.refine_once(kGrowthRefinement, stop);
          enter(is_converged ? kLast : growth.stage + 1);
        }
        break;
      default: {
        const bool changed = mapper.refine_once(fine_refinement(mapper), stop);
        if (++growth.round == 2 || !changed) enter(kDone);
      }
    }
    pass_warnings(mapper, hooks);
  }
}

}  // namespace tarsier::sfm
