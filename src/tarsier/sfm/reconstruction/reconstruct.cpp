// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/reconstruct.h"

#include "tarsier/core/errors.h"
#include "tarsier/sfm/consistency/patch_evidence.h"
#include "tarsier/sfm/mapper/contradicted_images.h"
#include "tarsier/sfm/mapper/mapping.h"
#include "tarsier/sfm/reconstruction/all_pairs.h"
#include "tarsier/sfm/reconstruction/joint_correction.h"
#include "tarsier/sfm/reconstruction/remapping_checkpoint.h"
#include "tarsier/sfm/reconstruction/strong_pairs.h"

#include <fmt/format.h>

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

// The rejections by pixels, where pixels are available.
std::vector<PatchRejection> rejections_by_pixels(const MapperInput& input, Progress& progress,
                                                 const std::stop_token& stop) {
  if (!input.gray) return std::vector<PatchRejection>(input.pairs.size());
  std::vector<std::vector<cv::Point2f>> features;
  features.reserve(input.images.size());
  for (const Image& image : input.images) features.push_back(image.features);
  return rejections_by_patches(
      input.pairs, features.size(),
      compare_all_patches(features, input.pairs, input.gray, progress, stop));
}

Reconstruction with_shape_trust(Reconstruction made) {
  for (std::size_t m = 0; m < made.trust.size(); ++m) {
    made.trust[m] *= shape_trust(made.shapes[m]);
    if (const int count = made.shapes[m].missing_places; count > 0)
      made.log.push_back(fmt::format(
          "model {} probably lacks a place that looks like the next one: {} images show "
          "two parts of it side by side that are apart in the model",
          m, count));
  }
  return made;
}

}  // namespace

Reconstruction reconstruct(const MapperInput& input, const MapperOptions& options,
                           Progress& progress, const std::stop_token& stop,
                           const MapperHooks& hooks) {
  options.check();
  RemappingCheckpoint checkpoint(input, hooks);
  const MapperHooks first = checkpoint.first();
  MappingResult mapped = map_images(input, options, progress, stop, first);
  Reconstruction result = std::move(mapped.reconstruction);
  // Reconstructions from given poses are not repeated without these.
  if (result.interrupted || input.start) return result;
  if (!result.has_conflicts) {
    if (mapped.is_repetitive) remove_contradicted_images(input.pairs, result);
    return result;
  }
  const auto map = [&](const std::vector<Pair>& pairs) {
    const MapperInput among{.cameras = input.cameras,
                            .images = input.images,
                            .colors = input.colors,
                            .descriptors = input.descriptors,
                            .release_memory = input.release_memory,
                            .kind = input.kind,
                            .pairs = pairs,
                            .tracked = input.tracked,
                            .is_repetitive = true};
    const MapperHooks next = checkpoint.next_attempt();
    Reconstruction made = map_images(among, options, progress, stop, next).reconstruction;
    update_trust_by_all_pairs(input, options, stop, made);
    return made;
  };
  std::optional<Reconstruction> second;
  try {
    if (checkpoint.patch_rejections().empty())
      checkpoint.save_patch_rejections(rejections_by_pixels(input, progress, stop));
    const std::vector<PatchRejection> rejections = checkpoint.patch_rejections();
    update_trust_by_all_pairs(input, options, stop, result);
    lower_trust(input.pairs, rejections, result);
    second = map_strong_pairs_first(input.pairs, rejections, input.images.size(), map);
    lower_trust(input.pairs, rejections, *second);
  } catch (const Interrupted&) {
    if (!hooks.partial) throw;
    result.interrupted = true;
    return result;
  }
  // Only for scenes that repeat. Otherwise pairs may disagree for other reasons, e.g. an inexact
  // focal length.
  Reconstruction better = better_of(input.pairs, std::move(result), std::move(*second));
  try {
    correct_joints(
        input.pairs,
        [&](const std::vector<Pair>& pairs) {
          Reconstruction made = map(pairs);
          lower_trust(input.pairs, checkpoint.patch_rejections(), made);
          return made;
        },
        better);
  } catch (const Interrupted&) {
    if (!hooks.partial) throw;
    better.interrupted = true;
  }
  remove_contradicted_images(input.pairs, better);
  return with_shape_trust(std::move(better));
}

}  // namespace tarsier::sfm
