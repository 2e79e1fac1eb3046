// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_shape.h"

#include "tarsier/core/at.h"
#include "tarsier/core/statistics.h"
#include "tarsier/sfm/consistency/open_loops.h"
#include "tarsier/sfm/consistency/pair_agreement.h"
#include "tarsier/sfm/mapper/model_filter.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <numeric>
#include <set>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kMinShapeInliers = 30;
constexpr double kMinStrength = 0.7;
constexpr double kMaxRotationError = 45 * CV_PI / 180;
// relative to the usual distance of an image from its neighbours
constexpr double kMaxDistanceRatio = 8;
constexpr double kMinHighStrength = 0.85;
constexpr int kMinPartImages = 3;  // images
constexpr double kFirmJointStrength = 2;

struct Joint {
  int first = 0;
  int second = 0;
  double strength = 0;
};

double distance_of(const Model& model, const Pair& pair) {
  return (model.images[at(pair.first)].pose.center() - model.images[at(pair.second)].pose.center())
      .norm();
}

// Angle between the relative rotation of a pair and that of the model.
double rotation_error_of(const Model& model, const Pair& pair) {
  const geometry::Rigid3 relative =
      model.images[at(pair.second)].pose * model.images[at(pair.first)].pose.inverse();
  return geometry::angle_of(relative.rotation * pair.view.second_from_first.rotation.transpose());
}

// The maximum spanning tree of the joints (Kruskal), and the sum of joints that cross each of its
// edges.
class SpanningTree {
 public:
  SpanningTree(std::size_t images, std::vector<Joint> joints)
      : neighbours_(images),
        parents_(images, -1),
        depths_(images, -1),
        sizes_(images, 1),
        crossing_(images, 0) {
    std::stable_sort(joints.begin(), joints.end(),
                     [](const Joint& a, const Joint& b) { return a.strength > b.strength; });
    std::vector<int> sets(images);
    std::iota(sets.begin(), sets.end(), 0);
    const auto root = [&](int image) {
      while (sets[at(image)] != image) image = sets[at(image)] = sets[at(sets[at(image)])];
      return image;
    };
    for (const Joint& joint : joints) {
      const int a = root(joint.first);
      const int b = root(joint.second);
      if (a == b) continue;
      sets[at(a)] = b;
      neighbours_[at(joint.first)].push_back(joint.second);
      neighbours_[at(joint.second)].push_back(joint.first);
    }
    for (std::size_t i = 0; i < images; ++i)
      if (depths_[i] < 0) build_tree(static_cast<int>(i));
    sum_crossing(joints);
  }

  struct Cut {
    double strength = std::numeric_limits<double>::infinity();
    int image = -1;  // the root of the part that is cut off; -1: there is no cut
  };

  // The smallest sum over the edges that separate parts of at least `min_part` images, of `all`
  // images.
  [[nodiscard]] Cut weakest_cut(int min_part, int all) const {
    Cut weakest;
    for (std::size_t i = 0; i < parents_.size(); ++i) {
      if (sizes_[i] < min_part || all - sizes_[i] < min_part) continue;
      // A root has no joint: its part is everything, or is separate.
      const double strength = parents_[i] < 0 ? 0 : crossing_[i];
      if (strength < weakest.strength) weakest = {strength, static_cast<int>(i)};
    }
    return weakest;
  }

  // The images of the subtree of this image.
  [[nodiscard]] std::vector<int> part_of(int image) const {
    std::vector<int> part;
    for (std::size_t i = 0; i < parents_.size(); ++i) {
      int above = static_cast<int>(i);
      while (above >= 0 && above != image) above = parents_[at(above)];
      if (above == image) part.push_back(static_cast<int>(i));
    }
    return part;
  }

 private:
  void build_tree(int root) {
    depths_[at(root)] = 0;
    order_.push_back(root);
    for (std::size_t k = order_.size() - 1; k < order_.size(); ++k) {
      const int image = order_[k];
      for (const int other : neighbours_[at(image)]) {
        if (depths_[at(other)] >= 0) continue;
        depths_[at(other)] = depths_[at(image)] + 1;
        parents_[at(other)] = image;
        order_.push_back(other);
      }
    }
  }

