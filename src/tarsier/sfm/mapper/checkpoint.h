// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/doubt.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// Where the mapper is, so that another process goes on from there and ends with the same model, to
// the last bit. Features, pairs and options are not in it: they are worked out (or read from the
// cache) before mapping, and the checkpoint is kept under a key of all of them.
namespace tarsier::sfm {

// A model without what its images' features are.
struct PackedModel {
  std::vector<geometry::Camera> cameras;
  std::vector<int> registered;  // images, ascending
  std::vector<geometry::Rigid3> poses;
  std::vector<int> places;  // of each point with observations, in Model::points
  std::int64_t points = 0;  // Model::points.size()
  std::vector<Eigen::Vector3d> positions;
  std::vector<cv::Vec3b> colors;
  std::vector<double> errors;
  std::vector<int> views;                 // observations of each point
  std::vector<Observation> observations;  // of all points, one after the other
};
[[nodiscard]] PackedModel packed(const Model& model);
// Into a model that has the images, none of them registered, and as many points, all empty.
void unpack(const PackedModel& packed, Model& model);
// As a part of a packed file; the reader throws Damaged. Whether every index of one is that of so many cameras and of these
// images' features.
void put(PackedWriter& writer, const PackedModel& model);
[[nodiscard]] PackedModel get_packed_model(PackedReader& reader);
[[nodiscard]] bool fits(const PackedModel& model, std::size_t cameras,
                        const std::vector<Image>& images);

// One growing model.
struct IncrementalMapperState {
  PackedModel model;
  std::vector<geometry::Camera> ray_cameras;     // that its rays were measured with
  std::vector<std::vector<Observation>> tracks;  // where they are not those of the pairs any more
};

// All poses at once (global_start.h), between two of its steps.
struct GlobalStartState {
  enum Step {
    kRotations,
    kPositions,
    kAdjustment,
    kRefused  // has nothing but the image
  };
  int image = -1;  // one of the component that is mapped
  int step = kRotations;
  int round = 0;                           // of the step
  std::vector<int> edges;                  // which of the component's pairs are left, ascending
  std::vector<int> nodes;                  // images that they join, ascending; from kPositions on
  std::vector<Eigen::Matrix3d> rotations;  // camera_from_world of each node, the same
  PackedModel model;                       // from kAdjustment on; without points
  std::vector<Eigen::Vector3d> points;     // of each track, the same
  std::vector<Doubt> doubts;               // of each of the component's pairs
  std::vector<std::string> log;            // of these steps
};
// Whether every index is one of so many pairs of a component, cameras and images. Of the points the tracks decide.
[[nodiscard]] bool fits(const GlobalStartState& state, std::size_t pairs, std::size_t cameras,
                        const std::vector<Image>& images);

struct MapperState {
  std::vector<PackedModel> models;  // that are done
  bool has_aside =
      false;  // the last of them is set aside: its images are mapped once more, globally
  std::vector<std::string> log;
  std::vector<std::string> reasons;               // of each image: why it is not in, so far
  std::vector<Doubt> doubts;                      // of each pair
  bool done = false;                              // all of it
  std::optional<IncrementalMapperState> current;  // the model that grows
  bool is_global = false;                         // it began with all images at once
  std::vector<std::pair<int, int>> failed;        // image: points it saw when it failed
  int adjusted_at = 0;                            // images in it when all of it was last adjusted
  int stage = 0;                                  // 0: images are added; then the steps of the end
  int round = 0;                                  // of the stage
  std::optional<GlobalStartState> start;          // where all poses are being found at once
  // Of images that are mapped again from their strongest pairs (strong_pairs.h), once the above is done: what is said
  // against each pair by its patches, and each try so far. A try has no tries of its own.
  std::vector<PatchDoubt> patch_doubts;
  std::vector<MapperState> tries;
  // Images in all models.
  [[nodiscard]] int registered() const;
};

// Whether every index is one of so many images, features, cameras and pairs; but for those of `start`.
[[nodiscard]] bool fits(const MapperState& state, const std::vector<geometry::Camera>& cameras,
                        const std::vector<Image>& images, std::size_t pairs);

// One file, written whole or not at all. Reading gives nothing for a file that is missing, damaged
// or of another version. Throws OutputError.
void write_checkpoint(const std::string& path, const MapperState& state);
[[nodiscard]] std::optional<MapperState> read_checkpoint(const std::string& path);

}  // namespace tarsier::sfm
