// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/mapper_key.h"

#include "tarsier/media/sha256.h"

#include <fmt/format.h>

#include <cstdint>
#include <span>

namespace tarsier::sfm {

std::string mapper_key(const std::vector<ImageFeatures>& images,
                       const std::vector<std::string>& names, const ImageSet& image_set,
                       const std::vector<Pair>& pairs, const std::optional<StartPoses>& start,
                       const PipelineOptions& options) {
  const MapperOptions& m = options.mapper;
  Sha256 sum;
  sum.add(fmt::format("mapper-16 {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {}",
                      static_cast<int>(m.choice), m.auto_global, m.reprojection_px, m.min_angle_deg,
                      m.first_angle_deg, m.first_inliers, m.pose_inliers, m.pose_inlier_share,
                      m.pose_px, m.min_views, m.min_images, m.extend_px, m.extend_similarity,
                      m.refine_focal, m.refine_center, m.refine_distortion, m.seed, options.flow,
                      static_cast<int>(options.features.kind), options.shared_camera));
  for (std::size_t k = 0; k < images.size(); ++k) {
    sum.add(
        fmt::format("\n{} {} {}", partner_key(images[k]), image_set.images()[k].camera, names[k]));
  }
  for (const Pair& pair : pairs) {
    sum.add(fmt::format("\n{} {} {} {} {} {}", pair.first, pair.second, pair.matches,
                        pair.view.homography_inliers, pair.view.in_front, pair.view.median_angle));
    for (const double number : geometry::packed(pair.view.second_from_first))
      sum.add(fmt::format(" {}", number));
    sum.add(std::span(reinterpret_cast<const std::uint8_t*>(pair.view.inliers.data()),
                      pair.view.inliers.size() * sizeof(Match)));
  }
  if (start) {
    sum.add(fmt::format("\nstart {} {}", start->fixed, fmt::join(start->fixed_cameras, " ")));
    for (const auto& pose : start->poses) {
      sum.add("\n");
      if (!pose) continue;
      for (const double number : geometry::packed(*pose)) sum.add(fmt::format(" {}", number));
    }
  }
  return sum.hex().substr(0, 32);
}

}  // namespace tarsier::sfm
