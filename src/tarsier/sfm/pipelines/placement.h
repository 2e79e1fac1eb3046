// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/pipeline.h"
#include "tarsier/sfm/pipelines/marker_scale.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>

#include <cstdint>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Scale and place of a model, which the images alone do not tell.
namespace tarsier::sfm {

// Where images were taken, by name; any unit, or metres (GPS).
using Positions = std::map<std::string, Eigen::Vector3d>;

enum class Alignment {
  kNone,
  kPositions,  // to the positions of a file
  kGps,        // to those in EXIF: metres, x east, y north, z up, around their mean
};

// The distance of the cameras of two images, in any unit: the model's from then on.
struct KnownDistance {
  std::string first;  // names of the images
  std::string second;
  double distance = 0;  // above 0
};

struct PlacementOptions {
  Alignment alignment = Alignment::kNone;
  std::string positions_file;  // of kPositions, see read_positions_csv()
  // What tells the unit, if anything does; not both.
  std::optional<KnownDistance> distance;
  std::optional<KnownMarkers> markers;
  [[nodiscard]] bool any() const { return alignment != Alignment::kNone || distance || markers; }
  void check() const;  // throws std::invalid_argument that names the value
};

// What was done to a model.
struct Placement {
  struct Aligned {
    int images = 0;            // whose positions were known
    double scale = 1;          // units of the positions for one of the model
    double mean_residual = 0;  // distance of camera and position, units of the positions
  };
  std::optional<Aligned> aligned;
  std::optional<double> scale;  // by the known distance or the markers
  std::optional<MarkerScale> markers;
};
// {"aligned": {"images", "scale", "mean_residual"}, "scale", "markers": to_json(MarkerScale)},
// what there is of it.
[[nodiscard]] nlohmann::ordered_json to_json(const Placement& placement);

// The positions of EXIF, of those images that have one. Throws Interrupted; an image that cannot be
// read has none.
[[nodiscard]] Positions gps_positions(const std::vector<Input>& inputs,
                                      const std::stop_token& stop);

// The inputs with their places, where pairs are chosen by retrieval (pipeline.h): those of `known`, or
// where it is empty those in EXIF. Inputs of other choices, and those of which one has a place, come back
// as they are. Throws Interrupted.
[[nodiscard]] std::vector<Input> with_places(std::vector<Input> inputs, const Positions& known,
                                             const PipelineOptions& options,
                                             const std::stop_token& stop);

// Those of `known` (kGps: of EXIF) that belong to the images that take part. Throws what would
// otherwise show when all the work is done: InputError for positions that could place no model,
// UsageError where the images of the known distance are not among the inputs.
[[nodiscard]] Positions positions_of(const PlacementOptions& options, const Positions& known,
                                     const std::vector<Input>& inputs, const std::stop_token& stop);

// Brings the model to the positions (robust_similarity()), then to the known distance, or to what
// marker_scale() found, which is needed where options.markers are. Throws Error where the images that
// joined do not tell scale or place; the model is then as it was.
[[nodiscard]] Placement place(Model& model, const PlacementOptions& options, const Positions& known,
                              std::uint64_t seed,
                              const std::optional<MarkerScale>& markers = std::nullopt);

}  // namespace tarsier::sfm
