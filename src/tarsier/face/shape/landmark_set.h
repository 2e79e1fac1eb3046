// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face::shape {

// One annotated object in one image.
struct LandmarkSample {
  std::string image;  // path, relative to the set's file or absolute
  // px, pixel centres at integers; NaN, NaN: missing (hidden, not yet placed).
  Eigen::Matrix2Xd points;
  std::optional<cv::Rect2d> box;  // px, from a detector or a person
  std::string person;             // who or what is shown, for studies by person; "": unknown

  [[nodiscard]] bool is_missing(int point) const;
  [[nodiscard]] bool is_complete() const;
};

// Annotated images of one kind of object.
struct LandmarkSet {
  std::vector<LandmarkSample> samples;  // all with the same number of points
  // mirror[i]: index of point i in the mirrored image (i itself on the axis); a permutation that is
  // its own inverse. Empty: unknown.
  std::vector<int> mirror;
  std::vector<std::array<int, 2>> connections;  // lines to draw

  [[nodiscard]] int points() const;  // per sample; 0 without samples
  // Throws std::invalid_argument that names the first error: different numbers of points, infinite
  // values, indices out of range, a mirror that is not an involution.
  void check() const;
};

// The sample in the mirrored image of that width: x' = width - 1 - x, points renumbered by
// `mirror`, and the box. Throws std::invalid_argument for different sizes.
[[nodiscard]] LandmarkSample mirrored(const LandmarkSample& sample, const std::vector<int>& mirror,
                                      int image_width);

// The samples without missing points.
[[nodiscard]] LandmarkSet complete_samples(const LandmarkSet& set);

// Mirror and connections of well-known markups: 68 (300-W, Multi-PIE), 76 (MUCT), 73 (IMM frontal)
// points; empty for other numbers.
struct Markup {
  std::vector<int> mirror;
  std::vector<std::array<int, 2>> connections;
  std::array<int, 2> outer_eyes{-1, -1};  // outer corners: image left, image right
};
[[nodiscard]] std::optional<Markup> known_markup(int points);

// The path of a sample's image, given the path of the set's file.
[[nodiscard]] std::string image_path(const std::string& set_path, const LandmarkSample& sample);

// Files of type "landmark-set" (JSON, which is also YAML). read throws InputError with the path if
// the file is malformed. write is atomic. It makes image paths relative to the file if the images
// are in the same folder or below (`base`: the folder to which relative paths in `set` currently
// refer).
[[nodiscard]] LandmarkSet read_landmark_set(const std::string& path);
void write_landmark_set(const std::string& path, const LandmarkSet& set, const std::string& base);

}  // namespace tarsier::face::shape
