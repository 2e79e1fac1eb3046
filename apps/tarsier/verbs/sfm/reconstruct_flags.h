// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/reconstructor.h"

#include "framework/cli.h"
#include "verbs/sfm/online.h"
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
  std::string align;
  double distance = 0;
  std::vector<std::string> distance_between;
  std::vector<std::string> exports;
  bool no_cache = false;
  bool growing = false;
  bool per_image_camera = false;
  OnlineFlags online;
  sfm::ReconstructorOptions options;
};

void add_reconstruct_flags(Command& verb, ReconstructFlags& flags);

// What they say. Throws UsageError, InputError (lens).
[[nodiscard]] sfm::ReconstructorOptions options_of(const ReconstructFlags& flags,
                                                   const Context& context);

}  // namespace tarsier::cli
