// SPDX-License-Identifier: MIT
#pragma once

#include "command_tree.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// The command line as one JSON object, for programs that generate a wrapper or a form from it
// (docs/python.md):
//
//   {"program": "tarsier", "version": "1.0", "verbs": [{"verb": "plate read", "path": ["plate",
//    "read"], "area": "plate", "help", "usage", "example", "inputs": [..], "flags": [..]}, ..]}
//
// `inputs` are positional, `flags` have names. Each entry of both has
//   names        "--output", "-o": long names first; for an input its name
//   positional   for a flag that may also be given by position: its name there, else null
//   type         "switch", "integer", "number" or "text"
//   choices      all allowed values, if they are few, else empty
//   suggestions  words that a text may be, among other values; else empty
//   range        null, or {"min", "max", "min_excluded", "max_excluded", "odd"}: each limit or
//                null, whether the limit itself is excluded, whether only odd numbers are allowed
//   unit         for a number: the unit at the start of its help, such as "px", or null
//   default      by `type`, or a list of that type; null: none, or described in `help`
//   headless_value  if the verb opens a window without this flag: the value with which it opens
//                none; else null
//   values       minimum number of values; repeatable: any number of values
//   required, help, group, needs, excludes
[[nodiscard]] std::string command_json(const std::vector<AreaInfo>& areas,
                                       std::string_view version);

}  // namespace tarsier::cli
