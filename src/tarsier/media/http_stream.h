// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/live_source.h"

#include <memory>
#include <string>

namespace tarsier {

// MJPEG (multipart/x-mixed-replace, or JPEGs in any stream) or a JPEG snapshot that is requested
// repeatedly, over http or https. At most three redirects are followed, from https only to https.
// The password is sent only to the host that it was given for. Over https, other kinds of video are
// read by FFmpeg in a child process; playlists (HLS, DASH) only with StreamSecurity::insecure,
// because FFmpeg does not check the certificates of the addresses in them. Throws InputError for an
// invalid URL or CA file.
[[nodiscard]] std::unique_ptr<LiveBackend> make_http_backend(const std::string& url,
                                                             const SourceOptions& options);

}  // namespace tarsier
