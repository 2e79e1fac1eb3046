// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/image_file.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

// What an image's bytes say without being decoded; for image_file.cpp. Nothing here
// reads outside `bytes`.
namespace tarsier {

// By the first bytes.
[[nodiscard]] std::optional<ImageFormat> image_format_of(std::span<const std::uint8_t> bytes);

// Why bytes of no known format are refused, one line.
[[nodiscard]] std::string describe_not_an_image(std::span<const std::uint8_t> bytes);

// What is wrong with the bytes behind the header, empty if nothing is: cut short, wrong checksums,
// more work than an image can need. For PNG, `kept` takes the chunks that the decoder needs; else
// it stays empty.
[[nodiscard]] std::string find_image_damage(std::span<const std::uint8_t> bytes,
                                            const ImageHeader& header,
                                            std::vector<std::uint8_t>& kept);

}  // namespace tarsier
