// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_reconstructor.h"

#include "framework/cli.h"
#include <optional>
#include <string>

namespace tarsier::cli {

// What `sfm mesh` and `sfm reconstruct --mesh` take.
struct MeshFlags {
  std::string output;
  std::string memory = "2GB";
  std::optional<int> texture;
  std::string view;
  std::string turntable;
  std::string page;
  sfm::SurfaceOptions options;  // what has a flag of its own
};

// What they say. Throws UsageError; OutputError where a file cannot be written.
[[nodiscard]] sfm::SurfaceOptions options_of(const MeshFlags& flags);

struct MeshJob {
  const sfm::Workspace& workspace;
  const sfm::Model& model;  // in the units of the surface, for its views
};
// Makes the surface of a dense workspace and its files, and prints the result.
[[nodiscard]] ExitStatus run_mesh(const MeshFlags& flags, const sfm::SurfaceOptions& options,
                                  const MeshJob& job, Context& context);

}  // namespace tarsier::cli
