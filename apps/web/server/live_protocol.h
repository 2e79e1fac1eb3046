// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

// The protocol between a pipe window, the server and its viewers (docs/studio.md).
namespace tarsier::web {

// Parses the records of a pipe window: u32 length, u8 kind, payload. Bytes may arrive in pieces of
// any size. A record that is empty or has more than 64 MB breaks the stream.
class WindowRecords {
 public:
  struct Record {
    char kind = 0;
    std::string payload;
  };
  // Returns false once the stream is broken.
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

// Converts one event of POST /api/sessions/ID/events to a line for the pipe window; nullopt if it
// is not a key, mouse, action or slider event, or has values out of range.
[[nodiscard]] std::optional<std::string> event_line(const nlohmann::json& event);

// Appends one record of /api/live: u32 length of the rest, u8 kind, u8 length of the id, id,
// payload. All numbers are big-endian. The id has at most 255 bytes.
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
