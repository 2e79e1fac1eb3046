// SPDX-License-Identifier: MIT
#pragma once

#include "http_connections.h"
#include <cstdint>
#include <string_view>

struct MHD_Response;

namespace tarsier::web {

// An answer for libmicrohttpd.
struct HttpAnswer {
  MHD_Response* body = nullptr;  // the caller's to destroy; null where there is no memory
  std::uint64_t bytes = 0;       // of a body whose length is known
  bool is_stream = false;
};

// Of `response`, with the headers that each answer carries; its status becomes 404 where its file is
// gone, 206 or 416 where `range` (of the request) asks for a part. `connections` and `counters`
// must outlive a stream.
[[nodiscard]] HttpAnswer make_answer(Response& response, std::string_view range, int socket,
                                     const HttpConnections& connections, HttpCounters& counters);

}  // namespace tarsier::web
