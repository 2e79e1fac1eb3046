// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/joint_correction.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/contradicted_joint.h"
#include "tarsier/sfm/consistency/pair_agreement.h"
#include "tarsier/sfm/mapper/model_shape.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kMaxAttempts = 4;
constexpr double kReplacedScoreRatio = 0.98;
constexpr double kHigherScoreRatio = 1.1;
constexpr double kMinJointStrength = 1;

bool agrees_with_any(const std::vector<Model>& models, const Pair& pair) {
  return std::any_of(models.begin(), models.end(), [&](const Model& model) {
    return is_registered(model, pair) && agrees(model, pair);
  });
}

// The pairs that agree with a model, and those of images that are in no model.
std::vector<Pair> agreeing_pairs(const std::vector<Pair>& pairs, const std::vector<Model>& models) {
  std::vector<bool> is_used(models.empty() ? 0 : models[0].images.size(), false);
  for (const Model& model : models)
    for (std::size_t i = 0; i < is_used.size(); ++i)
      is_used[i] = is_used[i] || model.images[i].registered;
  std::vector<Pair> result = pairs;
  for (Pair& pair : result)
    if (is_used[at(pair.first)] && is_used[at(pair.second)] && !agrees_with_any(models, pair))
      pair.view.inliers = {};
  return result;
}

// Removes the pairs between a part of a model and its other images.
void remove_joint(const Model& model, const std::vector<int>& part, std::vector<Pair>& pairs) {
  std::vector<bool> in_part(model.images.size(), false);
  for (const int image : part) in_part[at(image)] = true;
  for (Pair& pair : pairs)
    if (is_registered(model, pair) && in_part[at(pair.first)] != in_part[at(pair.second)])
      pair.view.inliers = {};
}

double excess_of(const std::vector<Pair>& pairs, const std::vector<Model>& models) {
  double sum = 0;
  for (const Model& model : models)
    if (const auto joint = contradicted_joint(model, pairs)) sum += joint->excess;
  return sum;
}

// The shapes by all pairs, also those that a model was made without.
std::vector<ModelShape> shapes_of(const std::vector<Pair>& pairs, const Reconstruction& made) {
  std::vector<ModelShape> shapes;
  for (std::size_t m = 0; m < made.models.size(); ++m) {
    shapes.push_back(shape_of(made.models[m], pairs));
    if (m < made.shapes.size()) shapes.back().missing_places = made.shapes[m].missing_places;
  }
  return shapes;
}

double score_with_shapes(const Reconstruction& made, const std::vector<ModelShape>& shapes) {
  std::vector<double> factors;
  factors.reserve(shapes.size());
  for (const ModelShape& shape : shapes) factors.push_back(shape_trust(shape));
  return score_of(made, factors);
}

// Replaces `made` by an attempt with `used` pairs. Those that were left out before keep their
// reasons.
void use_attempt(const std::vector<Pair>& pairs, const std::vector<Pair>& used,
                 const std::string& reason, Reconstruction attempt, Reconstruction& made) {
  std::map<std::pair<int, int>, RefusedPair> before;
  for (RefusedPair& refused : made.refused)
    before.emplace(std::pair(refused.first, refused.second), std::move(refused));
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const Pair& pair = pairs[k];
    if (pair.view.inliers.empty() || !used[k].view.inliers.empty() ||
        agrees_with_any(attempt.models, pair))
      continue;
    const auto known = before.find({pair.first, pair.second});
    attempt.refused.push_back(
        known != before.end() ? std::move(known->second)
                              : RefusedPair{.first = pair.first,
                                            .second = pair.second,
                                            .inliers = static_cast<int>(pair.view.inliers.size()),
                                            .reason = reason});
  }
  made.log.insert(made.log.end(), attempt.log.begin(), attempt.log.end());
  attempt.log = std::move(made.log);
  attempt.resumed = made.resumed;
  made = std::move(attempt);
}

// The joint of all models that a pair contradicts most, relative to its bottleneck.
struct JointOfModel {
  std::size_t model = 0;
  ContradictedJoint joint;
};

