// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/initial_pair.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>

namespace tarsier::sfm {
namespace {}  // namespace

double initial_pair_score(const Pair& pair, const MapperOptions& options) {
  const auto inliers = static_cast<double>(pair.view.inliers.size());
  if (inliers < options.first_inliers || pair.view.in_front < 0.5 * inliers) return 0;
  const double angle = pair.view.median_angle / kRadiansPerDegree;
  if (angle < options.first_angle_deg) return 0;
  const double plane = std::min(1.0, pair.view.homography_inliers / inliers);
  return pair.view.in_front * std::min(angle, 15.0) / 15 * (1.05 - plane);
}

std::vector<const Pair*> best_pairs(const std::vector<Pair>& pairs, std::size_t images) {
  std::vector<const Pair*> best(images, nullptr);
  for (const Pair& pair : pairs) {
    for (const int image : {pair.first, pair.second}) {
      const Pair*& known = best[at(image)];
      if (known == nullptr || pair.view.inliers.size() > known->view.inliers.size() ||
          (pair.view.inliers.size() == known->view.inliers.size() &&
           pair.matches > known->matches)) {
        known = &pair;
      }
    }
  }
  return best;
}

std::string why_not_registered(const Pair* best, const std::vector<Image>& images, int image) {
  if (best == nullptr) return "the image was not matched with any other image";
  const std::string& name = images[at(best->first == image ? best->second : best->first)].name;
  if (best->view.inliers.empty())
    return fmt::format("too few matches: at most {}, with {}, and no two-view geometry fits them",
                       best->matches, name);
  return fmt::format(
      "the best pair of this image has {} inliers, with {}: the pair cannot start a model, and the "
      "image cannot be registered in an existing model",
      best->view.inliers.size(), name);
}

std::string why_no_initial_pair(const std::vector<Pair>& pairs, const std::vector<Image>& images,
                                const MapperOptions& options) {
  const Pair* best = nullptr;
  const Pair* best_by_matches = nullptr;
  for (const Pair& pair : pairs) {
    if (best == nullptr || pair.view.inliers.size() > best->view.inliers.size()) best = &pair;
    if (best_by_matches == nullptr || pair.matches > best_by_matches->matches)
      best_by_matches = &pair;
  }
  if (best == nullptr)
    return "there is no image pair to match: two or more readable images are needed";
  if (best->view.inliers.empty())
    return fmt::format(
        "too few matches in all image pairs: at most {} ({} and {}): take images with more overlap",
        best_by_matches->matches, images[at(best_by_matches->first)].name,
        images[at(best_by_matches->second)].name);
  const auto inliers = static_cast<double>(best->view.inliers.size());
  const std::string names =
      fmt::format("the best pair, {} and {}, has {} inliers", images[at(best->first)].name,
                  images[at(best->second)].name, best->view.inliers.size());
  if (inliers < options.first_inliers)
    return fmt::format("{}, but an initial pair needs {}: take images with more overlap", names,
                       options.first_inliers);
  if (best->view.homography_inliers > 0.9 * inliers)
    return fmt::format(
        "{}, but a homography explains {:.0f} % of them (a flat scene, or a camera that only "
        "rotated): move the camera sideways between images",
        names, 100 * best->view.homography_inliers / inliers);
  return fmt::format(
      "{}, but their triangulation angle is only {:.1f} degrees: move the camera sideways between "
      "images",
      names, best->view.median_angle / kRadiansPerDegree);
}

}  // namespace tarsier::sfm
