// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/sfm/pipelines/pipeline.h"
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
  KeyframeOptions keyframes;   // for videos
  PlacementOptions placement;  // for the largest model
  // Folder for all files. Empty: no files are written. Videos need a folder.
  std::string folder;
  // Keeps intermediate results in folder/cache, so that a later run can resume from them.
  // pipeline.cache_folder replaces this folder where it is set.
  bool cache = true;
  // Further files; all of them need a folder.
  bool names_files = true;   // report.json holds the path of each image
  bool undistorted = false;  // undistorted/: images and model for dense reconstruction
  bool binary = false;  // cameras.bin, images.bin, points3D.bin: the model as COLMAP's binary files
  bool database = false;   // database.db: features and matches in COLMAP's format
  bool turntable = false;  // turntable.gif: the rotating point cloud
  // matches/NAME-NAME-I-J.jpg: an image for each pair, inliers green, outliers red. I and J are the
  // indices of the inputs. An image that cannot be written gives a warning.
  bool match_images = false;
  void check() const;  // throws std::invalid_argument, which names the value
};

// Sets the matching thresholds for this kind of descriptor. ORB and AKAZE descriptors are less
// distinctive than SIFT.
void use_features(PipelineOptions& options, FeatureKind kind);

struct ReconstructorResult {
  PipelineResult pipeline;      // models, largest first, and the outcome of each image
  Placement placement;          // placement of the largest model
  std::string placement_error;  // why the requested scale or place is missing; or ""
  // The run was interrupted and wrote nothing, because the folder holds a finished model of an
  // earlier run with at least as many images.
  bool kept_earlier_model = false;

  [[nodiscard]] const std::vector<Model>& models() const { return pipeline.reconstruction.models; }
  [[nodiscard]] bool interrupted() const { return pipeline.reconstruction.interrupted; }
};

// report.json: report_json(), "placed": to_json(Placement), "not_placed".
[[nodiscard]] nlohmann::ordered_json to_json(const ReconstructorResult& result);

struct ReconstructorHooks {
  WatchModel watch;  // receives the growing model; may be empty
  // receives the model from time to time (MapperHooks::show); may be empty
  std::function<void(const Model&)> show;
  // Supplies features and matches that exist already (PipelineHooks::matched); may be empty.
  std::function<void(MatchedImages&)> matched;
  // Replaces the mapper (PipelineHooks::map and map_key); may be empty.
  std::function<Reconstruction(const MapperInput&, const MapperOptions&, const MapperHooks&)> map;
  std::string map_key;
  // Called after the models and their views are written and before the slower further files; may be
  // empty.
  std::function<void(const ReconstructorResult&)> on_models;
};

// Reconstructs images or videos: camera poses, a point cloud and their files.
//
//   sfm::ReconstructorOptions options;
//   options.folder = "model";
//   const sfm::Reconstructor reconstructor(options);
//   NoProgress progress;
//   const sfm::ReconstructorResult result = reconstructor.run({"images/"}, progress, {});
//   for (const sfm::Model& model : result.models())
//     fmt::print("{} points\n", model.points.size());
//
// The folder then holds cameras.txt, images.txt and points3D.txt (COLMAP), points.ply, cameras.ply,
// view.html, view.png and report.json. Further models are in model-1, model-2 ... The models are
// written as soon as they exist, then again with scale and place, then the files made from them. A
// failing step therefore keeps the results of the steps before it. Models of an earlier run are
// removed (remove_old_models()).
//
// The class is const: several threads may share an object, each with a folder of its own. The
// result depends on images, options and seed, not on the number of threads.
class Reconstructor {
 public:
  // Throws std::invalid_argument (options), InputError (placement.positions_file).
  explicit Reconstructor(ReconstructorOptions options);

  [[nodiscard]] const ReconstructorOptions& options() const { return options_; }
  // The options in use, with the folder of the cache.
  [[nodiscard]] const PipelineOptions& pipeline() const { return options_.pipeline; }
  // Folder that key frames are written to; "" where the options name no folder.
  [[nodiscard]] std::string frames_folder() const;

  // Creates the folders. Throws OutputError where one is not writable. run() calls it first.
  void check_outputs() const;

  // `sources`: see find_inputs(). Inputs and options are checked before the work begins. Where
  // `stop` fires during mapping, the models made up to then are the result. An image that cannot be
  // read is no error. Throws InputError (sources, fewer than two images, positions), UsageError
  // (placement.distance names an unknown image), OutputError, Interrupted.
  [[nodiscard]] ReconstructorResult run(const std::vector<std::string>& sources, Progress& progress,
                                        const std::stop_token& stop,
                                        const ReconstructorHooks& hooks = {}) const;
  // As run(), for images that are already found and named.
  [[nodiscard]] ReconstructorResult run_images(const std::vector<Input>& inputs, Progress& progress,
                                               const std::stop_token& stop,
                                               const ReconstructorHooks& hooks = {}) const;

 private:
  void check_inputs(const std::vector<Input>& inputs) const;
  // What placing the largest model needs besides the options.
  struct PlacementContext {
    const std::vector<Input>& inputs;
    Positions known;
    Progress& progress;
    std::stop_token stop;
  };
  void write_models(ReconstructorResult& result, const PlacementContext& context) const;
  void place_largest(ReconstructorResult& result, const PlacementContext& context) const;

  ReconstructorOptions options_;
  Positions positions_;  // from the positions file
};

}  // namespace tarsier::sfm
