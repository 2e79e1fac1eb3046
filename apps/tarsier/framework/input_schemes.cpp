// SPDX-License-Identifier: MIT
#include "framework/input_schemes.h"

#include "tarsier/media/viewer_source.h"
#include "tarsier/synth/sources.h"

namespace tarsier::cli {

std::vector<Scheme> input_schemes() { return {synth::synth_scheme(), viewer_scheme()}; }

}  // namespace tarsier::cli
