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

// Whether `path` has the extension of a readable image (.jpg .jpeg .jpe .png .webp .bmp .ppm .pgm
// .pbm .pnm, in upper or lower case).
[[nodiscard]] bool has_image_extension(std::string_view path);

// What a frame belongs to: its name; for an image of a sequence its folder.
[[nodiscard]] std::string source_of(const Frame& frame);

// Natural order: "img2" before "img10". Case decides only between otherwise equal names.
[[nodiscard]] bool natural_less(std::string_view a, std::string_view b);

// The images of a folder without sub-folders, in natural order; hidden files are skipped. Throws
// InputError if the folder is not readable or has no images.
[[nodiscard]] std::vector<std::string> images_in_folder(const std::string& folder);

// The files that match a shell pattern, without folders, in natural order. Throws InputError if
// none match.
[[nodiscard]] std::vector<std::string> files_of_glob(const std::string& pattern);

// The paths of a list: one per line; "#" lines and empty lines are skipped. A path that does not
// exist as written is searched in the list's folder. Throws InputError: not readable, empty, not
// text.
[[nodiscard]] std::vector<std::string> paths_of_list(const std::string& list);

// Images one after the other. A single image that cannot be read throws InputError. Of several
// images, those that cannot be read are skipped; the last next() throws if none could be read.
[[nodiscard]] std::unique_ptr<FrameSource> make_still_source(std::vector<std::string> paths,
                                                             const SourceOptions& options);

// An image of a batch.
struct BatchImage {
  std::int64_t number = 0;  // Frame::index
  std::string path;
};
// The images of a batch one after the other. Images that cannot be read are passed to `on_skip`
// with the reason and skipped, even if that is all of them. `images` may be empty.
[[nodiscard]] std::unique_ptr<FrameSource> make_batch_source(
    const std::vector<BatchImage>& images,
    std::function<void(std::int64_t number, const std::string& reason)> on_skip);

}  // namespace tarsier
