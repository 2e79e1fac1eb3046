// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

namespace tarsier::fuzz {

using MutateBytes = std::size_t (*)(std::uint8_t* data, std::size_t size, std::size_t max_size);

// Mutates a JSON text (or a text of several JSON lines) in place so that it mostly stays valid
// JSON: unusual numbers; members removed, duplicated, moved or of another type; in packed arrays
// (media/archive.h) single values, shapes and lengths. Sometimes, and if the text is not JSON, it
// is mutated as bytes. Returns the new size, <= `max_size`.
std::size_t mutate_json(std::uint8_t* data, std::size_t size, std::size_t max_size, unsigned seed,
                        MutateBytes mutate_bytes);

}  // namespace tarsier::fuzz
