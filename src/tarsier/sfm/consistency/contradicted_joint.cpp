// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/contradicted_joint.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/pair_agreement.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinInliers = 30;
constexpr double kMinExcessRatio = 1.1;
constexpr double kMinReplacingRatio = 0.7;
constexpr double kMaxRotationDifference = 10 * CV_PI / 180;

struct WeighedPair {
  std::size_t pair = 0;
  double strength = 0;
};

// Disjoint sets of images with the members of each.
class ImageSets {
 public:
  explicit ImageSets(std::size_t images) : set_of_(images), members_(images) {
    std::iota(set_of_.begin(), set_of_.end(), 0);
    for (std::size_t i = 0; i < images; ++i) members_[i] = {static_cast<int>(i)};
  }

  [[nodiscard]] int set_of(int image) const { return set_of_[at(image)]; }
  [[nodiscard]] const std::vector<int>& members(int set) const { return members_[at(set)]; }

  void join(int one, int other) {
    if (members_[at(one)].size() < members_[at(other)].size()) std::swap(one, other);
    for (const int image : members_[at(other)]) {
      set_of_[at(image)] = one;
      members_[at(one)].push_back(image);
    }
    members_[at(other)].clear();
  }

 private:
  std::vector<int> set_of_;
  std::vector<std::vector<int>> members_;
};

// The rotation of the part against the rest that the pair asks for. With the poses R1 and R2 of the
// model and the relative rotation R21 of the pair it is R2' R21 R1, or its inverse.
Eigen::Matrix3d rotation_of_part(const Model& model, const Pair& pair, bool first_is_in_part) {
  const Eigen::Matrix3d rotation = model.images[at(pair.second)].pose.rotation.transpose() *
                                   pair.view.second_from_first.rotation *
                                   model.images[at(pair.first)].pose.rotation;
  return first_is_in_part ? rotation : Eigen::Matrix3d(rotation.transpose());
}

// The contradicted pairs between the joint's part and the rest that are strong enough and agree
// with the rotation of its pair.
std::vector<std::size_t> replacing_pairs(const Model& model, const std::vector<Pair>& pairs,
                                         const std::vector<WeighedPair>& contradicted,
                                         const ContradictedJoint& joint) {
  std::vector<bool> in_part(model.images.size(), false);
  for (const int image : joint.part) in_part[at(image)] = true;
  const Pair& strongest = pairs[joint.pair];
  const Eigen::Matrix3d rotation = rotation_of_part(model, strongest, in_part[at(strongest.first)]);
  std::vector<std::size_t> result;
  for (const WeighedPair& each : contradicted) {
    const Pair& pair = pairs[each.pair];
    if (in_part[at(pair.first)] == in_part[at(pair.second)] ||
        each.strength < kMinReplacingRatio * joint.strength)
      continue;
    const Eigen::Matrix3d other = rotation_of_part(model, pair, in_part[at(pair.first)]);
    if (geometry::angle_of(other * rotation.transpose()) <= kMaxRotationDifference)
      result.push_back(each.pair);
  }
  return result;
}

}  // namespace

std::optional<ContradictedJoint> contradicted_joint(const Model& model,
                                                    const std::vector<Pair>& pairs) {
  const std::vector<std::size_t> strongest = max_inliers_of_images(pairs, model.images.size());
  std::vector<WeighedPair> agreeing;
  std::vector<WeighedPair> contradicted;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const Pair& pair = pairs[k];
    if (!is_registered(model, pair)) continue;
    const WeighedPair weighed{k, strength_of(pair, strongest)};
    if (agrees(model, pair))
      agreeing.push_back(weighed);
    else if (pair.view.inliers.size() >= kMinInliers)
      contradicted.push_back(weighed);
  }
  std::stable_sort(
      agreeing.begin(), agreeing.end(),
      [](const WeighedPair& a, const WeighedPair& b) { return a.strength > b.strength; });
  ImageSets sets(model.images.size());
  std::vector<WeighedPair> separate = contradicted;  // whose images are in different sets
  std::optional<ContradictedJoint> result;
  double largest_ratio = kMinExcessRatio;
  double excess = 0;
  for (const WeighedPair& edge : agreeing) {
    if (separate.empty()) break;
    const int one = sets.set_of(pairs[edge.pair].first);
    const int other = sets.set_of(pairs[edge.pair].second);
    if (one == other) continue;
    const bool one_is_smaller = sets.members(one).size() < sets.members(other).size();
    const std::vector<int> smaller = sets.members(one_is_smaller ? one : other);
    sets.join(one, other);
    std::erase_if(separate, [&](const WeighedPair& each) {
      const Pair& pair = pairs[each.pair];
      if (sets.set_of(pair.first) != sets.set_of(pair.second)) return false;
      const double ratio = each.strength / edge.strength;
      if (ratio > kMinExcessRatio) excess += each.strength - edge.strength;
      if (ratio > largest_ratio) {
        largest_ratio = ratio;
        result.emplace();
        result->pair = each.pair;
        result->strength = each.strength;
        result->bottleneck = edge.strength;
        result->part = smaller;
      }
      return true;
    });
  }
  if (!result) return result;
  std::sort(result->part.begin(), result->part.end());
  result->replacing = replacing_pairs(model, pairs, contradicted, *result);
  result->excess = excess;
  return result;
}

}  // namespace tarsier::sfm
