// SPDX-License-Identifier: MIT
#pragma once

#include "command_tree.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// The command line as one JSON object, for programs that make a wrapper or a form of it
// (docs/python.md):
//
//   {"program": "tarsier", "version": "1.0", "verbs": [{"verb": "plate read", "path": ["plate",
//    "read"], "area": "plate", "help", "usage", "example", "inputs": [..], "flags": [..]}, ..]}
//
// `inputs` are given by their place, `flags` by name; each of both has
//   names        "--output", "-o": long names first; of an input its name
//   positional   of a flag that may also be given by its place: its name there, else null
//   type         "switch", "integer", "number" or "text"
//   choices      all that the value may be, if they are few, else empty
//   range        null, or {"min", "max", "min_excluded", "max_excluded", "odd"}: each end a number
//                or null, whether it is itself outside, whether the number must be odd
//   unit         of a number: what its help begins with, as "px", or null
//   default      by `type`, a list of them where several are taken; null: none, or as `help` says
//   values       how many values it takes at least; repeatable: any number of them
//   required, help, group, needs, excludes
[[nodiscard]] std::string command_json(const std::vector<AreaInfo>& areas,
                                       std::string_view version);

}  // namespace tarsier::cli
