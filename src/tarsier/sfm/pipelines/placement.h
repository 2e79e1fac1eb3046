// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/marker_scale.h"
#include "tarsier/sfm/pipelines/pipeline.h"
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

// Scale and place of a model. Images alone do not determine them.
namespace tarsier::sfm {

// Camera positions by image name, in any unit; metres for GPS.
using Positions = std::map<std::string, Eigen::Vector3d>;

enum class Alignment {
  kNone,
  kPositions,  // to the positions of a file
  kGps,        // to gps_positions()
};

// The distance between the cameras of two images, in any unit. This becomes the model's unit.
struct KnownDistance {
  std::string first;  // names of the images
  std::string second;
  double distance = 0;  // > 0
};

struct PlacementOptions {
  Alignment alignment = Alignment::kNone;
  std::string positions_file;  // only with kPositions, see read_positions_csv()
  // What determines the unit, if anything; at most one of the two.
  std::optional<KnownDistance> distance;
  std::optional<KnownMarkers> markers;
  [[nodiscard]] bool any() const { return alignment != Alignment::kNone || distance || markers; }
  void check() const;  // throws std::invalid_argument, which names the value
};

// The placement that a model received.
struct Placement {
  struct Aligned {
    int images = 0;            // images with a known position
    double scale = 1;          // units of the positions per unit of the model
    double mean_residual = 0;  // between camera and position, in the placed model
  };
  std::optional<Aligned> aligned;
  std::optional<double> scale;  // from the known distance or the markers
  std::optional<MarkerScale> markers;
};
// {"aligned": {"images", "scale", "mean_residual"}, "scale", "markers": to_json(MarkerScale)}; only
// the parts that exist.
[[nodiscard]] nlohmann::ordered_json to_json(const Placement& placement);

// Positions from EXIF, for the images that have one: metres, x east, y north, z up, origin at their
// mean. Images that cannot be read have none. Images without a position in EXIF have that of the
// COLMAP database, if one is given (read_colmap_pose_priors()). Where all positions are cartesian,
// the result has them as they are in the database. With others, cartesian positions are left out
// with a warning. Throws Interrupted, InputError (database).
[[nodiscard]] Positions gps_positions(const std::vector<Input>& inputs, const std::stop_token& stop,
                                      const std::string& database = "");

// Adds camera positions to the inputs where pairs are chosen by retrieval (pipeline.h). They come
// from `known`, or from EXIF where `known` is empty. With any other choice of pairs, or where an
// input already has a place, the inputs are returned unchanged: of a database, all pairs are used.
// Throws Interrupted.
[[nodiscard]] std::vector<Input> with_camera_positions(std::vector<Input> inputs,
                                                       const Positions& known,
                                                       const PipelineOptions& options,
                                                       const std::stop_token& stop);

// The positions in `known` (kGps: gps_positions()) that belong to the inputs. Throws at once what
// would otherwise fail after all the work: InputError for positions that cannot place a model,
// UsageError where an image of the known distance is not among the inputs.
[[nodiscard]] Positions positions_of(const PlacementOptions& options, const Positions& known,
                                     const std::vector<Input>& inputs, const std::stop_token& stop,
                                     const std::string& database = "");

// Aligns the model with the positions (robust_similarity()), then scales it by the known distance
// or by `markers`. An aligned model is scaled about the mean of its cameras with known positions,
// so it stays where they are. `markers` is the result of marker_scale() and is required with
// options.markers. Throws Error where the registered images do not determine scale or place; the
// model is then unchanged.
[[nodiscard]] Placement place(Model& model, const PlacementOptions& options, const Positions& known,
                              std::uint64_t seed,
                              const std::optional<MarkerScale>& markers = std::nullopt);

}  // namespace tarsier::sfm
