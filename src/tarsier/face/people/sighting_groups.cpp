// SPDX-License-Identifier: MIT
#include "tarsier/face/people/sighting_groups.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <optional>

namespace tarsier::face::people {
namespace {

// A template's element is at most 1, a weight at most kMaxWeight, so sums of a hundred million
// sightings fit into 63 bits.
constexpr double kFixedPointScale = 1 << 20;
constexpr double kMaxWeight = 100;
constexpr double kMinQuality = 0.1;

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

SightingGroups::SightingGroups(const recognition::PairScores& pairs, const GroupingOptions& options)
    : template_length_(static_cast<std::size_t>(pairs.model.template_length())),
      same_camera_(pairs.same_camera),
      background_weight_(pairs.background_weight) {
  options.check();
  TARSIER_REQUIRE(pairs.model.calibration.has_value(), "scores of pairs without a calibration");
  TARSIER_REQUIRE(template_length_ > 0 && background_weight_ > 0, "templates of {} numbers",
                  template_length_);
  const bool deep = pairs.model.options.algorithm == recognition::Algorithm::kDeep;
  const double rate = options.false_merges > 0 ? options.false_merges
                      : deep                   ? kDeepFalseMergeRate
                                               : kClassicFalseMergeRate;
  threshold_ = pairs.model.calibration->threshold(rate, 1);
}

void SightingGroups::accumulate(Group& group, std::span<const float> features,
                                double quality) const {
  TARSIER_REQUIRE(features.size() == template_length_, "a template of {} numbers, not {}",
                  features.size(), template_length_);
  TARSIER_REQUIRE(std::isfinite(quality), "quality {}", quality);
  const auto weight = std::llround(kMaxWeight * std::clamp(quality, kMinQuality, 1.0));
  double square = 0;
  for (const float value : features) {
    TARSIER_REQUIRE(std::isfinite(value) && std::abs(value) <= 2, "a template with {}", value);
    square += static_cast<double>(value) * value;
  }
  group.sum.resize(template_length_, 0);
  for (std::size_t i = 0; i < template_length_; ++i)
    group.sum[i] += weight * std::llround(kFixedPointScale * static_cast<double>(features[i]));
  group.weight += weight;
  group.norm += weight * std::llround(kFixedPointScale * std::sqrt(square));
}

void SightingGroups::update_mean(Group& group) {
  group.mean.resize(group.sum.size());
  const double scale = 1 / (kFixedPointScale * static_cast<double>(group.weight));
  for (std::size_t i = 0; i < group.sum.size(); ++i)
    group.mean[i] = scale * static_cast<double>(group.sum[i]);
}

void SightingGroups::restore(std::int64_t group, std::span<const float> features, double quality) {
  TARSIER_REQUIRE(group > 0, "group {}", group);
  Group& entry = groups_[group];
  accumulate(entry, features, quality);
  update_mean(entry);
  next_ = std::max(next_, group + 1);
}

void SightingGroups::add_cannot_link(std::int64_t a, std::int64_t b) {
  const auto first = groups_.find(a);
  const auto second = groups_.find(b);
  if (a == b || first == groups_.end() || second == groups_.end()) return;
  first->second.cannot_link.insert(b);
  second->second.cannot_link.insert(a);
}

void SightingGroups::set_next(std::int64_t id) { next_ = std::max(next_, id); }

std::vector<double> SightingGroups::common_mean(const Group* more) const {
  std::vector<double> sum(template_length_, 0.0);
  for (const auto& [id, group] : groups_)
    for (std::size_t i = 0; i < template_length_; ++i) sum[i] += group.mean[i];
  if (more != nullptr)
    for (std::size_t i = 0; i < template_length_; ++i) sum[i] += more->mean[i];
  const double count = static_cast<double>(groups_.size()) + (more != nullptr ? 1 : 0);
  const double scale = 1 / (count + background_weight_);
  for (double& value : sum) value *= scale;
  return sum;
}

double SightingGroups::score(const Group& a, const Group& b,
                             const std::vector<double>& common_mean) const {
  std::vector<double> va(template_length_);
  std::vector<double> vb(template_length_);
  for (std::size_t i = 0; i < template_length_; ++i) {
    va[i] = a.mean[i] - common_mean[i];
    vb[i] = b.mean[i] - common_mean[i];
  }
  const auto norm = [](const Group& group) {
    return static_cast<double>(group.norm) / (kFixedPointScale * static_cast<double>(group.weight));
  };
  const double product = dot(va, va) * dot(vb, vb);  // of |v|^2
  if (product < 1e-24) return 0;
  return dot(va, vb) * std::sqrt(norm(a) * norm(b) / std::sqrt(product));
}

double SightingGroups::score(std::int64_t a, std::int64_t b) const {
  return score(groups_.at(a), groups_.at(b), common_mean());
}

double SightingGroups::threshold() const { return threshold(groups_.size()); }

double SightingGroups::threshold(std::size_t groups) const {
  const auto count = static_cast<double>(groups);
  return threshold_ - same_camera_ * count / (count + background_weight_);
}

void SightingGroups::merge(std::int64_t from, std::int64_t into) {
  Group source = std::move(groups_.at(from));
  groups_.erase(from);
  Group& target = groups_.at(into);
  for (std::size_t i = 0; i < template_length_; ++i) target.sum[i] += source.sum[i];
  target.weight += source.weight;
  target.norm += source.norm;
  update_mean(target);
  for (const std::int64_t other : source.cannot_link) {
    groups_.at(other).cannot_link.erase(from);
    add_cannot_link(into, other);
  }
}

GroupAssignment SightingGroups::add(std::span<const float> features, double quality) {
  Group one;
  accumulate(one, features, quality);
  update_mean(one);
  GroupAssignment assignment;
  const std::int64_t id = next_;
  groups_.emplace(id, std::move(one));
  std::int64_t current = id;
  for (;;) {
    const std::vector<double> shared = common_mean();
    const Group& changed = groups_.at(current);
    std::optional<std::pair<double, std::int64_t>> best;
    for (const auto& [other, group] : groups_) {
      if (other == current || changed.cannot_link.contains(other)) continue;
      const double value = score(changed, group, shared);
      if (!best || value > best->first) best = {value, other};  // of equals the older one
    }
    if (!best || best->first < threshold()) break;
    const std::int64_t into = std::min(current, best->second);
    const std::int64_t from = std::max(current, best->second);
    merge(from, into);
    // The new sighting's own group did not exist before, so its id can be reused.
    if (from != id) assignment.merged.emplace_back(from, into);
    current = into;
  }
  assignment.group = current;
  assignment.is_new = current == id;
  if (assignment.is_new) ++next_;
  return assignment;
}

std::int64_t SightingGroups::nearest_group(std::span<const float> features, double quality) const {
  Group one;
  accumulate(one, features, quality);
  update_mean(one);
  const std::vector<double> shared = common_mean(&one);
  double best = threshold(groups_.size() + 1);
  std::int64_t out = 0;
  for (const auto& [id, group] : groups_) {
    const double value = score(one, group, shared);
    if (value < best || (value == best && out != 0)) continue;  // of equals the older one
    best = value;
    out = id;
  }
  return out;
}

}  // namespace tarsier::face::people
