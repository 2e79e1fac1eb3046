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

// Statistics of faces in general, learned from many people. They make a gallery of one person
// usable.
namespace tarsier::face::recognition {

struct BackgroundOptions {
  DescriptorOptions descriptor;
  int components = 256;  // of the people
  // A person with a single image is also used with this number of synthetic images (other light,
  // slightly moved). The scatter within people is computed from these.
  int variants = 2;
  // Strength of the light change; 1: a factor of e from cheek to cheek.
  double relight = 1.2;
  double moved_px = 1.5;  // standard deviation, for a face 64 px wide
  double weight = 20;     // Background::weight
  double within_weight = 60;
  std::uint64_t seed = 1;
  // Its embeddings are used instead of descriptors: the background of deep templates. May be null.
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

// The face under other light: grey^g exp(a x + b y + c (x^2 - 0.3)), x and y from -1 to 1 across
// and down, with random g, a, b and c.
[[nodiscard]] cv::Mat relit_face(const cv::Mat& gray, double strength, std::uint64_t seed);

// One image per person, all with the same alignment. Throws std::invalid_argument for fewer than
// three images, Interrupted. Stage of `progress`: "describing".
[[nodiscard]] Background learn_background(std::span<const cv::Mat> faces,
                                          const BackgroundOptions& options, Progress& progress,
                                          const std::stop_token& stop);

// Files of type "face-background". Throws ModelError(path), OutputError.
void write_background(const std::string& path, const Background& background,
                      const nlohmann::json& provenance);
[[nodiscard]] Background read_background(const std::string& path);

}  // namespace tarsier::face::recognition
