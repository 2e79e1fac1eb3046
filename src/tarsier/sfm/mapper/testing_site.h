// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/mapper/mapper_hooks.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/model_filter.h"
#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"
#include "tarsier/synth/observed_site.h"

#include <opencv2/core.hpp>

#include <string>
#include <utility>
#include <vector>

namespace tarsier::sfm::test_support {

// A site in the form of the mapper's input.
struct TestSite {
  synth::ObservedSite site;
  std::vector<geometry::Camera> cameras;
  std::vector<Image> images;
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<cv::Mat> descriptors;  // none
  std::vector<Pair> pairs;
};

inline MapperInput input_of(const TestSite& given) {
  return {.cameras = given.cameras,
          .images = given.images,
          .colors = given.colors,
          .descriptors = given.descriptors,
          .pairs = given.pairs};
}

inline MapperOptions options_of(MapperChoice choice, int auto_global) {
  MapperOptions options;
  options.choice = choice;
  options.auto_global = auto_global;
  return options;
}

// Registered images of the largest model.
inline int registered(const Reconstruction& built) {
  return built.models.empty() ? 0 : statistics_of(built.models[0]).registered;
}

// Calls run(hooks) with a checkpoint at every step, and returns the checkpoints.
template <typename Run>
std::vector<MapperState> states_of(const Run& run, Reconstruction& built) {
  std::vector<MapperState> states;
  MapperHooks hooks;
  hooks.save_checkpoint = [&](const MapperState& state) { states.push_back(state); };
  hooks.save_interval_s = 0;
  built = run(hooks);
  return states;
}

inline TestSite given(const synth::SiteOptions& options) {
  TestSite result;
  result.site = synth::make_observed_site(options);
  result.cameras = {result.site.camera};
  for (std::size_t i = 0; i < result.site.poses.size(); ++i) {
    Image image;
    image.name = std::to_string(i);
    image.features = result.site.features[i];
    result.colors.emplace_back(image.features.size(), cv::Vec3b(1, 2, 3));
    result.images.push_back(std::move(image));
  }
  for (const auto& known : result.site.pairs) {
    std::vector<Match> matches;
    for (const auto& [first, second] : known.matches) matches.push_back({first, second});
    Pair pair;
    pair.first = known.first;
    pair.second = known.second;
    pair.matches = static_cast<int>(matches.size());
    pair.view = verify_pair(result.images[static_cast<std::size_t>(pair.first)].features,
                            result.images[static_cast<std::size_t>(pair.second)].features, matches,
                            result.site.camera, result.site.camera, {});
    result.pairs.push_back(std::move(pair));
  }
  return result;
}

inline TestSite given(synth::SiteKind kind, int images, int features = 200, int neighbours = 8) {
  synth::SiteOptions options;
  options.kind = kind;
  options.images = images;
  options.features = features;
  options.neighbours = neighbours;
  return given(options);
}

}  // namespace tarsier::sfm::test_support
