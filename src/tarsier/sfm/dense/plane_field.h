// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/dense/patch_kernels.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <vector>

// A plane for each pixel of an image, and the images it is compared with. Internal to this module.
namespace tarsier::sfm {

inline constexpr int kMaxSources = 16;

// A plane through the point that a pixel (u, v) sees, in the camera frame. On every plane, inverse
// depth is an affine function of the pixel: 1 / z at (u + dx, v + dy) is inverse_depth + slope_x dx
// + slope_y dy.
struct Plane {
  float inverse_depth = 0;
  float slope_x = 0;  // per px
  float slope_y = 0;
};

// The unit normal of a plane at a pixel, pointing to the camera; and the inverse function (inverse
// depth above 0, normal not perpendicular to the ray).
[[nodiscard]] cv::Vec3f normal_of(const geometry::Camera& camera, int x, int y, const Plane& plane);
[[nodiscard]] Plane plane_of(const geometry::Camera& camera, int x, int y, float inverse_depth,
                             const cv::Vec3f& normal);

// Another image, relative to the reference, at one scale.
struct SourceLevel {
  std::vector<std::uint32_t> words;  // GrayQuads
  cv::Size size;
  [[nodiscard]] GrayQuads quads() const { return {words.data(), size.width, size.height}; }
  // A pixel p = (u, v, 1) of the reference at inverse depth w is at to_source p + to_source_w w.
  std::array<float, 9> to_source{};
  std::array<float, 3> to_source_w{};
  // The inverse mapping, from a pixel of the source and its inverse depth there.
  std::array<float, 9> to_reference{};
  std::array<float, 3> to_reference_w{};
  cv::Mat1f inverse_depth;  // of the source; 0: unknown; empty: not used
};

struct MatchLevel {
  cv::Mat1b gray;
  geometry::Camera camera;
  std::vector<SourceLevel> sources;
  // The same images, larger, for small patches with enough texture (plane_sweeper.h); all or none.
  // Coordinates are pixels of `camera`, too.
  std::vector<SourceLevel> large_sources;
  std::vector<std::uint32_t> large_words;  // of the reference: GrayQuads
  cv::Size large_size;
  float min_inverse_depth = 0;
  float max_inverse_depth = 0;
};

[[nodiscard]] std::vector<std::uint32_t> gray_words(const cv::Mat1b& gray);
[[nodiscard]] SourceLevel make_source(const cv::Mat1b& gray, const geometry::Camera& camera,
                                      const geometry::Rigid3& source_from_reference,
                                      const geometry::Camera& reference);

struct PlaneField {
  cv::Size size;
  std::vector<Plane> planes;
  std::vector<float> costs;               // for the views chosen for each pixel
  std::vector<std::uint16_t> view_costs;  // of each source at each pixel, in units of 1 / kCostUnit
  int sources = 0;

  static constexpr float kCostUnit = 16384;
  PlaneField() = default;
  PlaneField(cv::Size size, int sources);
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(size.width) +
           static_cast<std::size_t>(x);
  }
};

// A field of another size. Each plane is that of the nearest pixel of `coarse`.
[[nodiscard]] PlaneField enlarged(const PlaneField& coarse, cv::Size size);

}  // namespace tarsier::sfm
