// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"

namespace tarsier::cli {

// Adds `models install` and `models remove`.
void add_models_install(Command& models, Context& context);

}  // namespace tarsier::cli