  // A joint crosses the edges on the path between its images. These are the edges from either image
  // to the root, without those that both share.
  void sum_crossing(const std::vector<Joint>& joints) {
    for (const Joint& joint : joints) {
      crossing_[at(joint.first)] += joint.strength;
      crossing_[at(joint.second)] += joint.strength;
      crossing_[at(common_ancestor(joint.first, joint.second))] -= 2 * joint.strength;
    }
    for (std::size_t k = order_.size(); k-- > 0;) {
      const int image = order_[k];
      if (parents_[at(image)] < 0) continue;
      crossing_[at(parents_[at(image)])] += crossing_[at(image)];
      sizes_[at(parents_[at(image)])] += sizes_[at(image)];
    }
  }

  // The node where the paths of two images to the root meet.
  [[nodiscard]] int common_ancestor(int a, int b) const {
    while (a != b) {
      int& deeper = depths_[at(a)] < depths_[at(b)] ? b : a;
      deeper = parents_[at(deeper)];
    }
    return a;
  }

  std::vector<std::vector<int>> neighbours_;
  std::vector<int> parents_;
  std::vector<int> depths_;
  std::vector<int> sizes_;        // images of the subtree
  std::vector<double> crossing_;  // sum of strengths that leave the subtree
  std::vector<int> order_;        // parents first
};

}  // namespace

ModelShape shape_of(const Model& model, const std::vector<Pair>& pairs) {
  const std::vector<std::size_t> strongest = max_inliers_of_images(pairs, model.images.size());
  std::vector<std::vector<double>> distances(model.images.size());  // of agreeing pairs
  std::vector<Joint> joints;
  ModelShape shape;
  std::vector<const Pair*> all;
  all.reserve(pairs.size());
  for (const Pair& pair : pairs) all.push_back(&pair);
  const std::vector<const Pair*> found = open_loops(model, all);
  const std::set<const Pair*> loops(found.begin(), found.end());
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    const Pair& pair = pairs[k];
    const std::size_t inliers = pair.view.inliers.size();
    if (inliers == 0 || !model.images[at(pair.first)].registered ||
        !model.images[at(pair.second)].registered)
      continue;
    const double strength = strength_of(pair, strongest);
    if (agrees(model, pair)) {
      joints.push_back({pair.first, pair.second, strength});
      for (const int image : {pair.first, pair.second})
        distances[at(image)].push_back(distance_of(model, pair));
      continue;
    }
    const bool closes_loop = loops.contains(&pair);
    if (inliers >= kMinShapeInliers && (strength >= kMinStrength || closes_loop) &&
        rotation_error_of(model, pair) <= kMaxRotationError)
      shape.missed_pairs.push_back({k, strength, closes_loop});
  }
  std::vector<double> typical_distances(distances.size(), 0);
  for (std::size_t i = 0; i < typical_distances.size(); ++i)
    if (!distances[i].empty()) typical_distances[i] = upper_median(std::move(distances[i]));
  std::erase_if(shape.missed_pairs, [&](const ModelShape::MissedPair& missed) {
    const Pair& pair = pairs[missed.pair];
    return distance_of(model, pair) >
           kMaxDistanceRatio *
               std::max(typical_distances[at(pair.first)], typical_distances[at(pair.second)]);
  });
  const SpanningTree tree(model.images.size(), std::move(joints));
  const SpanningTree::Cut cut = tree.weakest_cut(kMinPartImages, statistics_of(model).registered);
  shape.weakest_joint = cut.strength;
  if (cut.image >= 0) shape.weakest_part = tree.part_of(cut.image);
  return shape;
}

bool is_unreliable(const ModelShape& shape) {
  return shape.missing_places > 0 ||
         std::count_if(shape.missed_pairs.begin(), shape.missed_pairs.end(),
                       [](const ModelShape::MissedPair& missed) {
                         return missed.strength >= kMinHighStrength || missed.closes_loop;
                       }) >= 2;
}

double shape_trust(const ModelShape& shape) {
  return std::min(1.0, shape.weakest_joint / kFirmJointStrength) *
         (is_unreliable(shape) ? kUnreliableTrustFactor : 1);
}

}  // namespace tarsier::sfm
