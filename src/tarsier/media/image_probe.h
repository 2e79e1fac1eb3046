// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/image_file.h"

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

// Checks of an image's bytes without decoding; for image_file.cpp. Nothing here reads outside
// `bytes`.
namespace tarsier {

// The format by the first bytes.
[[nodiscard]] std::optional<ImageFormat> image_format_of(std::span<const std::uint8_t> bytes);

// The reason why bytes of no known format are refused, one line.
[[nodiscard]] std::string describe_not_an_image(std::span<const std::uint8_t> bytes);

// What is wrong with the bytes after the header: truncated, wrong checksums, more work than an
// image can need. Empty if nothing is wrong. `replacement` receives the bytes to decode if these
// are others: of a PNG the chunks that the decoder needs, of a binary PNM with an unusual maximum
// the same image with the maximum 255 or 65535.
[[nodiscard]] std::string find_image_damage(std::span<const std::uint8_t> bytes,
                                            const ImageHeader& header,
                                            std::vector<std::uint8_t>& replacement);

}  // namespace tarsier
