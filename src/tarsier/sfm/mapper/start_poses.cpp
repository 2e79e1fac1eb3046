// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/start_poses.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/consistency/pair_agreement.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace tarsier::sfm {
namespace {

// min share of an image's matches that agreeing pairs have
constexpr double kMinAgreeingShare = 0.3;
constexpr std::size_t kMinMatches = 16;
// Adjustments of rough poses: max reprojection error in units of MapperOptions::reprojection_px.
struct RoughRound {
  double threshold = 1;
  double loss_px = 0.5;
};
constexpr RoughRound kRoughRounds[] = {{16, 8}, {8, 4}, {4, 2}, {2, 1}};

// The images as a model with the start poses.
Model model_of(const StartPoses& start, const MapperInput& input) {
  Model model;
  model.cameras = input.cameras;
  model.images = input.images;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    model.images[i].registered = start.poses[i].has_value();
    if (start.poses[i]) model.images[i].pose = *start.poses[i];
  }
  return model;
}

// The matches of an image with images that fit, and those of agreeing pairs among them.
struct Support {
  std::size_t matches = 0;
  std::size_t agreeing = 0;
  [[nodiscard]] double share() const {
    return matches == 0 ? 0 : static_cast<double>(agreeing) / static_cast<double>(matches);
  }
  [[nodiscard]] bool fits() const {
    return agreeing >= kMinMatches && share() >= kMinAgreeingShare;
  }
};

struct CheckedPair {
  const Pair* pair = nullptr;
  std::size_t explained = 0;
  bool agrees = false;
};

std::vector<Support> supports(const std::vector<CheckedPair>& pairs,
                              const std::vector<char>& fits) {
  std::vector<Support> result(fits.size());
  for (const CheckedPair& checked : pairs) {
    if (fits[at(checked.pair->first)] == 0 || fits[at(checked.pair->second)] == 0) continue;
    for (const int image : {checked.pair->first, checked.pair->second}) {
      result[at(image)].matches += checked.pair->view.inliers.size();
      if (checked.agrees) result[at(image)].agreeing += checked.pair->view.inliers.size();
    }
  }
  return result;
}

}  // namespace

StartCheck check_start(const StartPoses& start, const MapperInput& input,
                       const std::vector<char>& is_refused, double reprojection_px,
                       const std::stop_token& stop) {
  const std::size_t count = input.images.size();
  TARSIER_REQUIRE(start.poses.size() == count, "{} poses for {} images", start.poses.size(), count);
  StartCheck check;
  check.fits.assign(count, 0);
  check.reasons.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    check.fits[i] = start.poses[i] ? 1 : 0;
    check.given_poses += check.fits[i];
  }
  const Model model = model_of(start, input);
  std::vector<CheckedPair> pairs;
  for (std::size_t k = 0; k < input.pairs.size(); ++k) {
    const Pair& pair = input.pairs[k];
    if (pair.view.inliers.empty() || is_refused[k] != 0 || check.fits[at(pair.first)] == 0 ||
        check.fits[at(pair.second)] == 0)
      continue;
    throw_if_stopped(stop);
    const CheckedPair checked{&pair, explained_matches(model, pair, reprojection_px),
                              agrees(model, pair)};
    pairs.push_back(checked);
  }
  int with_pairs = 0;
  for (const Support& support : supports(pairs, check.fits))
    with_pairs += support.matches > 0 ? 1 : 0;
  for (;;) {
    const std::vector<Support> all = supports(pairs, check.fits);
    int worst = -1;
    for (std::size_t i = 0; i < count; ++i) {
      if (check.fits[i] == 0 || all[i].fits()) continue;
      if (worst < 0 || all[i].share() < all[at(worst)].share()) worst = static_cast<int>(i);
    }
    if (worst < 0) break;
    check.fits[at(worst)] = 0;
    const Support& support = all[at(worst)];
    check.reasons[at(worst)] = support.matches == 0
                                   ? "the image has no matches with other images of the start model"
                                   : fmt::format(
                                         "its pose in the start model contradicts its matches: {} "
                                         "of {} matches are in pairs that agree with the pose",
                                         support.agreeing, support.matches);
  }
  for (const char fits : check.fits) check.accepted += fits;
  std::size_t explained = 0;
  for (const CheckedPair& checked : pairs) {
    if (!checked.agrees || check.fits[at(checked.pair->first)] == 0 ||
        check.fits[at(checked.pair->second)] == 0)
      continue;
    check.matches += checked.pair->view.inliers.size();
    explained += checked.explained;
  }
  if (check.matches > 0)
    check.explained_share = static_cast<double>(explained) / static_cast<double>(check.matches);
  if (with_pairs < 2) {
    check.refusal = fmt::format("no pair of its {} images has verified matches", check.given_poses);
  } else if (check.accepted < 2 || 2 * check.accepted < with_pairs) {
    check.refusal = fmt::format(
        "it contradicts the matches: the poses of only {} of its {} images agree with their "
        "matches",
        check.accepted, check.given_poses);
  }
  return check;
}

std::string describe(const StartCheck& check, const StartPoses& start,
                     const MapperOptions& options) {
  return fmt::format(
      "start model: {} of {} images have poses that agree with their matches; {:.0f} % of the {} "
      "matches are within {} px of their epipolar lines{}",
      check.accepted, check.given_poses, 100 * check.explained_share, check.matches,
      options.reprojection_px,
      check.is_exact() || start.fixed ? "" : ": the poses are inexact and are adjusted first");
}

Model start_model(const StartCheck& check, const StartPoses& start, const MapperInput& input) {
  Model model;
  model.cameras = input.cameras;
  model.images.resize(input.images.size());
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    model.images[i].registered = check.fits[i] != 0;
    if (model.images[i].registered) model.images[i].pose = *start.poses[i];
  }
  return model;
}

void adjust_rough_start(IncrementalMapper& mapper, const Model& start, const MapperOptions& options,
                        const std::stop_token& stop) {
  bool is_new = true;
  for (const RoughRound& round : kRoughRounds) {
    throw_if_stopped(stop);
    mapper.set_reprojection_px(round.threshold * options.reprojection_px);
    if (std::exchange(is_new, false)) mapper.resume(start);
    (void)mapper.refine_once({.tolerance = 1e-3, .loss_px = round.loss_px}, stop);
  }
  mapper.set_reprojection_px(options.reprojection_px);
  (void)mapper.refine_once({.tolerance = 1e-3}, stop);
}

std::string why_too_few_observations(const Model& model, const StartCheck& check,
                                     const StartPoses& start, const MapperOptions& options) {
  std::vector<int> observed_points(model.images.size(), 0);
  for (const Point& point : model.points)
    for (const Observation& seen : point.track) ++observed_points[at(seen.image)];
  const auto enough =
      static_cast<int>(std::count_if(observed_points.begin(), observed_points.end(),
                                     [&](int points) { return points >= options.pose_inliers; }));
  if (enough >= 2 && 2 * enough >= check.accepted) return "";
  return fmt::format(
      "only {} of {} images observe {} or more points with a reprojection error below {} px{}",
      enough, check.accepted, options.pose_inliers, options.reprojection_px,
      start.fixed ? "; fixed poses must be exact" : "");
}

}  // namespace tarsier::sfm
