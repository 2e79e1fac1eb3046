// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_sink.h"

#include <memory>
#include <string>

namespace tarsier {

// MJPEG over HTTP/1.1, for browsers and other programs:
//   /              browsers (Accept: text/html): a page with the live image; others: the stream
//   /stream.mjpg   the stream: multipart/x-mixed-replace, each part a JPEG with Content-Length
//   /snapshot.jpg  the newest image
//   /healthz       {"state","frames","viewers","seconds_since_frame"} as JSON
// A viewer gets the newest frame each time it has received the last one; frames in between are
// skipped. write() never waits for viewers. An image is encoded at most once, and only on request.
//
// Loopback by default: `url` is http://HOST:PORT/ with HOST one of localhost, 127.x.y.z, [::1]. Any
// other address (0.0.0.0 and [::] are all interfaces) needs options.listen_all and a token, else
// UsageError. Port 0: any free port; description() names it. Requests with a foreign Host (DNS
// rebinding) or Origin are refused. Throws OutputError if the address cannot be listened on.
[[nodiscard]] std::unique_ptr<FrameSink> open_http_sink(const std::string& url,
                                                        const SinkOptions& options);

}  // namespace tarsier
