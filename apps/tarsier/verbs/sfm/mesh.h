// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_reconstructor.h"

#include "framework/cli.h"
#include <optional>
#include <string>

namespace tarsier::cli {

// The flags of `sfm mesh` and `sfm reconstruct --mesh`.
struct MeshFlags {
  std::string output;
  std::string memory = "2GB";
  std::optional<int> texture;
  std::string view;
  std::string turntable;
  std::string page;
  sfm::SurfaceOptions options;  // the options that have a flag of their own
};

// The options from the flags. Throws UsageError; OutputError where a file cannot be written.
[[nodiscard]] sfm::SurfaceOptions options_of(const MeshFlags& flags);

struct MeshJob {
  const sfm::Workspace& workspace;
  const sfm::Model& model;  // in the units of the surface, for its views
};
// Makes the surface of a dense workspace, writes its files and prints the result.
[[nodiscard]] ExitStatus run_mesh(const MeshFlags& flags, const sfm::SurfaceOptions& options,
                                  const MeshJob& job, Context& context);

}  // namespace tarsier::cli
