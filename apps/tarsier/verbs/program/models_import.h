// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <array>

namespace tarsier::cli {

// Networks of other programs that `models import` makes model files of.
struct Importable {
  const char* name;   // for scripts/get-model.sh
  const char* file;   // in the user's models folder
  const char* what;   // it is
  const char* terms;  // its size and terms
};
inline constexpr std::array<Importable, 2> kImportable{{
    {"face-embedding", "face-embedding.json",
     "the network of deep face templates (people --template deep)", "6 MB, MIT"},
    {"face-detector", "face-anchors.json",
     "a face detector that works beside the one that ships: faces with sunglasses, caps, beards",
     "190 kB, MIT"},
}};

// `models import`.
void add_models_import(Command& models, Context& context);

}  // namespace tarsier::cli
