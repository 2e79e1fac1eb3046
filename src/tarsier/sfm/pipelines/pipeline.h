// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/matching.h"
#include "tarsier/sfm/mapper/mapper_hooks.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/two_view/two_view.h"

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// The pipeline from images to models: reading, features, pairs, matching, verification, mapping.
namespace tarsier::sfm {

struct ImageFeatures;  // image_features.h
class ImageSet;
struct MatchedImages;
struct StartSummary;  // start_model.h

enum class PairChoice {
  kAuto,        // exhaustive up to 60 images, else retrieval
  kExhaustive,  // each image with each other
  kSequential,  // each image with the next ones
  kRetrieval,   // each image with the most similar ones
  kList,        // the pairs in a file
};

struct PipelineOptions {
  FeatureOptions features;
  MatchOptions matching;
  TwoViewOptions two_view;
  MapperOptions mapper;
  PairChoice pairs = PairChoice::kAuto;
  std::string pairs_file;  // for kList: two names per line
  // A COLMAP database (colmap_database.h) that supplies features, matches and, without `camera`,
  // the lenses. Its images must have the names of `inputs`. Empty: none.
  std::string database;
  // A model folder (colmap.h) to start from; empty: none. Mapping begins with its poses, by image
  // name (start_model.h). Its cameras are used unchanged unless the mapper refines lenses. Not
  // allowed with MapperChoice::kGlobal.
  std::string start_model;
  bool fixed_poses = false;  // the poses of start_model do not change
  bool only_start = false;   // images that are not in start_model are left out
  int overlap = 10;          // for kSequential
  int nearest = 12;          // for kRetrieval
  bool flow = false;         // track points through a sequence instead of matching descriptors
  // The lens. Where given, it is used unchanged unless the mapper refines it. Otherwise the focal
  // length comes from EXIF, else from pairs of images (focal_estimation.h), else it is 1.2 times
  // the longer side; and it is refined.
  std::optional<geometry::Camera> camera;
  bool ignore_exif = false;
  bool shared_camera = true;  // images of one size and lens share a camera; false: one camera each
  bool fixed_camera = false;  // guessed lenses are not refined either
  std::string cache_folder;   // "": no cache
  // Memory limit of the process, GB. Descriptors and matches are in a file in the cache folder.
  // They are released from memory where the process uses more. 0: always while they are not used.
  double memory_gb = 0;
  double checkpoint_s = 30;  // between two checkpoints of the mapper, s; 0: each step
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {
        {"overlap", overlap, range(1, 1000), "--overlap",
         "number of neighbours each image is matched with, for --pairs sequential"},
        {"nearest", nearest, range(1, 1000), "--nearest",
         "number of similar images each image is matched with, for --pairs retrieval"},
        {"ignore_exif", ignore_exif, "--ignore-exif", "guess the focal length even if EXIF has it"},
        {"checkpoint_s", checkpoint_s, range(0, 1e6), "--checkpoint",
         "seconds between checkpoints of the mapping; 0: after each step"}};
  }
  void check() const;
};

// An input image.
struct Input {
  std::string name;  // name in the model
  std::string path;  // of the file; "": no file, the data are in the database
  // Camera position where known, in any unit and frame, but the same for all images. Guides
  // kRetrieval.
  std::optional<Eigen::Vector3d> position = std::nullopt;
};

struct StageTime {
  std::string name;
  double seconds = 0;
  double cpu_seconds = 0;  // sum over all threads of the process
};

struct ImageReport {
  std::string name;
  std::string path;  // of the file
  bool read = false;
  // "given", "EXIF", "guess", "start model"; "pairs": from other images of the lens
  std::string focal_from;
  int features = 0;
  Outcome outcome;  // its reason is set also where the file could not be read
};

struct PipelineResult {
  Reconstruction reconstruction;
  std::vector<ImageReport> images;  // in the order of the inputs
  std::vector<Pair> pairs;          // of indices into the models' images
  int compared = 0;                 // number of compared pairs
  int verified = 0;
  int from_cache = 0;                         // features and pairs found in the cache
  int resumed = 0;                            // images that a resumed checkpoint had in models
  std::shared_ptr<const StartSummary> start;  // the use of start_model; null: there was none
  std::vector<StageTime> stages;
  bool names_files = true;  // report_json() contains the path of each image
};

// Two compared images: all their matches, and the result of verification.
struct ComparedPair {
  const Input& first;
  const Input& second;
  const std::vector<cv::Point2f>& first_points;  // px, all features
  const std::vector<cv::Point2f>& second_points;
  const std::vector<Match>& matches;
  const TwoView& view;
  int first_input = 0;  // indices of the inputs
  int second_input = 0;
};

struct PipelineHooks {
  WatchModel watch;  // receives the growing model; may be empty
  // receives the model from time to time (MapperHooks::show); may be empty
  std::function<void(const Model&)> show;
  // Receives each pair, from any thread but one at a time. May be empty. Otherwise, matches are
  // computed again even where they are in the cache.
  std::function<void(const ComparedPair&)> on_pair;
  // Receives all features, their cameras and verified pairs before the mapping; may be empty.
  std::function<void(const std::vector<ImageFeatures>&, const ImageSet&, const std::vector<Pair>&)>
      on_matched;
  // Supplies features and pairs found by other runs. Then the images are not processed, and only
  // the mapper runs. Its exceptions are passed on. May be empty.
  std::function<void(MatchedImages&)> matched;
  // Makes the models instead of the mapper, e.g. from separately mapped parts (joined_mapper.h).
  // Its exceptions are passed on. May be empty.
  std::function<Reconstruction(const MapperInput&, const MapperOptions&, const MapperHooks&)> map;
  // All that `map` depends on besides its arguments; empty: it has no checkpoints.
  std::string map_key;
  // Where mapping is stopped, return the models up to then (Reconstruction::interrupted).
  bool partial = false;
};

// The readable images become Model::images, in the order of `inputs`. The result does not depend on
// the number of threads, the cache, or interruption and resumption. Throws Interrupted, InputError
// (pairs_file, start_model), OutputError (cache). An image that cannot be read is no error. A
// checkpoint that cannot be written gives a warning.
[[nodiscard]] PipelineResult run_pipeline(const std::vector<Input>& inputs,
                                          const PipelineOptions& options, Progress& progress,
                                          const std::stop_token& stop,
                                          const PipelineHooks& hooks = {});

}  // namespace tarsier::sfm
