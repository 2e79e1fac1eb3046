// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/io/frame_sink.h"

#include <memory>
#include <string>

namespace tarsier {

// MJPEG over HTTP/1.1, for browsers and for other programs:
//   /             a page with the live picture for browsers (Accept: text/html), the stream for
//   everyone else /stream.mjpg  the stream: multipart/x-mixed-replace, each part a JPEG with
//   Content-Length /snapshot.jpg the newest picture /healthz
//   {"state","frames","viewers","seconds_since_frame"} as JSON
// A viewer gets the newest frame each time it has taken the last one, and skips what came between;
// write() never waits for viewers. A picture is encoded at most once, and only if someone asks.
//
// Loopback by default: `url` is http://HOST:PORT/ with HOST one of localhost, 127.x.y.z, [::1]. Any
// other address (0.0.0.0 and [::] are every interface) needs options.listen_all and a token, else
// UsageError. Port 0: any free one; description() tells which. Requests with a foreign Host (DNS
// rebinding) or Origin are refused. Throws OutputError when the address cannot be listened on.
[[nodiscard]] std::unique_ptr<FrameSink> open_http_sink(const std::string& url,
                                                        const SinkOptions& options);

}  // namespace tarsier
