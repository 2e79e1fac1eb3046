// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace tarsier::web {

// The boundary of "multipart/form-data; boundary=..." (RFC 7578, RFC 2046). nullopt for any other
// content type, or a boundary that is empty, longer than 70 characters or has invalid characters.
[[nodiscard]] std::optional<std::string> multipart_boundary(std::string_view content_type);

// The head of one part.
struct MultipartPart {
  std::string name;  // of the field
  // As stated by the client: untrusted, may be a path; empty: not a file.
  std::string file_name;
  std::string content_type;  // lower case, without parameters; "" if absent
};

// Parses a body of type multipart/form-data in pieces of any size, with constant memory. For each
// part it calls on_part for the head, on_bytes for the content, then on_end. Limits: 1000 parts, 8
// kB per head.
class MultipartParser {
 public:
  struct Events {
    std::function<void(const MultipartPart&)> on_part;
    std::function<void(std::string_view bytes)> on_bytes;
    std::function<void()> on_end;
  };
  MultipartParser(const std::string& boundary, Events events);
  // Returns false if the body is malformed: error() has the reason, and there are no more calls.
  bool feed(std::string_view bytes);
  // Whether the last boundary was received.
  [[nodiscard]] bool is_complete() const { return state_ == State::kDone; }
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  enum class State { kPreamble, kAfterBoundary, kHead, kContent, kDone, kBroken };
  bool fail(std::string why);
  bool step(bool& more);
  bool read_head(std::string_view head);

  const std::string delimiter_;  // "\r\n--boundary"
  const Events events_;
  State state_ = State::kPreamble;
  std::string pending_;
  std::size_t parts_ = 0;
  std::string error_;
};

}  // namespace tarsier::web
