// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/placement.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/exif.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

// The source of positions, for error messages.
std::string source_of(const PlacementOptions& options) {
  return options.alignment == Alignment::kGps ? "GPS positions" : options.positions_file;
}

constexpr std::int64_t kExifBytes = 1 << 20;  // EXIF segments come before the image data
constexpr const char* kDistanceError = "the known distance: ";

// The two images of the known distance. Throws where they do not determine a scale.
std::vector<const Image*> ends_of(const Model& model, const KnownDistance& known) {
  std::vector<const Image*> ends;
  for (const std::string& name : {known.first, known.second}) {
    const auto image = std::find_if(model.images.begin(), model.images.end(),
                                    [&](const Image& each) { return each.name == name; });
    if (image == model.images.end() || !image->registered) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}'{}' is not in the model; the model is written without scaling",
                              kDistanceError, printable(name)));
    }
    ends.push_back(&*image);
  }
  if (!((ends[0]->pose.center() - ends[1]->pose.center()).norm() > 0)) {
    throw Error(ErrorKind::kInput, fmt::format("{}both cameras have the same position in the "
                                               "model; the model is written without scaling",
                                               kDistanceError));
  }
  return ends;
}

// The centers of the registered images whose positions are known, and these positions.
struct KnownCenters {
  std::vector<Eigen::Vector3d> centers;
  std::vector<Eigen::Vector3d> positions;
};

KnownCenters known_centers_of(const Model& model, const Positions& known) {
  KnownCenters result;
  for (const Image& image : model.images) {
    const auto position = known.find(image.name);
    if (!image.registered || position == known.end()) continue;
    result.centers.push_back(image.pose.center());
    result.positions.push_back(position->second);
  }
  return result;
}

double mean_residual_of(const geometry::Sim3& similarity, const std::vector<Eigen::Vector3d>& from,
                        const std::vector<Eigen::Vector3d>& to) {
  double sum = 0;
  for (std::size_t i = 0; i < from.size(); ++i) sum += (similarity * from[i] - to[i]).norm();
  return sum / static_cast<double>(from.size());
}

Placement::Aligned align(Model& model, const PlacementOptions& options, const Positions& known,
                         std::uint64_t seed) {
  const auto [from, to] = known_centers_of(model, known);
  const auto similarity = robust_similarity(from, to, 0, seed);
  if (!similarity) {
    throw InputError(source_of(options),
                     fmt::format("{} positions belong to images of the model; three that are not "
                                 "collinear are needed; the model is written without alignment",
                                 from.size()));
  }
  transform(model, *similarity);
  return {static_cast<int>(from.size()), similarity->scale,
          mean_residual_of(*similarity, from, to)};
}

// Scales an aligned model about the mean of its cameras: the origin may be far away.
void scale_in_place(Model& model, const Positions& known, double scale,
                    Placement::Aligned& aligned) {
  const auto [centers, positions] = known_centers_of(model, known);
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& center : centers) mean += center;
  mean /= static_cast<double>(centers.size());
  geometry::Sim3 similarity;
  similarity.scale = scale;
  similarity.translation = (1 - scale) * mean;
  transform(model, similarity);
  aligned.mean_residual = mean_residual_of(similarity, centers, positions);
}

}  // namespace

void PlacementOptions::check() const {
  TARSIER_REQUIRE(alignment != Alignment::kPositions || !positions_file.empty(),
                  "no file with positions");
  TARSIER_REQUIRE(!distance || !markers, "a known distance and markers: give only one of them");
  if (markers) markers->check();
  if (!distance) return;
  TARSIER_REQUIRE(distance->distance > 0 && std::isfinite(distance->distance),
                  "a distance of {}: expected above 0", distance->distance);
  TARSIER_REQUIRE(distance->first != distance->second,
                  "a distance needs the names of two images, got '{}' twice", distance->first);
}

nlohmann::ordered_json to_json(const Placement& placement) {
  nlohmann::ordered_json json = nlohmann::ordered_json::object();
  if (placement.aligned) {
    json["aligned"] = {{"images", placement.aligned->images},
                       {"scale", placement.aligned->scale},
                       {"mean_residual", placement.aligned->mean_residual}};
  }
  if (placement.scale) json["scale"] = *placement.scale;
  if (placement.markers) json["markers"] = to_json(*placement.markers);
  return json;
}

std::vector<Input> with_camera_positions(std::vector<Input> inputs, const Positions& known,
                                         const PipelineOptions& options,
                                         const std::stop_token& stop) {
  const auto has_position = [](const Input& input) { return input.position.has_value(); };
  if (!options.database.empty() || options.flow ||
      std::any_of(inputs.begin(), inputs.end(), has_position) ||
      pair_choice(options, static_cast<int>(inputs.size())) != PairChoice::kRetrieval)
    return inputs;
  const Positions positions = known.empty() ? gps_positions(inputs, stop) : known;
  std::size_t count = 0;
  for (Input& input : inputs) {
    const auto found = positions.find(input.name);
    if (found == positions.end()) continue;
    input.position = found->second;
    ++count;
  }
  if (count > 0)
    log_info("pair selection uses the positions of {} of {} images", count, inputs.size());
  return inputs;
}

