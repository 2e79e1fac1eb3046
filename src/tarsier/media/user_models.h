// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace tarsier {

// Where models that a user installed lie (scripts/get-model.sh): $XDG_DATA_HOME/tarsier/models,
// without that variable ~/.local/share/tarsier/models. It need not be there; empty where neither
// variable is an absolute path. What the folder of models that comes with the program lacks is
// looked for there (ModelStore); other folders stand for themselves.
[[nodiscard]] std::string user_models_folder();

}  // namespace tarsier
