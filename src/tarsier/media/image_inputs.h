// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <string>
#include <vector>

namespace tarsier {

// The paths of all images that the inputs name (images, folders, globs, @lists), in the order of
// open_sources(). Entries of a list are not checked on the disk. Throws InputError for an input
// that is missing or not an image: a video, a camera, an address, one of `schemes`.
[[nodiscard]] std::vector<std::string> images_of_inputs(const std::vector<std::string>& inputs,
                                                        const std::vector<Scheme>& schemes = {});

}  // namespace tarsier