Positions gps_positions(const std::vector<Input>& inputs, const std::stop_token& stop,
                        const std::string& database) {
  std::map<std::string, ColmapPosePrior> priors;
  if (!database.empty())
    for (ColmapPosePrior& prior : read_colmap_pose_priors(database))
      priors.emplace(prior.name, std::move(prior));
  Positions cartesian;
  std::vector<std::string> names;
  std::vector<Eigen::Vector3d> positions;
  for (const Input& input : inputs) {
    throw_if_stopped(stop);
    const auto prior = priors.find(input.name);
    try {
      auto gps =
          input.path.empty() ? std::nullopt : parse_exif(read_start(input.path, kExifBytes)).gps;
      if (!gps && prior != priors.end()) {
        if (prior->second.is_wgs84)
          gps = prior->second.position;
        else
          cartesian[input.name] = prior->second.position;
      }
      if (!gps) continue;
      names.push_back(input.name);
      positions.push_back(*gps);
    } catch (const InputError&) {
      continue;  // it will be left out of the model with a warning
    }
  }
  if (names.empty()) return cartesian;
  if (!cartesian.empty())
    log_warning("{}: {} cartesian pose priors are left out: other images have GPS positions",
                database, cartesian.size());
  const std::vector<Eigen::Vector3d> metres = local_metres(positions);
  Positions known;
  for (std::size_t i = 0; i < names.size(); ++i) known[names[i]] = metres[i];
  return known;
}

Positions positions_of(const PlacementOptions& options, const Positions& known,
                       const std::vector<Input>& inputs, const std::stop_token& stop,
                       const std::string& database) {
  if (options.distance) {
    for (const std::string& name : {options.distance->first, options.distance->second}) {
      if (std::none_of(inputs.begin(), inputs.end(),
                       [&](const Input& input) { return input.name == name; })) {
        throw UsageError(fmt::format("{}no image is named '{}' (the first image is '{}')",
                                     kDistanceError, printable(name),
                                     inputs.empty() ? "" : printable(inputs.front().name)));
      }
    }
  }
  if (options.alignment == Alignment::kNone) return {};
  const bool gps = options.alignment == Alignment::kGps;
  const Positions all = gps ? gps_positions(inputs, stop, database) : known;
  Positions result;
  std::vector<Eigen::Vector3d> positions;
  for (const Input& input : inputs) {
    const auto position = all.find(input.name);
    if (position == all.end()) continue;
    result.insert(*position);
    positions.push_back(position->second);
  }
  if (positions.size() < 3) {
    const std::string what =
        gps ? fmt::format("{} of {} images have a position in EXIF{}", positions.size(),
                          inputs.size(), database.empty() ? "" : " or in the database")
            : fmt::format("{} of {} names belong to images (the first image is '{}')",
                          positions.size(), all.size(),
                          inputs.empty() ? "" : printable(inputs.front().name));
    throw InputError(source_of(options), what + "; three that are not collinear are needed");
  }
  if (!geometry::similarity_between(geometry::columns_of(positions),
                                    geometry::columns_of(positions))) {
    throw InputError(
        source_of(options),
        fmt::format(
            "the {} positions of images are collinear; three that are not collinear are needed",
            positions.size()));
  }
  if (positions.size() < all.size()) {
    log_warning("{}: {} of {} names belong to no image", source_of(options),
                all.size() - positions.size(), all.size());
  }
  return result;
}

Placement place(Model& model, const PlacementOptions& options, const Positions& known,
                std::uint64_t seed, const std::optional<MarkerScale>& markers) {
  options.check();
  TARSIER_REQUIRE(markers.has_value() == options.markers.has_value(), "markers: {} measured",
                  markers ? "were" : "were not");
  Placement placement;
  placement.markers = markers;
  std::vector<const Image*> ends;
  if (options.distance) ends = ends_of(model, *options.distance);
  if (options.alignment != Alignment::kNone) placement.aligned = align(model, options, known, seed);
  if (options.distance) {
    placement.scale =
        options.distance->distance / (ends[0]->pose.center() - ends[1]->pose.center()).norm();
  } else if (markers) {
    // The markers were measured before the model was aligned.
    placement.scale = markers->scale / (placement.aligned ? placement.aligned->scale : 1);
  }
  if (placement.scale && placement.aligned) {
    scale_in_place(model, known, *placement.scale, *placement.aligned);
  } else if (placement.scale) {
    geometry::Sim3 similarity;
    similarity.scale = *placement.scale;
    transform(model, similarity);
  }
  return placement;
}

}  // namespace tarsier::sfm
