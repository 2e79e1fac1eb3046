// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"

namespace tarsier::cli {

void add_sfm_reconstruct(Command& sfm, Context& context);
void add_sfm_synth(Command& sfm, Context& context);

}  // namespace tarsier::cli
