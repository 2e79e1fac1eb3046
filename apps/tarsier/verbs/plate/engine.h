// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/reader/reader.h"

#include "framework/cli.h"
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags of all verbs that read plates.
struct PlateFlags {
  std::string pipeline = "default";
  std::string classic_reader = "hog";
  plate::ReaderOptions reader;
};

void add_plate_flags(Command& verb, PlateFlags& flags);

[[nodiscard]] plate::ReaderOptions reader_options(const PlateFlags& flags, const Context& context);

// Uses the shipped models. Throws as plate::Reader::load() does.
[[nodiscard]] plate::Reader load_reader(const PlateFlags& flags, const Context& context);

}  // namespace tarsier::cli
