// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/mapper/model_join.h"
#include "tarsier/sfm/mapper/packed_file.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

// State of the mapper, from which another process resumes with a bit-identical result. Features,
// pairs and options are not included. They are computed or read from the cache before mapping, and
// the checkpoint is stored under a key of all of them.
namespace tarsier::sfm {

// A model without the features of its images.
struct PackedModel {
  std::vector<geometry::Camera> cameras;
  std::vector<int> registered;  // images, ascending
  std::vector<geometry::Rigid3> poses;
  std::vector<int> point_indices;  // for each point with observations: its index in Model::points
  std::int64_t points = 0;         // Model::points.size()
  std::vector<Eigen::Vector3d> positions;
  std::vector<cv::Vec3b> colors;
  std::vector<double> errors;
  std::vector<int> track_lengths;         // number of observations of each point
  std::vector<Observation> observations;  // of all points, concatenated
};
[[nodiscard]] PackedModel packed(const Model& model);
// Unpacks into a model that has the images, unregistered, and as many points, all empty.
void unpack(const PackedModel& packed, Model& model);
// The model with these images; those that are not registered have no features. The
// model must fit the images (fits()).
[[nodiscard]] Model unpacked(const PackedModel& packed, const std::vector<Image>& images);
// Records in a packed file; the reader throws Damaged. fits() checks that all indices are valid for
// this number of cameras and these images' features.
void put(PackedWriter& writer, const PackedModel& model);
[[nodiscard]] PackedModel get_packed_model(PackedReader& reader);
[[nodiscard]] bool fits(const PackedModel& model, std::size_t cameras,
                        const std::vector<Image>& images);

// One growing model.
struct IncrementalMapperState {
  PackedModel model;
  std::vector<geometry::Camera> ray_cameras;     // the cameras that its rays were computed with
  std::vector<std::vector<Observation>> tracks;  // only where they differ from those of the pairs
};

// State of the global start (global_start.h), between two of its steps.
struct GlobalStartState {
  enum Step {
    kRotations,
    kPositions,
    kAdjustment,
    kRefused  // only `image` is set
  };
  int image = -1;  // an image of the component that is mapped
  int step = kRotations;
  int round = 0;           // of the step
  std::vector<int> edges;  // remaining pairs of the component, ascending
  std::vector<int> nodes;  // images that they connect, ascending; from kPositions on
  std::vector<Eigen::Matrix3d> rotations;  // camera_from_world of each node; from kPositions on
  PackedModel model;                       // from kAdjustment on; without points
  std::vector<Eigen::Vector3d> points;     // for each track; from kAdjustment on
  std::vector<PairRejection> rejections;   // for each pair of the component
  std::vector<std::string> log;            // of these steps
};
// Whether all indices are valid for this number of pairs of a component, cameras and images. Points
// are checked against the tracks elsewhere.
[[nodiscard]] bool fits(const GlobalStartState& state, std::size_t pairs, std::size_t cameras,
                        const std::vector<Image>& images);

struct MapperState {
  std::vector<PackedModel> models;  // finished models
  // the last model does not close its loops: its images are mapped again, globally
  bool has_open_loop_model = false;
  std::vector<std::string> log;
  std::vector<std::string> reasons;       // per image: why it is not registered, up to now
  std::vector<PairRejection> rejections;  // for each pair
  bool done = false;                      // mapping is finished
  std::string no_model;                   // Reconstruction::no_model, where known
  int conflict_rounds = 0;                // models that were rejected because of conflicts
  bool loop_stays_open = false;           // global mapping did not improve a model with open loops
  bool global_failed = false;             // global mapping was refused
  std::optional<IncrementalMapperState> current;  // the growing model
  bool is_global = false;                         // it began globally
  std::vector<std::pair<int, int>> failed;        // image, and the points it saw when it failed
  int adjusted_at = 0;                    // number of images at the last adjustment of the whole
  int stage = 0;                          // 0: images are added; then the final steps
  int round = 0;                          // of the stage
  std::optional<GlobalStartState> start;  // during a global start
  // Where images are mapped again from their strongest pairs (reconstruction/strong_pairs.h) after
  // the above: the rejection of each pair by its patches, and each attempt up to now. An attempt
  // has no attempts of its own.
  std::vector<PatchRejection> patch_rejections;
  std::vector<MapperState> attempts;
  // Of joined models (joining/joined_mapper.h): their joins, and how many of `models` have grown to
  // their end. `current` is the growing form of the next one.
  std::vector<ModelJoin> joins;
  int grown = 0;
  // Number of images in all models.
  [[nodiscard]] int registered() const;
};

// Whether all indices are valid for this number of images, features, cameras and pairs; except
// those of `start`.
[[nodiscard]] bool fits(const MapperState& state, const std::vector<geometry::Camera>& cameras,
                        const std::vector<Image>& images, std::size_t pairs);

// A checkpoint file, written completely or not at all. Reading returns nothing for a file that is
// missing, damaged or of another version. Throws OutputError.
void write_checkpoint(const std::string& path, const MapperState& state);
[[nodiscard]] std::optional<MapperState> read_checkpoint(const std::string& path);

}  // namespace tarsier::sfm
