// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <span>
#include <stop_token>
#include <string>

// What is learned of faces in general from many people, so that a gallery of one works.
namespace tarsier::face::recognition {

struct BackgroundOptions {
  DescriptorOptions descriptor;
  int components = 256;  // of the people
  // A person of whom there is one image also counts under other light, slightly moved: so many
  // such images, from which the scatter within people is taken.
  int variants = 2;
  double relight = 1.2;   // how far the light goes; 1: an e-fold from cheek to cheek
  double moved_px = 1.5;  // of a face 64 px wide, standard deviation
  double weight = 20;     // Background::weight
  double within_weight = 60;
  std::uint64_t seed = 1;
  // Its numbers in the place of descriptors: the background of deep templates; or null.
  std::shared_ptr<const DeepNetwork> network;

  [[nodiscard]] OptionFields fields() {
    return {{"components", components, range(1, 2000)},
            {"variants", variants, range(1, 20)},
            {"relight", relight, range(0, 3)},
            {"moved_px", moved_px, range(0, 8)},
            {"weight", weight, above(0, 1000)},
            {"within_weight", within_weight, above(0, 1e6)}};
  }
  void check() const;
};

// The face lit otherwise: grey^g exp(a x + b y + c (x^2 - 0.3)), x and y from -1 to 1 across and
// down, with g, a, b and c by chance.
[[nodiscard]] cv::Mat relit_face(const cv::Mat& gray, double strength, std::uint64_t seed);

// One image of each person, all cut alike. Throws std::invalid_argument for fewer than three,
// Interrupted. Stage of `progress`: "describing".
[[nodiscard]] Background learn_background(std::span<const cv::Mat> faces,
                                          const BackgroundOptions& options, Progress& progress,
                                          const std::stop_token& stop);

// Files of type "face-background". Throw ModelError(path), OutputError.
void write_background(const std::string& path, const Background& background,
                      const nlohmann::json& provenance);
[[nodiscard]] Background read_background(const std::string& path);

}  // namespace tarsier::face::recognition
