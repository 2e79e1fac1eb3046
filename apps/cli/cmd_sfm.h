// SPDX-License-Identifier: MIT
#pragma once

#include "cli.h"

namespace tarsier::cli {

void add_sfm_reconstruct(CLI::App& sfm, Context& context);
void add_sfm_synth(CLI::App& sfm, Context& context);

}  // namespace tarsier::cli
