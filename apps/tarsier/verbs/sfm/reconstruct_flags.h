// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/reconstructor.h"

#include "framework/cli.h"
#include "verbs/sfm/dense.h"
#include "verbs/sfm/online.h"
#include "verbs/sfm/scale_flags.h"
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags of `sfm reconstruct`, as typed.
struct ReconstructFlags {
  std::vector<std::string> inputs;
  std::string camera;
  std::string camera_file;
  std::vector<std::string> refine;
  std::string features = "sift";
  double downscale = 1;
  std::string pairs = "auto";
  std::string matches = "sift";
  std::string mapper = "incremental";
  std::string align;
  ScaleFlags scale;
  std::vector<std::string> exports;
  std::string memory;  // "": as little as possible
  bool no_cache = false;
  bool growing = false;
  bool per_image_camera = false;
  bool dense = false;
  DenseFlags dense_flags;
  bool mesh = false;
  OnlineFlags online;
  sfm::ReconstructorOptions options;
};

void add_reconstruct_flags(Command& verb, ReconstructFlags& flags);
// Those of `sfm plan`: all that the model depends on. Those of `sfm map` and `sfm merge`: what is made of it.
void add_plan_flags(Command& verb, ReconstructFlags& flags);
void add_map_flags(Command& verb, ReconstructFlags& flags, bool needs_output);

// What they say. Throws UsageError, InputError (lens).
[[nodiscard]] sfm::ReconstructorOptions options_of(const ReconstructFlags& flags,
                                                   const Context& context);
// Of these: without its pipeline, but for the checkpoints. Throws UsageError.
[[nodiscard]] sfm::ReconstructorOptions map_options_of(const ReconstructFlags& flags);

// What `sfm reconstruct`, `sfm map` and `sfm merge` share: prints what was made, and says how it ended. The latter throws Error
// where the model has neither scale nor place that were asked for.
void print_models(const sfm::ReconstructorResult& result, const std::string& folder,
                  const Context& context);
[[nodiscard]] ExitStatus status_of(const sfm::ReconstructorResult& result);

// Throws InputError for what is neither images nor videos.
void expect_files(const std::vector<std::string>& inputs);

}  // namespace tarsier::cli
