// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Whether `path` ends like an image that can be read (.jpg .jpeg .jpe .png .webp .bmp .ppm .pgm
// .pbm .pnm, in any case).
[[nodiscard]] bool has_image_ending(std::string_view path);

// What a frame belongs to: the frame's name; of an image that is shown in sequence its folder.
[[nodiscard]] std::string source_of(const Frame& frame);

// Orders as people do: "img2" before "img10". Upper and lower case are equal at first.
[[nodiscard]] bool natural_less(std::string_view a, std::string_view b);

// The images of a folder, not those of its sub-folders, sorted naturally; hidden files are passed
// over. Throws InputError: not readable, no images in it.
[[nodiscard]] std::vector<std::string> images_in_folder(const std::string& folder);

// What a pattern of the shell matches, folders left out, sorted naturally. Throws InputError if
// nothing.
[[nodiscard]] std::vector<std::string> files_of_glob(const std::string& pattern);

// The paths in a list: one a line, "#" lines and empty ones passed over. A path that does not exist
// as it stands is looked for in the list's folder. Throws InputError: not readable, empty, not
// text.
[[nodiscard]] std::vector<std::string> paths_of_list(const std::string& list);

// Images one after the other. One alone throws InputError when it cannot be read; of several,
// those that cannot are skipped, and only if none could be read the last next() throws.
[[nodiscard]] std::unique_ptr<FrameSource> make_still_source(std::vector<std::string> paths,
                                                             const SourceOptions& options);

// An image of a batch.
struct BatchImage {
  std::int64_t number = 0;  // Frame::index
  std::string path;
};
// The images of a batch one after the other. Those that cannot be read are reported to `on_skip` with
// the reason and passed over, also where it is all of them. There may be none.
[[nodiscard]] std::unique_ptr<FrameSource> make_batch_source(
    const std::vector<BatchImage>& images,
    std::function<void(std::int64_t number, const std::string& reason)> on_skip);

}  // namespace tarsier
