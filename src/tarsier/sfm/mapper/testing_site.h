// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
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
  std::vector<Pair> pairs;
};

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
