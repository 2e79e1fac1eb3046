// SPDX-License-Identifier: MIT
#include "mhd_response.h"

#include "tarsier/core/log.h"

#include <fmt/format.h>

#include "request_target.h"
#include <algorithm>
#include <fcntl.h>
#include <memory>
#include <microhttpd.h>
#include <optional>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace tarsier::web {
namespace {

// Pages load nothing from elsewhere and run no inline scripts.
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'self'; "
    "frame-ancestors 'none'";
// A user's file, opened directly, is not a page of the studio.
constexpr const char* kDataPolicy =
    "default-src 'none'; script-src 'none'; style-src 'self'; img-src 'self' blob:; "
    "connect-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; sandbox";

struct Streaming {
  std::unique_ptr<BodyStream> stream;
  const HttpConnections* connections = nullptr;
  HttpCounters* counters = nullptr;
  int socket = -1;
  std::uint64_t sent = 0;
};

ssize_t read_stream(void* cls, std::uint64_t, char* buffer, std::size_t most) {
  auto& streaming = *static_cast<Streaming*>(cls);
  try {
    if (streaming.connections->is_closing()) return MHD_CONTENT_READER_END_OF_STREAM;
    const std::ptrdiff_t count = streaming.stream->read({buffer, most}, streaming.socket);
    if (count < 0) return MHD_CONTENT_READER_END_OF_STREAM;
    streaming.counters->bytes += static_cast<std::uint64_t>(count);
    return count;
  } catch (const std::exception& error) {
    log_warning("HTTP: {}", error.what());
    return MHD_CONTENT_READER_END_WITH_ERROR;
  }
}

void end_stream(void* cls) { delete static_cast<Streaming*>(cls); }

// Null if it is not a regular file (any more): `response` is then a 404.
MHD_Response* of_file(Response& response, std::string_view range_text, std::uint64_t& size) {
  const int fd = ::open(response.file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  struct stat state {};
  if (fd < 0 || ::fstat(fd, &state) != 0 || !S_ISREG(state.st_mode)) {
    if (fd >= 0) ::close(fd);
    response = error_response(404, "there is no such file");
    return nullptr;
  }
  size = static_cast<std::uint64_t>(state.st_size);
  response.headers.emplace_back("Accept-Ranges", "bytes");
  bool unsatisfiable = false;
  const auto range = response.status == 200 ? parse_range(range_text, size, unsatisfiable)
                                            : std::optional<ByteRange>();
  if (unsatisfiable) {
    ::close(fd);
    const std::string all = fmt::format("bytes */{}", size);
    response = error_response(416, "the requested range is outside the file");
    response.headers.emplace_back("Content-Range", all);
    return nullptr;
  }
  std::uint64_t first = 0;
  if (range) {
    response.status = 206;
    response.headers.emplace_back("Content-Range",
                                  fmt::format("bytes {}-{}/{}", range->first, range->last, size));
    first = range->first;
    size = range->last - range->first + 1;
  }
  MHD_Response* body = MHD_create_response_from_fd_at_offset64(size, fd, first);
  if (body == nullptr) ::close(fd);
  return body;
}

void add_headers(MHD_Response* body, const Response& response) {
  const auto header = [&](const char* name, const std::string& value) {
    // A line end in a value would start another header: libmicrohttpd refuses it.
    (void)MHD_add_response_header(body, name, value.c_str());
  };
  const auto has = [&](std::string_view name) {
    return std::any_of(response.headers.begin(), response.headers.end(),
                       [&](const auto& item) { return item.first == name; });
  };
  if (!response.type.empty()) header("Content-Type", response.type);
  for (const auto& [name, value] : response.headers) header(name.c_str(), value);
  if (!has("Cache-Control")) header("Cache-Control", "no-store");
  header("Content-Security-Policy", response.file.empty() ? kPolicy : kDataPolicy);
  header("X-Content-Type-Options", "nosniff");
  header("Referrer-Policy", "no-referrer");
  header("Cross-Origin-Opener-Policy", "same-origin");
  header("Cross-Origin-Resource-Policy", "same-origin");
  header("X-Frame-Options", "DENY");
  header("Permissions-Policy",
         "camera=(self), microphone=(), geolocation=(), display-capture=(), usb=(), serial=()");
}

}  // namespace

MhdResponse make_mhd_response(Response& response, std::string_view range, int socket,
                              const HttpConnections& connections, HttpCounters& counters) {
  MhdResponse answer;
  if (response.stream != nullptr) {
    auto streaming = std::make_unique<Streaming>();
    streaming->stream = std::move(response.stream);
    streaming->connections = &connections;
    streaming->counters = &counters;
    streaming->socket = socket;
    const bool is_plain = streaming->stream->is_plain();
    constexpr std::size_t kBlock = 65536;
    answer.body = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, kBlock, &read_stream,
                                                    streaming.get(), &end_stream);
    if (answer.body == nullptr) return answer;
    (void)streaming.release();  // end_stream owns it
    if (is_plain)
      (void)MHD_set_response_options(answer.body, MHD_RF_HTTP_1_0_COMPATIBLE_STRICT, MHD_RO_END);
    answer.is_stream = true;
  } else {
    if (!response.file.empty()) {
      answer.body = of_file(response, range, answer.bytes);
    } else if (response.memory.data() != nullptr) {
      answer.bytes = response.memory.size();
      answer.body = MHD_create_response_from_buffer(response.memory.size(),
                                                    const_cast<char*>(response.memory.data()),
                                                    MHD_RESPMEM_PERSISTENT);
    }
    if (answer.body == nullptr) {
      answer.bytes = response.body.size();
      answer.body = MHD_create_response_from_buffer(response.body.size(), response.body.data(),
                                                    MHD_RESPMEM_MUST_COPY);
    }
    if (answer.body == nullptr) return answer;
  }
  add_headers(answer.body, response);
  return answer;
}

}  // namespace tarsier::web
