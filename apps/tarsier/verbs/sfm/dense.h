// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/dense_reconstructor.h"

#include "framework/cli.h"
#include <optional>
#include <string>

namespace tarsier::cli {

// What `sfm dense` and `sfm reconstruct --dense` take.
struct DenseFlags {
  std::string quality = "normal";
  std::string memory = "2GB";
  std::optional<int> views;
  sfm::DenseOptions options;  // what has a flag of its own
};

// What they say. Throws UsageError.
[[nodiscard]] sfm::DenseOptions options_of(const DenseFlags& flags, const Context& context);

// Does it, prints the result and says where the cloud is.
[[nodiscard]] ExitStatus run_dense(const sfm::DenseReconstructor& reconstructor,
                                   const sfm::DenseJob& job, Context& context);

}  // namespace tarsier::cli
