// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/dense_reconstructor.h"

#include "framework/cli.h"
#include <optional>
#include <string>

namespace tarsier::cli {

// The flags of `sfm dense` and `sfm reconstruct --dense`.
struct DenseFlags {
  std::string quality = "normal";
  std::string memory = "2GB";
  std::optional<int> views;
  sfm::DenseOptions options;  // the options that have a flag of their own
};

// The options from the flags. Throws UsageError.
[[nodiscard]] sfm::DenseOptions options_of(const DenseFlags& flags, const Context& context);

// Runs the reconstruction, prints the result and the path of the cloud.
[[nodiscard]] ExitStatus run_dense(const sfm::DenseReconstructor& reconstructor,
                                   const sfm::DenseJob& job, Context& context);

}  // namespace tarsier::cli
