// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>

// What goes between a pipe window, the server and its viewers (docs/studio.md).
namespace tarsier::web {

// Reads the records that a pipe window writes: u32 length, u8 kind, payload. In pieces of any size;
// a record of more than 64 MB, or none at all, breaks the stream.
class WindowRecords {
 public:
  struct Record {
    char kind = 0;
    std::string payload;
  };
  // False once the stream is broken.
  bool feed(std::string_view bytes);
  [[nodiscard]] std::optional<Record> take();
  [[nodiscard]] bool is_broken() const { return broken_; }

  static constexpr std::size_t kMaxRecord = 64 << 20;

 private:
  std::string pending_;
  std::size_t read_ = 0;  // of pending_
  bool broken_ = false;
};

// Four bytes, big-endian.
[[nodiscard]] std::uint32_t read_u32(const char* bytes);

// One event of POST /api/sessions/ID/events as the line that the pipe window reads; nothing for
// anything that is no key, mouse, action or slider event, or has values out of range.
[[nodiscard]] std::optional<std::string> event_line(const nlohmann::json& event);

// One record of /api/live: u32 length of what follows, u8 kind, u8 length of the id, id, payload.
// All numbers big-endian. The id has at most 255 bytes.
enum class LiveRecord : std::uint8_t {
  kImage = 1,
  kState = 2,
  kHello = 3,
  kJob = 4,
  kPing = 5,
  kEnded = 6
};
void append_record(std::string& out, LiveRecord kind, std::string_view id,
                   std::string_view payload);
// The head of an image's payload: u32 frame, u32 age in ms.
[[nodiscard]] std::string image_head(std::uint32_t frame, std::uint32_t age_ms);

}  // namespace tarsier::web
