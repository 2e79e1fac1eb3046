// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/mapper/features.h"
#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/matching.h"
#include "tarsier/sfm/mapper/two_view.h"

#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// From images to models: reading, features, pairs, matching, verification, mapping.
namespace tarsier::sfm {

struct ImageFeatures;  // image_features.h
struct MatchedImages;
struct StartSummary;  // start_model.h

enum class PairChoice {
  kAuto,        // exhaustive up to 60 images, retrieval beyond
  kExhaustive,  // all with all
  kSequential,  // each with those that follow it
  kRetrieval,   // each with those that look like it
  kList,        // what a file says
};

struct PipelineOptions {
  FeatureOptions features;
  MatchOptions matching;
  TwoViewOptions two_view;
  MapperOptions mapper;
  PairChoice pairs = PairChoice::kAuto;
  std::string pairs_file;  // of kList: two names a line
  // COLMAP's database (colmap_database.h) that features, matches and, where `camera` is not given,
  // lenses are taken from; images are those of `inputs`, whose names it has. Empty: none.
  std::string database;
  // A model folder (colmap.h) to go on from: its poses are where mapping begins, by name (start_model.h), and its cameras are
  // used as they are unless the mapper is set to refine lenses. Empty: none. Not with MapperChoice::kGlobal.
  std::string start_model;
  bool fixed_poses = false;  // those of start_model stay as they are
  bool only_start = false;   // images that start_model does not have are left out
  int overlap = 10;          // of kSequential
  int nearest = 12;          // of kRetrieval
  bool flow = false;         // follow points through a sequence instead of matching descriptors
  // What the lens is. Given: used as it is unless the mapper is set to refine it. Not given: from
  // EXIF, else from pairs of images (focal_estimation.h), else 1.2 times the larger side; and refined.
  std::optional<geometry::Camera> camera;
  bool ignore_exif = false;
  bool shared_camera = true;  // images of one size and lens have one camera; false: each its own
  bool fixed_camera = false;  // do not refine a guess either
  std::string cache_folder;   // "": nothing is kept
  // GB that the process may take up: descriptors and matches lie in a file in the cache's folder and leave memory where it
  // takes up more. 0: always when they are not being used.
  double memory_gb = 0;
  double checkpoint_s = 30;  // from one checkpoint of the mapper to the next; 0: each step
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"overlap", overlap, range(1, 1000), "--overlap",
             "images that each is matched with, of --pairs sequential"},
            {"nearest", nearest, range(1, 1000), "--nearest",
             "images that each is matched with, of --pairs retrieval"},
            {"ignore_exif", ignore_exif, "--ignore-exif",
             "guess the focal length even where EXIF tells it"},
            {"checkpoint_s", checkpoint_s, range(0, 1e6), "--checkpoint",
             "seconds between checkpoints of the mapping; 0: at each step"}};
  }
  void check() const;
};

// One image that should take part.
struct Input {
  std::string name;  // in the model
  std::string path;  // of the file; "": there is none, the database knows all
  // Where it was taken, where that is known: any unit and frame, the same for all. It guides
  // kRetrieval.
  std::optional<Eigen::Vector3d> place = std::nullopt;
};

struct StageTime {
  std::string name;
  double seconds = 0;
  double cpu_seconds = 0;  // of all threads of the process
};

struct ImageReport {
  std::string name;
  std::string path;  // of the file
  bool read = false;
  std::string
      focal_from;  // "given", "EXIF", "guess", "start model"; "pairs": from other images of the lens
  int features = 0;
  Outcome outcome;  // the reason also where the file could not be read
};

struct PipelineResult {
  Reconstruction reconstruction;
  std::vector<ImageReport> images;  // as the inputs
  std::vector<Pair> pairs;          // of indices into the models' images
  int compared = 0;                 // pairs
  int verified = 0;
  int from_cache = 0;  // features and pairs that were there from an earlier run
  int resumed = 0;     // images that were in models when the mapper went on from a checkpoint
  std::shared_ptr<const StartSummary> start;  // what was made of start_model; null: there was none
  std::vector<StageTime> stages;
  bool names_files = true;  // report_json() says where each image lies
};

// Two images that were compared: all their matches, and what verification made of them.
struct ComparedPair {
  const Input& first;
  const Input& second;
  const std::vector<cv::Point2f>& first_points;  // px, of all features
  const std::vector<cv::Point2f>& second_points;
  const std::vector<Match>& matches;
  const TwoView& view;
};

struct PipelineHooks {
  WatchModel watch;                        // sees the growing model; may be empty
  std::function<void(const Model&)> show;  // from time to time (MapperHooks::show); may be empty
  // Sees each pair; from any thread, but never two at a time. May be empty; if not, matches are
  // worked out again even where they are in the cache.
  std::function<void(const ComparedPair&)> on_pair;
  // Sees all features and verified pairs before the mapping; may be empty.
  std::function<void(const std::vector<ImageFeatures>&, const std::vector<Input>&,
                     const std::vector<Pair>&)>
      on_matched;
  // Fills in what was found before, in other runs: then nothing is looked for in the images, and only the mapper
  // runs. What it throws goes through. May be empty.
  std::function<void(MatchedImages&)> matched;
  // Makes the models instead of the mapper, as of parts that were mapped before (joined_mapper.h). What it throws goes
  // through. May be empty.
  std::function<Reconstruction(const MapperInput&, const MapperOptions&)> map;
  // When stopped while mapping, the models so far are the result (Reconstruction::interrupted).
  bool partial = false;
};

// The images that can be read become Model::images, in the order of `inputs`. The same result
// for any number of threads, from the cache or not, interrupted and continued or not. Throws
// Interrupted, InputError (pairs_file, start_model), OutputError (cache; a checkpoint that cannot be written is
// a warning); an image that cannot be read is no error.
[[nodiscard]] PipelineResult run_pipeline(const std::vector<Input>& inputs,
                                          const PipelineOptions& options, Progress& progress,
                                          const std::stop_token& stop,
                                          const PipelineHooks& hooks = {});

}  // namespace tarsier::sfm
