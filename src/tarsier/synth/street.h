// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/synth/plates.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

// Synthetic cars with number plates on a street, seen by a pinhole camera, with exact ground truth.
namespace tarsier::synth {

enum class StreetLight {
  kDay,
  kNight,     // lamps and plates are lit
  kInfrared,  // grey: plates reflect the light, everything else is dark
};

struct StreetOptions {
  cv::Size size{1280, 720};
  StreetLight light = StreetLight::kDay;
  std::vector<PlateKind> kinds{PlateKind::kSpain};
  // For render_car(): plates of PlateFaceOptions::wild, in 60 random typefaces made from the seed.
  bool wild = false;
  // For render_car(): maximum distance of the cars, relative to the nearest possible distance.
  double max_distance_ratio = 2.9;
  std::uint64_t seed = 1;
  double seconds = 60;  // of a drive
  int cars = 6;         // total of a drive
  int parked = 1;       // of these, always in view
  int distant = 1;      // of these, never near

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(64, 8192)},
            {"size.height", size.height, range(48, 8192)},
            {"farthest", max_distance_ratio, range(1, 100), "--far",
             "maximum distance of the cars, in multiples of the minimum"},
            {"seconds", seconds, above(0, 86400)}};
  }
  void check() const;
};

struct StreetPlate {
  int id = 0;  // of the car, from 1
  std::string text;
  std::array<cv::Point2f, 4> corners{};  // px, from the plate's top left, clockwise
  bool visible = false;                  // entirely in the image, and not hidden by another car
};

struct StreetImage {
  cv::Mat image;  // CV_8UC3
  std::vector<StreetPlate> plates;
};

// A drive of a minute: cars come and go, one is parked, one waits far away. Const after
// construction.
class Drive {
 public:
  explicit Drive(const StreetOptions& options);  // throws InputError without typefaces
  ~Drive();
  Drive(Drive&&) noexcept;
  Drive& operator=(Drive&&) noexcept;

  // The street at `time` s. Deterministic for given options and time.
  [[nodiscard]] StreetImage at(double time) const;
  // Texts of all cars, by id.
  [[nodiscard]] std::vector<std::string> texts() const;

  struct Parts;

 private:
  std::unique_ptr<const Parts> parts_;
};

// One or two nearby cars; another scene for each `number`.
[[nodiscard]] StreetImage render_car(const StreetOptions& options, std::uint64_t number);

}  // namespace tarsier::synth
