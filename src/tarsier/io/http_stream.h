// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/io/live_source.h"

#include <memory>
#include <string>

namespace tarsier {

// MJPEG (multipart/x-mixed-replace, or JPEGs in whatever comes) or a JPEG snapshot that is asked
// for again and again, over plain HTTP. Redirects are followed to http only, three times at most;
// the password is not sent to another host than the one it was given for. Throws InputError for a
// bad URL.
[[nodiscard]] std::unique_ptr<LiveBackend> make_http_backend(const std::string& url,
                                                             const SourceOptions& options);

}  // namespace tarsier
