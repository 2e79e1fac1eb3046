// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace tarsier {

// The folder of models that a user installed (scripts/get-model.sh): $XDG_DATA_HOME/tarsier/models,
// or ~/.local/share/tarsier/models without that variable. It need not exist. Empty if neither
// variable is an absolute path. ModelStore searches it for files that are missing in the folder
// that comes with the program, but not with other folders.
[[nodiscard]] std::string user_models_folder();

}  // namespace tarsier
