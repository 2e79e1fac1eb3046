// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <vector>

// An image that can be sampled at any scale.
namespace tarsier::synth {

// Four floats: blue, green, red, all premultiplied by alpha, and alpha (0..1).
using Pixel4 = float __attribute__((vector_size(16)));

// An image pyramid that also knows where the image is uniform.
class PrintTexture {
 public:
  PrintTexture() = default;
  // CV_8UC1, BGR or BGRA. `mirrored`: repeats beyond its borders with mirroring; otherwise it is
  // clamped.
  PrintTexture(const cv::Mat& image, bool mirrored);

  [[nodiscard]] double width() const { return width_; }  // px
  [[nodiscard]] double height() const { return height_; }
  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  // Bilinear sample of a level; (u, v) in px of the image, (0, 0) is its corner.
  [[nodiscard]] Pixel4 sample(int level, float u, float v) const;
  // Whether everything within `reach` px of (u, v) has nearly one colour. It may return false for a
  // uniform region, and always does for a mirrored image.
  [[nodiscard]] bool is_flat(float u, float v, float reach) const;

 private:
  struct Level {
    cv::Mat pixels;  // CV_32FC4
    float scale_x = 1;
    float scale_y = 1;
  };
  void find_flat_blocks();
  [[nodiscard]] int wrapped(int i, int size) const;

  double width_ = 0;
  double height_ = 0;
  bool mirrored_ = false;
  std::vector<Level> levels_;
  // CV_8UC1, blocks of 2^k px; 1: the block and its neighbours are uniform.
  std::vector<cv::Mat> flat_;
};

}  // namespace tarsier::synth
