// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/recognition/background.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

// Synthetic images instead of faces: smooth random textures, one per person, with random light,
// motion and noise in each image.
namespace tarsier::face::recognition {

struct SyntheticFaces {
  std::vector<cv::Mat> faces;
  std::vector<std::string> labels;
};

inline cv::Mat random_texture(Rng& rng, cv::Size size, double sigma) {
  cv::Mat noise(size, CV_32FC1);
  for (int y = 0; y < size.height; ++y)
    for (int x = 0; x < size.width; ++x) noise.at<float>(y, x) = static_cast<float>(rng.normal());
  cv::GaussianBlur(noise, noise, {}, sigma);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(noise, mean, deviation);
  return (noise - mean[0]) / deviation[0];
}

// `first`: number of the first person ("p0", "p1" ..); each number has its own texture. `light` 0:
// even.
inline SyntheticFaces synthetic_faces(int people, int images, double light, std::uint64_t seed,
                                      int first = 0, cv::Size size = {64, 80}) {
  SyntheticFaces out;
  for (int p = first; p < first + people; ++p) {
    Rng person = Rng(4711).fork(static_cast<std::uint64_t>(p));
    const cv::Mat texture =
        0.5 * random_texture(person, size, 4) + 0.5 * random_texture(person, size, 2);
    for (int k = 0; k < images; ++k) {
      Rng rng = Rng(seed).fork(static_cast<std::uint64_t>(1000 * p + k));
      const double ax = light * rng.normal();
      const double ay = light * rng.normal();
      const double gain = std::exp(light * rng.normal());
      const double dx = rng.uniform(-1, 1);
      const double dy = rng.uniform(-1, 1);
      cv::Mat map = (cv::Mat_<double>(2, 3) << 1, 0, dx, 0, 1, dy);
      cv::Mat moved;
      cv::warpAffine(texture, moved, map, size, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
      cv::Mat face(size, CV_8UC1);
      for (int y = 0; y < size.height; ++y) {
        for (int x = 0; x < size.width; ++x) {
          const double slope =
              ax * (x - size.width / 2.0) / size.width + ay * (y - size.height / 2.0) / size.height;
          const double value =
              gain * std::exp(1.5 * slope) * (100 + 30 * moved.at<float>(y, x)) + 3 * rng.normal();
          face.at<unsigned char>(y, x) = cv::saturate_cast<unsigned char>(value);
        }
      }
      out.faces.push_back(face);
      out.labels.push_back(std::string("p").append(std::to_string(p)));
    }
  }
  return out;
}

// Learned from people `first` .. first + people - 1.
inline Background synthetic_background(int people = 80, int first = 500, int components = 40,
                                       cv::Size size = {64, 80}) {
  const auto many = synthetic_faces(people, 1, 0.3, 3, first, size);
  BackgroundOptions options;
  options.components = components;
  NoProgress quiet;
  return learn_background(many.faces, options, quiet, {});
}

}  // namespace tarsier::face::recognition
