// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>

namespace tarsier::fuzz {

using MutateBytes = std::size_t (*)(std::uint8_t* data, std::size_t size, std::size_t most);

// Changes a JSON text (or one of several lines of JSON) in place so that it mostly stays JSON:
// numbers to odd ones, members away, twice, elsewhere or of another type; of packed arrays
// (media/archive.h) single values, shapes and lengths. Now and then, and where the text is no JSON,
// it is changed as bytes. Returns the new size, <= `most`.
std::size_t mutate_json(std::uint8_t* data, std::size_t size, std::size_t most, unsigned seed,
                        MutateBytes mutate_bytes);

}  // namespace tarsier::fuzz
