// SPDX-License-Identifier: MIT
#pragma once

#include "http_connections.h"
#include <cstdint>
#include <string_view>

struct MHD_Response;

namespace tarsier::web {

// A response for libmicrohttpd.
struct MhdResponse {
  MHD_Response* body = nullptr;  // the caller destroys it; null if out of memory
  std::uint64_t bytes = 0;       // size of the body if known
  bool is_stream = false;
};

// Converts `response` and adds the headers of every response. The status becomes 404 if its file is
// missing, and 206 or 416 if `range` (of the request) requests a part. `connections` and `counters`
// must outlive a stream.
[[nodiscard]] MhdResponse make_mhd_response(Response& response, std::string_view range, int socket,
                                            const HttpConnections& connections,
                                            HttpCounters& counters);

}  // namespace tarsier::web
