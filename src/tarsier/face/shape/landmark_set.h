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
  std::string image;        // path, relative to the set's file or absolute
  Eigen::Matrix2Xd points;  // px, centres at integers; NaN, NaN: missing (hidden, not yet placed)
  std::optional<cv::Rect2d> box;  // px, where a detector or a person saw the object
  std::string person;             // who or what is shown, for studies by person; "": not known

  [[nodiscard]] bool is_missing(int point) const;
  [[nodiscard]] bool is_complete() const;
};

// Annotated images of one kind of object.
struct LandmarkSet {
  std::vector<LandmarkSample> samples;  // all of the same number of points
  // mirror[i]: the point that point i is in the mirrored image (i itself on the axis); a
  // permutation that is its own inverse. Empty: not known.
  std::vector<int> mirror;
  std::vector<std::array<int, 2>> connections;  // lines to draw

  [[nodiscard]] int points() const;  // of each sample; 0 without samples
  // Throws std::invalid_argument that names the first fault: numbers of points that differ,
  // infinite values, indices out of range, a mirror that is no involution.
  void check() const;
};

// The sample as it is in its mirrored image of that width: x' = width - 1 - x, points renamed by
// `mirror`, box too. Throws std::invalid_argument where the sizes disagree.
[[nodiscard]] LandmarkSample mirrored(const LandmarkSample& sample, const std::vector<int>& mirror,
                                      int image_width);

// Only the samples in which no point is missing.
[[nodiscard]] LandmarkSet complete_samples(const LandmarkSet& set);

// Mirror and connections of well-known markups: 68 (300-W, Multi-PIE), 76 (MUCT), 73 (IMM frontal);
// nothing for other numbers.
struct Markup {
  std::vector<int> mirror;
  std::vector<std::array<int, 2>> connections;
  std::array<int, 2> outer_eyes{-1, -1};  // outer corners: image left, image right
};
[[nodiscard]] std::optional<Markup> known_markup(int points);

// The path of a sample's image, from the place of its set's file.
[[nodiscard]] std::string image_path(const std::string& set_path, const LandmarkSample& sample);

// A file of type "landmark-set" (JSON, which is YAML too). read throws InputError with the path for
// anything malformed; write is atomic and makes the images' paths relative to the file where they
// lie beside or below it (`base`: the folder that relative paths in `set` are relative to now).
[[nodiscard]] LandmarkSet read_landmark_set(const std::string& path);
void write_landmark_set(const std::string& path, const LandmarkSet& set, const std::string& base);

}  // namespace tarsier::face::shape
