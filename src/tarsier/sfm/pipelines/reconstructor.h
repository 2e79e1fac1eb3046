// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/pipeline.h"
#include "tarsier/sfm/pipelines/placement.h"
#include "tarsier/sfm/scene/keyframes.h"

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct ReconstructorOptions {
  PipelineOptions pipeline;
  KeyframeOptions keyframes;   // of videos
  PlacementOptions placement;  // of the largest model
  // That all files are written to; empty: none are. Videos need one.
  std::string folder;
  // Keeps in folder/cache what was found, so that a second run goes on where one ended. Where
  // pipeline.cache_folder is named, it is that one.
  bool cache = true;
  // Further files, which need a folder.
  bool names_files = true;   // report.json says where each image lies
  bool undistorted = false;  // undistorted/: images and model for dense reconstruction
  bool binary = false;  // cameras.bin, images.bin, points3D.bin: the model as COLMAP's binary files
  bool database = false;      // database.db: features and matches as COLMAP has them
  bool turntable = false;     // turntable.gif: the cloud, turning
  bool match_images = false;  // matches/: each pair, matches that were kept green, removed red
  void check() const;         // throws std::invalid_argument that names the value
};

// Thresholds for descriptors of this kind: those of ORB and AKAZE are less distinctive.
void use_features(PipelineOptions& options, FeatureKind kind);

struct ReconstructorResult {
  PipelineResult pipeline;  // models, largest first, and what became of each image
  Placement placement;      // what was done to the largest model
  std::string not_placed;   // why it has neither scale nor place that were asked for; or ""
  // Interrupted, and the folder keeps the finished model of an earlier run, which has as many
  // images: nothing was written.
  bool kept_earlier = false;

  [[nodiscard]] const std::vector<Model>& models() const { return pipeline.reconstruction.models; }
  [[nodiscard]] bool interrupted() const { return pipeline.reconstruction.interrupted; }
};

// report.json: report_json(), "placed": to_json(Placement), "not_placed".
[[nodiscard]] nlohmann::ordered_json to_json(const ReconstructorResult& result);

struct ReconstructorHooks {
  WatchModel watch;                        // sees the growing model; may be empty
  std::function<void(const Model&)> show;  // from time to time (MapperHooks::show); may be empty
  // Gives what was found in the images before (PipelineHooks::matched); may be empty.
  std::function<void(MatchedImages&)> matched;
  // Makes the models instead of the mapper (PipelineHooks::map); may be empty.
  std::function<Reconstruction(const MapperInput&, const MapperOptions&)> map;
  // When the models and their views are written, before further files that take time; may be empty.
  std::function<void(const ReconstructorResult&)> on_models;
};

// Makes models of images or videos: camera poses and a cloud of points, and their files.
//
//   sfm::ReconstructorOptions options;
//   options.folder = "model";
//   const sfm::Reconstructor reconstructor(options);
//   NoProgress progress;
//   const sfm::ReconstructorResult result = reconstructor.run({"images/"}, progress, {});
//   for (const sfm::Model& model : result.models())
//     fmt::print("{} points\n", model.points.size());
//
// In the folder lie then cameras.txt, images.txt and points3D.txt (COLMAP), points.ply, cameras.ply,
// view.html, view.png and report.json; further models are in model-1, model-2 .. The models are
// written as soon as there are any, then scale and place, then what is made of them: what fails
// leaves what was made before it. Models of an earlier run go (remove_old_models()).
//
// Const: any number of threads may use it, each with a folder of its own. Same images, options and
// seed, same result, for any number of threads.
class Reconstructor {
 public:
  // Throws std::invalid_argument (options), InputError (placement.positions_file).
  explicit Reconstructor(const ReconstructorOptions& options);

  [[nodiscard]] const ReconstructorOptions& options() const { return options_; }
  // Those that are used, with the folder of the cache.
  [[nodiscard]] const PipelineOptions& pipeline() const { return options_.pipeline; }
  // That key frames are written to; "" without a folder.
  [[nodiscard]] std::string frames_folder() const;

  // Makes the folders. Throws OutputError where one cannot be written. run() begins with it.
  void check_outputs() const;

  // `sources`: see find_inputs(). What can be known before the work is checked before it. When
  // `stop` fires while images are mapped, the models so far are the result. An image that cannot be
  // read is no error. Throws InputError (sources, fewer than two images, positions), UsageError
  // (placement.distance names no image), OutputError, Interrupted.
  [[nodiscard]] ReconstructorResult run(const std::vector<std::string>& sources, Progress& progress,
                                        const std::stop_token& stop,
                                        const ReconstructorHooks& hooks = {}) const;
  // The same of images that are named already.
  [[nodiscard]] ReconstructorResult run_images(const std::vector<Input>& inputs, Progress& progress,
                                               const std::stop_token& stop,
                                               const ReconstructorHooks& hooks = {}) const;

 private:
  void check_inputs(const std::vector<Input>& inputs) const;
  // What placing the largest model takes beside the options.
  struct Surroundings {
    const std::vector<Input>& inputs;
    Positions known;
    Progress& progress;
    std::stop_token stop;
  };
  void write_models(ReconstructorResult& result, const Surroundings& around) const;
  void place_largest(ReconstructorResult& result, const Surroundings& around) const;

  ReconstructorOptions options_;
  Positions positions_;  // of the file
};

}  // namespace tarsier::sfm
