// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <utility>
#include <vector>

// Simulated observations of large scenes by thousands of images, without rendering the images: to
// test the stages after matching.
namespace tarsier::synth {

// z is up; the unit is the metre.
enum class SiteKind {
  kRing,       // one round, looking at a wall inside: a single large loop
  kGrid,       // from the air, straight down, in rows
  kWalk,       // along a winding street, without a loop
  kCity,       // through all streets of a city of square blocks, half of them twice: many loops
  kSymmetric,  // around a prism on white, whose sides are alike except for details
};

struct SiteOptions {
  std::uint64_t seed = 1;
  SiteKind kind = SiteKind::kCity;
  int images = 300;
  int features = 300;  // maximum per image
  // Images with which each image is matched: those with most features in common.
  int neighbours = 12;
  double noise_px = 0.5;      // standard deviation of a feature's position
  double drop_out = 0.25;     // probability that a visible point is not detected
  double wrong_share = 0.03;  // share of matches with an arbitrary feature
  double repeats = 0;         // share of 10 m facade sections that look like others
  int sides = 4;              // for kSymmetric
  double details = 0.2;       // for kSymmetric: share of points that are unique to a side

  [[nodiscard]] OptionFields fields() {
    return {{"images", images, range(3, 100'000)},
            {"features", features, range(50, 10'000), "--features",
             "maximum number of features of an image, with --observations"},
            {"neighbours", neighbours, range(2, 1000)},
            {"noise_px", noise_px, range(0, 20)},
            {"drop_out", drop_out, range(0, 0.9), "--drop-out",
             "probability that a visible point is not detected, with --observations"},
            {"wrong_share", wrong_share, range(0, 0.9)},
            {"repeats", repeats, range(0, 1), "--repeats",
             "share of repeated facades (--observations) or houses (--trajectory walk and city)"},
            {"sides", sides, range(2, 12), "--sides",
             "number of sides of the prism of --trajectory symmetric"},
            {"details", details, range(0, 1), "--details",
             "share of points (--trajectory symmetric) or area (--content symmetric, ..) unique to "
             "a side"}};
  }
  void check() const { check_fields(*this); }
};

struct ObservedSite {
  struct Pair {
    int first = 0;
    int second = 0;
    std::vector<std::pair<int, int>> matches;  // feature indices
    bool same_place = false;  // whether most matches are of the same points, not of similar ones
  };
  geometry::Camera camera;              // 640 x 480, not distorted
  std::vector<geometry::Rigid3> poses;  // camera from world
  std::vector<std::vector<cv::Point2f>> features;
  std::vector<Pair> pairs;  // by first, then second
};

// Deterministic for given options. Throws std::invalid_argument (options).
[[nodiscard]] ObservedSite make_observed_site(const SiteOptions& options);

}  // namespace tarsier::synth
