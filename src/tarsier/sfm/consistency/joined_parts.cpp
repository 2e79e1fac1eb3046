// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/joined_parts.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/pair_agreement.h"
#include "tarsier/sfm/global/view_graph.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

namespace tarsier::sfm {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr int kMinPartImages = 5;
constexpr double kMinCommonShare = 0.95;
constexpr double kMaxMove = 0.01;  // of the extent of a part
constexpr double kMaxRotation = 3 * kRadiansPerDegree;
constexpr std::size_t kMinContradictingInliers = 30;

std::vector<int> registered_images(const Model& model) {
  std::vector<int> images;
  for (std::size_t i = 0; i < model.images.size(); ++i)
    if (model.images[i].registered) images.push_back(static_cast<int>(i));
  return images;
}

Matrix3d rotation_between(const Model& whole, const Model& part, int image) {
  return whole.images[at(image)].pose.rotation.transpose() * part.images[at(image)].pose.rotation;
}

// The largest set of images with the same rotation between the two models, within the limit.
std::vector<int> images_of_one_rotation(const Model& whole, const Model& part,
                                        const std::vector<int>& images) {
  // Where most images have the same rotation, one of a few of them has it.
  constexpr std::size_t kCandidates = 20;
  std::vector<int> best;
  const std::size_t step = std::max<std::size_t>(1, images.size() / kCandidates);
  for (std::size_t k = 0; k < images.size(); k += step) {
    const Matrix3d rotation = rotation_between(whole, part, images[k]);
    std::vector<int> alike;
    for (const int image : images)
      if (geometry::angle_of(rotation_between(whole, part, image) * rotation.transpose()) <=
          kMaxRotation)
        alike.push_back(image);
    if (alike.size() > best.size()) best = std::move(alike);
  }
  return best;
}

// Whether the images of the part have the same relative poses in the whole.
bool has_same_shape(const Model& whole, const Model& part, const std::vector<int>& images,
                    std::size_t min_images) {
  const std::vector<int> alike = images_of_one_rotation(whole, part, images);
  if (alike.size() < min_images) return false;
  const Matrix3d rotation = rotation_between(whole, part, alike[alike.size() / 2]);
  const auto count = static_cast<Eigen::Index>(alike.size());
  Eigen::Matrix3Xd from(3, count);
  Eigen::Matrix3Xd to(3, count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const auto image = at(alike[static_cast<std::size_t>(k)]);
    from.col(k) = rotation * part.images[image].pose.center();
    to.col(k) = whole.images[image].pose.center();
  }
  const double extent = (to.rowwise().maxCoeff() - to.rowwise().minCoeff()).norm();
  from.colwise() -= Vector3d(from.rowwise().mean());
  to.colwise() -= Vector3d(to.rowwise().mean());
  const double spread = from.squaredNorm();
  if (!(spread > 0)) return false;
  const double scale = from.cwiseProduct(to).sum() / spread;
  if (!(scale > 0)) return false;
  const Eigen::VectorXd moves = (scale * from - to).colwise().norm();
  return static_cast<std::size_t>((moves.array() <= kMaxMove * extent).count()) >= min_images;
}

struct RatedPair {
  const Pair* pair = nullptr;
  double strength = 0;
  bool agrees = false;
};

// The verified pairs of images of the model in different nodes, strongest first. Of equal strength,
// those that agree come first.
std::vector<RatedPair> pairs_between(const Model& model, const std::vector<int>& node_of,
                                     const std::vector<Pair>& pairs) {
  const std::vector<std::size_t> strongest = max_inliers_of_images(pairs, model.images.size());
  std::vector<RatedPair> between;
  for (const Pair& pair : pairs) {
    if (!is_registered(model, pair) || node_of[at(pair.first)] == node_of[at(pair.second)])
      continue;
    between.push_back({&pair, strength_of(pair, strongest), agrees(model, pair)});
  }
  std::stable_sort(between.begin(), between.end(), [](const RatedPair& a, const RatedPair& b) {
    return a.strength != b.strength ? a.strength > b.strength : a.agrees && !b.agrees;
  });
  return between;
}

}  // namespace

bool joins_parts(const std::vector<Model>& whole, const std::vector<Model>& parts,
                 const std::vector<Pair>& pairs) {
  if (whole.empty() || whole.size() >= parts.size()) return false;
  const std::size_t images = whole[0].images.size();
  // Images of no part are nodes of their own.
  std::vector<int> node_of(images);
  std::iota(node_of.begin(), node_of.end(), static_cast<int>(parts.size()));
  std::vector<std::vector<int>> parts_of(whole.size());
  for (std::size_t p = 0; p < parts.size(); ++p) {
    const std::vector<int> all = registered_images(parts[p]);
    if (all.size() < kMinPartImages) continue;
    const auto min_images =
        static_cast<std::size_t>(std::ceil(kMinCommonShare * static_cast<double>(all.size())));
    bool is_found = false;
    for (std::size_t w = 0; w < whole.size() && !is_found; ++w) {
      std::vector<int> common;
      for (const int image : all)
        if (whole[w].images[at(image)].registered) common.push_back(image);
      if (common.size() < min_images) continue;
      is_found = has_same_shape(whole[w], parts[p], common, min_images);
      if (is_found) parts_of[w].push_back(static_cast<int>(p));
    }
    if (!is_found) return false;
    for (const int image : all) node_of[at(image)] = static_cast<int>(p);
  }
  for (std::size_t w = 0; w < whole.size(); ++w) {
    if (parts_of[w].size() < 2) continue;
    Components components(parts.size() + images);
    for (const RatedPair& rated : pairs_between(whole[w], node_of, pairs)) {
      const int one = node_of[at(rated.pair->first)];
      const int other = node_of[at(rated.pair->second)];
      if (rated.agrees) {
        components.join(one, other);
      } else if (rated.pair->view.inliers.size() >= kMinContradictingInliers &&
                 at(one) < parts.size() && at(other) < parts.size() &&
                 components.root(one) != components.root(other)) {
        return false;
      }
    }
    for (const int part : parts_of[w])
      if (components.root(part) != components.root(parts_of[w][0])) return false;
  }
  return true;
}

}  // namespace tarsier::sfm
