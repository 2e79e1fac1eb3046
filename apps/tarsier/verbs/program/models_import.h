// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <array>

namespace tarsier::cli {

// Networks of other programs that `models import` converts to model files.
struct Importable {
  const char* name;   // name for scripts/get-model.sh
  const char* file;   // file name in the user's models folder
  const char* what;   // description
  const char* terms;  // its size and terms
};
inline constexpr std::array<Importable, 2> kImportable{{
    {"face-embedding", "face-embedding.json",
     "the network of deep face templates (people --template deep)", "6 MB, MIT"},
    {"face-detector", "face-anchors.json",
     "a face detector that works beside the one that ships: faces with sunglasses, caps, beards",
     "190 kB, MIT"},
}};

// Adds `models import`.
void add_models_import(Command& models, Context& context);

}  // namespace tarsier::cli
