// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/model_merger.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/sfm/joining/join_models.h"
#include "tarsier/sfm/joining/joined_mapper.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/scene/colmap.h"

#include <fmt/format.h>

#include <cstddef>
#include <utility>

namespace tarsier::sfm {
namespace {

Model read_part(const std::string& folder) {
  Model model = read_colmap(folder);
  for (const Image& image : model.images) {
    const geometry::Camera& camera = model.cameras[at(image.camera)];
    if (camera.lens != geometry::Lens::kPinhole)
      throw InputError(
          folder,
          fmt::format("a camera has a {} lens, but only models with pinhole cameras can be merged",
                      geometry::name_of(camera.lens)));
  }
  return model;
}

// The images of all models, without descriptors. An image of several models is taken from the
// first.
MatchedImages images_of(const std::vector<Model>& models) {
  MatchedImages matched;
  for (std::size_t i = 0; i < models.front().images.size(); ++i) {
    ImageFeatures image;
    image.input = static_cast<int>(i);
    for (const Model& model : models) {
      if (!model.images[i].registered) continue;
      const geometry::Camera& camera = model.cameras[at(model.images[i].camera)];
      image.size = {camera.width, camera.height};
      image.lens = {camera, "given"};
      image.features.points = model.images[i].features;
      image.features.colors.assign(image.features.points.size(), cv::Vec3b::all(128));
      break;
    }
    matched.images.push_back(std::move(image));
  }
  return matched;
}

}  // namespace

ReconstructorResult merge_models(const std::vector<std::string>& folders,
                                 const ReconstructorOptions& options, Progress& progress,
                                 const std::stop_token& stop, const ReconstructorHooks& hooks) {
  TARSIER_REQUIRE(folders.size() >= 2, "{} models: two or more are needed", folders.size());
  std::vector<Model> models;
  progress.begin("load", static_cast<std::int64_t>(folders.size()), "models");
  for (const std::string& folder : folders) {
    throw_if_stopped(stop);
    models.push_back(read_part(folder));
    progress.advance();
  }
  progress.end();
  models = with_same_images(models);
  std::vector<Input> inputs;
  for (const Image& image : models.front().images) inputs.push_back({image.name, ""});
  MappedParts parts;
  for (std::size_t m = 0; m < models.size(); ++m) parts.parts.push_back({folders[m], models[m]});

  ReconstructorOptions how = options;
  how.cache = false;
  how.pipeline = {};
  how.pipeline.seed = options.pipeline.seed;
  how.pipeline.pairs = PairChoice::kExhaustive;  // no pairs are searched
  how.pipeline.fixed_camera = true;              // unless the models differ
  ReconstructorHooks mapping = hooks;
  mapping.matched = [&](MatchedImages& matched) { matched = images_of(models); };
  mapping.map = [&](const MapperInput& input, const MapperOptions& mapper, const MapperHooks&) {
    // Uses the cameras of the models, each of which may be refined.
    const MapperInput known{.cameras = models.front().cameras,
                            .images = input.images,
                            .colors = input.colors,
                            .descriptors = input.descriptors,
                            .pairs = input.pairs};
    return map_joined(known, mapper, parts, progress, stop);
  };
  return Reconstructor(how).run_images(inputs, progress, stop, mapping);
}

}  // namespace tarsier::sfm
