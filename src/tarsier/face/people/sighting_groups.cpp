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
constexpr double kFixed = 1 << 20;
constexpr double kMaxWeight = 100;
constexpr double kMinQuality = 0.1;

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace

SightingGroups::SightingGroups(const recognition::PairScores& pairs, const GroupingOptions& options)
    : length_(static_cast<std::size_t>(pairs.model.template_length())),
      threshold_(0),
      same_camera_(pairs.same_camera),
      background_weight_(pairs.background_weight) {
  options.check();
  TARSIER_REQUIRE(pairs.model.calibration.has_value(), "scores of pairs without a calibration");
  TARSIER_REQUIRE(length_ > 0 && background_weight_ > 0, "templates of {} numbers", length_);
  const bool deep = pairs.model.options.algorithm == recognition::Algorithm::kDeep;
  const double rate = options.false_merges > 0 ? options.false_merges
                      : deep                   ? kDeepMerges
                                               : kClassicMerges;
  threshold_ = pairs.model.calibration->threshold(rate, 1);
}

void SightingGroups::put(Group& group, std::span<const float> features, double quality) const {
  TARSIER_REQUIRE(features.size() == length_, "a template of {} numbers, not {}", features.size(),
                  length_);
  TARSIER_REQUIRE(std::isfinite(quality), "quality {}", quality);
  const auto weight = std::llround(kMaxWeight * std::clamp(quality, kMinQuality, 1.0));
  double square = 0;
  for (const float value : features) {
    TARSIER_REQUIRE(std::isfinite(value) && std::abs(value) <= 2, "a template with {}", value);
    square += static_cast<double>(value) * value;
  }
  group.sum.resize(length_, 0);
  for (std::size_t i = 0; i < length_; ++i)
    group.sum[i] += weight * std::llround(kFixed * static_cast<double>(features[i]));
  group.weight += weight;
  group.length += weight * std::llround(kFixed * std::sqrt(square));
}

void SightingGroups::derive(Group& group) {
  group.mean.resize(group.sum.size());
  const double scale = 1 / (kFixed * static_cast<double>(group.weight));
  for (std::size_t i = 0; i < group.sum.size(); ++i)
    group.mean[i] = scale * static_cast<double>(group.sum[i]);
}

void SightingGroups::restore(std::int64_t group, std::span<const float> features, double quality) {
  TARSIER_REQUIRE(group > 0, "group {}", group);
  Group& entry = groups_[group];
  put(entry, features, quality);
  derive(entry);
  next_ = std::max(next_, group + 1);
}

void SightingGroups::keep_apart(std::int64_t a, std::int64_t b) {
  const auto first = groups_.find(a);
  const auto second = groups_.find(b);
  if (a == b || first == groups_.end() || second == groups_.end()) return;
  first->second.apart.insert(b);
  second->second.apart.insert(a);
}

void SightingGroups::set_next(std::int64_t id) { next_ = std::max(next_, id); }

std::vector<double> SightingGroups::common(const Group* more) const {
  std::vector<double> sum(length_, 0.0);
  for (const auto& [id, group] : groups_)
    for (std::size_t i = 0; i < length_; ++i) sum[i] += group.mean[i];
  if (more != nullptr)
    for (std::size_t i = 0; i < length_; ++i) sum[i] += more->mean[i];
  const double count = static_cast<double>(groups_.size()) + (more != nullptr ? 1 : 0);
  const double scale = 1 / (count + background_weight_);
  for (double& value : sum) value *= scale;
  return sum;
}

double SightingGroups::score(const Group& a, const Group& b,
                             const std::vector<double>& common) const {
  std::vector<double> va(length_);
  std::vector<double> vb(length_);
  for (std::size_t i = 0; i < length_; ++i) {
    va[i] = a.mean[i] - common[i];
    vb[i] = b.mean[i] - common[i];
  }
  const auto length = [](const Group& group) {
    return static_cast<double>(group.length) / (kFixed * static_cast<double>(group.weight));
  };
  const double product = dot(va, va) * dot(vb, vb);  // of |v|^2
  if (product < 1e-24) return 0;
  return dot(va, vb) * std::sqrt(length(a) * length(b) / std::sqrt(product));
}

double SightingGroups::score(std::int64_t a, std::int64_t b) const {
  return score(groups_.at(a), groups_.at(b), common());
}

double SightingGroups::threshold() const { return threshold(groups_.size()); }

double SightingGroups::threshold(std::size_t groups) const {
  const auto count = static_cast<double>(groups);
  return threshold_ - same_camera_ * count / (count + background_weight_);
}

void SightingGroups::join(std::int64_t from, std::int64_t into) {
  Group gone = std::move(groups_.at(from));
  groups_.erase(from);
  Group& stays = groups_.at(into);
  for (std::size_t i = 0; i < length_; ++i) stays.sum[i] += gone.sum[i];
  stays.weight += gone.weight;
  stays.length += gone.length;
  derive(stays);
  for (const std::int64_t other : gone.apart) {
    groups_.at(other).apart.erase(from);
    keep_apart(into, other);
  }
}

Placement SightingGroups::add(std::span<const float> features, double quality) {
  Group one;
  put(one, features, quality);
  derive(one);
  Placement placement;
  const std::int64_t id = next_;
  groups_.emplace(id, std::move(one));
  std::int64_t current = id;
  for (;;) {
    const std::vector<double> shared = common();
    const Group& changed = groups_.at(current);
    std::optional<std::pair<double, std::int64_t>> best;
    for (const auto& [other, group] : groups_) {
      if (other == current || changed.apart.contains(other)) continue;
      const double value = score(changed, group, shared);
      if (!best || value > best->first) best = {value, other};  // of equals the older one
    }
    if (!best || best->first < threshold()) break;
    const std::int64_t into = std::min(current, best->second);
    const std::int64_t from = std::max(current, best->second);
    join(from, into);
    // The new sighting's own group did not exist before, so its id can be reused.
    if (from != id) placement.merged.emplace_back(from, into);
    current = into;
  }
  placement.group = current;
  placement.is_new = current == id;
  if (placement.is_new) ++next_;
  return placement;
}

std::int64_t SightingGroups::nearest_group(std::span<const float> features, double quality) const {
  Group one;
  put(one, features, quality);
  derive(one);
  const std::vector<double> shared = common(&one);
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
