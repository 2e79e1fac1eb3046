// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <vector>

// An image to be sampled at any scale.
namespace tarsier::synth {

// Four floats: blue, green, red, all times alpha, and alpha (0..1).
using Pixel4 = float __attribute__((vector_size(16)));

// Averages of the image over ever larger pixels, and where it is of one colour.
class PrintTexture {
 public:
  PrintTexture() = default;
  // CV_8UC1, BGR or BGRA. `mirrored`: goes on beyond its borders, mirrored; else it is clamped.
  PrintTexture(const cv::Mat& image, bool mirrored);

  [[nodiscard]] double width() const { return width_; }  // px
  [[nodiscard]] double height() const { return height_; }
  [[nodiscard]] int levels() const { return static_cast<int>(levels_.size()); }
  // Bilinear, of a level; (u, v) in px of the image, its corner is (0, 0).
  [[nodiscard]] Pixel4 sample(int level, float u, float v) const;
  // Whether all within `reach` px of (u, v) is of nearly one colour. May say no where it is, and does
  // of a mirrored one.
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
  std::vector<cv::Mat> flat_;  // CV_8UC1, of blocks of 2^k px; 1: it and its neighbours are flat
};

}  // namespace tarsier::synth
