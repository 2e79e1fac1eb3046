// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

#include "framework/cli.h"
#include <cstdint>
#include <string>

// Large galleries of random templates: for bench_people.cpp.
namespace tarsier::cli {

// The peak memory of this process so far, MB.
[[nodiscard]] double peak_memory();

void bench_template_index(Context& context, const face::recognition::Background& background,
                          std::int64_t count, double spread, const std::string& folder);

// A whole gallery of random templates in the folder: with the index and without.
void bench_indexed_gallery(Context& context, const face::recognition::Background& background,
                           std::int64_t count, double spread, const std::string& folder);

}  // namespace tarsier::cli
