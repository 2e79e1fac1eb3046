// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/matx.hpp>

#include <array>
#include <string>
#include <vector>

namespace tarsier::render {

// An image pyramid down to 1 x 1 (mipmap), so that distant textures are averaged.
struct Texture {
  std::vector<cv::Mat> levels;  // CV_8UC3 BGR, each half the size of the one before
};
// Throws std::invalid_argument unless `image` is CV_8UC3.
[[nodiscard]] Texture make_texture(const cv::Mat& image);

struct Material {
  std::string name;
  cv::Vec3f color{0.8F, 0.8F, 0.8F};  // BGR, 0..1; multiplied by the texture, if any
  int texture = -1;                   // index, -1: none
};

// Indices into the lists of a Mesh, counter-clockwise as seen from outside.
struct Triangle {
  std::array<int, 3> position{0, 0, 0};
  std::array<int, 3> normal{-1, -1, -1};  // all or none; none: flat shading
  std::array<int, 3> uv{-1, -1, -1};      // all or none
  int material = -1;                      // -1: grey
};

// Surfaces of triangles, in a right-handed frame of any unit. uv as in Wavefront files: (0, 0) is
// the texture's bottom left corner, (1, 1) its top right. The texture repeats outside this range.
struct Mesh {
  std::vector<cv::Vec3f> positions;
  std::vector<cv::Vec3f> normals;  // of length 1, outwards
  std::vector<cv::Vec2f> uvs;
  std::vector<Triangle> triangles;
  std::vector<Material> materials;
  std::vector<Texture> textures;

  // Throws std::invalid_argument, which names the first fault: an index out of range, a non-finite
  // number, a texture without levels.
  void check() const;
};

struct Bounds {
  cv::Vec3f low{};
  cv::Vec3f high{};
};
// Bounds of the positions that triangles use. Throws std::invalid_argument for a mesh without
// triangles.
[[nodiscard]] Bounds bounds_of(const Mesh& mesh);

// Adds normals to the triangles that have none. The normal at a corner is the area-weighted mean of
// the adjacent triangles within `crease_deg` of this one (0..180), so that edges stay sharp.
void add_normals(Mesh& mesh, double crease_deg = 50);

// Appends `other` with its materials and textures.
void append(Mesh& mesh, const Mesh& other);

}  // namespace tarsier::render
