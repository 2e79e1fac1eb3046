// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/live_source.h"

#include <memory>
#include <string>

namespace tarsier {

// MJPEG (multipart/x-mixed-replace, or JPEGs in whatever comes) or a JPEG snapshot that is asked
// for again and again, over http or https. Redirects are followed three times at most, from https
// to https only; the password is not sent to another host than the one it was given for. Over https
// other kinds of video are left to FFmpeg, in a child process; playlists (HLS, DASH) only with
// StreamSecurity::insecure, since FFmpeg does not check the certificates of what they point to.
// Throws InputError for a bad URL or CA file.
[[nodiscard]] std::unique_ptr<LiveBackend> make_http_backend(const std::string& url,
                                                             const SourceOptions& options);

}  // namespace tarsier