std::optional<JointOfModel> worst_contradicted_joint(const std::vector<Pair>& pairs,
                                                     const std::vector<Model>& models) {
  std::optional<JointOfModel> worst;
  for (std::size_t m = 0; m < models.size(); ++m) {
    std::optional<ContradictedJoint> joint = contradicted_joint(models[m], pairs);
    if (joint && (!worst || joint->strength * worst->joint.bottleneck >
                                worst->joint.strength * joint->bottleneck))
      worst = {m, std::move(*joint)};
  }
  return worst;
}

bool replace_contradicted_joint(const std::vector<Pair>& pairs, const MapPairs& map,
                                Reconstruction& made) {
  const std::optional<JointOfModel> found = worst_contradicted_joint(pairs, made.models);
  if (!found) return false;
  const ContradictedJoint& joint = found->joint;
  const Pair& strongest = pairs[joint.pair];
  const Model& model = made.models[found->model];
  std::vector<Pair> used = agreeing_pairs(pairs, made.models);
  remove_joint(model, joint.part, used);
  for (const std::size_t k : joint.replacing) used[k] = pairs[k];
  Reconstruction attempt = map(used);
  attempt.shapes = shapes_of(pairs, attempt);
  const double score_before = score_with_shapes(made, shapes_of(pairs, made));
  const double score_after = score_with_shapes(attempt, attempt.shapes);
  const double before = excess_of(pairs, made.models);
  const double after = excess_of(pairs, attempt.models);
  const bool is_replaced =
      attempt.models.size() <= made.models.size() && agrees_with_any(attempt.models, strongest);
  const bool is_better =
      after < before &&
      score_after >= (is_replaced ? kReplacedScoreRatio : kHigherScoreRatio) * score_before;
  made.log.push_back(fmt::format(
      "{} and {} (strength {:.2f}) contradict the place of {} images (strength {:.2f}): with the "
      "stronger pairs there are {} models, score {:.1f} instead of {:.1f}, excess {:.2f} instead "
      "of "
      "{:.2f}: {}",
      model.images[at(strongest.first)].name, model.images[at(strongest.second)].name,
      joint.strength, joint.part.size(), joint.bottleneck, attempt.models.size(), score_after,
      score_before, after, before, is_better ? "used" : "not used"));
  if (!is_better) return false;
  // Weaker pairs may agree with the new place.
  std::vector<Pair> supported = with_supported(used, pairs, attempt.models);
  Reconstruction all = map(supported);
  all.shapes = shapes_of(pairs, all);
  if (score_with_shapes(all, all.shapes) >= score_after) {
    attempt = std::move(all);
    used = std::move(supported);
  }
  use_attempt(pairs, used, "stronger pairs place its images elsewhere", std::move(attempt), made);
  return true;
}

bool open_weakest_joint(const std::vector<Pair>& pairs, const MapPairs& map, Reconstruction& made) {
  const std::vector<ModelShape> shapes = shapes_of(pairs, made);
  const auto weakest = std::min_element(
      shapes.begin(), shapes.end(),
      [](const ModelShape& a, const ModelShape& b) { return a.weakest_joint < b.weakest_joint; });
  if (weakest == shapes.end() || weakest->weakest_joint >= kMinJointStrength) return false;
  std::vector<Pair> used = agreeing_pairs(pairs, made.models);
  remove_joint(made.models[static_cast<std::size_t>(weakest - shapes.begin())],
               weakest->weakest_part, used);
  Reconstruction attempt = map(used);
  attempt.shapes = shapes_of(pairs, attempt);
  const double before = score_with_shapes(made, shapes);
  const double after = score_with_shapes(attempt, attempt.shapes);
  const bool is_better = after > before;
  made.log.push_back(fmt::format(
      "a joint of strength {:.2f} connects {} images with the others: without it there are {} "
      "models, score {:.1f} instead of {:.1f}: {}",
      weakest->weakest_joint, weakest->weakest_part.size(), attempt.models.size(), after, before,
      is_better ? "used" : "not used"));
  if (is_better)
    use_attempt(pairs, used, "it joins two parts that hardly any pair joins", std::move(attempt),
                made);
  return is_better;
}

}  // namespace

void correct_joints(const std::vector<Pair>& pairs, const MapPairs& map, Reconstruction& made) {
  for (int k = 0; k < kMaxAttempts; ++k)
    if (!replace_contradicted_joint(pairs, map, made)) break;
  for (int k = 0; k < kMaxAttempts; ++k)
    if (!open_weakest_joint(pairs, map, made)) break;
}

}  // namespace tarsier::sfm
