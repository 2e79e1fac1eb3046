// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/extend_model.h"

#include "tarsier/core/require.h"
#include "tarsier/sfm/mapper/growth.h"
#include "tarsier/sfm/mapper/incremental_mapper.h"

#include <cstddef>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

// Options of adjustments in extend_model().
constexpr IncrementalMapper::RefineOptions kRoughRefinement{.tolerance = 1e-3};
constexpr int kMaxSmallModelImages = 10;  // images of a model that is cheap to adjust as a whole

}  // namespace

ExtendedModel extend_model(const Model& before, const MapperInput& input,
                           const MapperOptions& options, const ExtendOptions& extend,
                           const std::stop_token& stop) {
  options.check();
  const std::vector<Image>& images = input.images;
  TARSIER_REQUIRE(
      before.images.size() <= images.size() && before.cameras.size() <= input.cameras.size(),
      "{} images, but the model before has {}", images.size(), before.images.size());
  Model all;
  all.images = images;
  all.cameras = input.cameras;
  std::vector<int> features;
  features.reserve(images.size());
  for (const Image& image : images) features.push_back(static_cast<int>(image.features.size()));
  IncrementalMapper mapper(std::move(all), make_tracks(input.pairs, features), input.descriptors,
                           input.kind, options);
  mapper.resume(before);
  const std::vector<bool> used(images.size(), false);
  ExtendedModel result;
  Growth growth;
  growth.adjusted_at = extend.adjusted_at;
  add_images(mapper, used, mapper.registered() < kMaxSmallModelImages, growth, {}, stop);
  if (extend.adjust_all) {
    mapper.refine_all(2, kRoughRefinement, stop);
    if (mapper.extend_tracks(stop) > 0) mapper.refine_all(1, kRoughRefinement, stop);
    growth.adjusted_at = mapper.registered();
  }
  result.adjusted_at = growth.adjusted_at;
  result.model = mapper.finished(input.colors);
  return result;
}

}  // namespace tarsier::sfm
