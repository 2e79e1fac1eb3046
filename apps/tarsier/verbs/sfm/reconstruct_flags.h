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
// The flags of `sfm plan`, which determine the model; and the flags of `sfm map` and `sfm merge`,
// which determine the outputs.
void add_plan_flags(Command& verb, ReconstructFlags& flags);
void add_map_flags(Command& verb, ReconstructFlags& flags, bool needs_output);

// The options from the flags. Throws UsageError, InputError (lens).
[[nodiscard]] sfm::ReconstructorOptions options_of(const ReconstructFlags& flags,
                                                   const Context& context);
// As options_of(), but of the pipeline only the checkpoints. Throws UsageError.
[[nodiscard]] sfm::ReconstructorOptions map_options_of(const ReconstructFlags& flags);

// Shared by `sfm reconstruct`, `sfm map` and `sfm merge`: print_models() prints the result,
// status_of() returns the exit status. The latter throws Error where a requested scale or place is
// missing.
void print_models(const sfm::ReconstructorResult& result, const std::string& folder,
                  const Context& context);
[[nodiscard]] ExitStatus status_of(const sfm::ReconstructorResult& result);

// Throws InputError for an input that is neither images nor a video.
void expect_files(const std::vector<std::string>& inputs);

}  // namespace tarsier::cli
