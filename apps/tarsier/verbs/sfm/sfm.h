// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"

namespace tarsier::cli {

void add_sfm_dense(Command& sfm, Context& context);
void add_sfm_mesh(Command& sfm, Context& context);
void add_sfm_reconstruct(Command& sfm, Context& context);
void add_sfm_shards(Command& sfm, Context& context);
void add_sfm_synth(Command& sfm, Context& context);

// Whether the studio started this program (TARSIER_STUDIO). Its users name files only by reference,
// so results contain no file paths, and paths in results are not trusted.
[[nodiscard]] bool is_in_studio();

}  // namespace tarsier::cli
