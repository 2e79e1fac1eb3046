// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace tarsier::web {

// The boundary of "multipart/form-data; boundary=..." (RFC 7578, RFC 2046); nothing for any other
// content type, or a boundary that is empty, longer than 70 characters or has others than allowed.
[[nodiscard]] std::optional<std::string> multipart_boundary(std::string_view content_type);

// One part's head.
struct MultipartPart {
  std::string name;          // of the field
  std::string file_name;     // as the client states it: untrusted, may be a path; empty: no file
  std::string content_type;  // lower case, without parameters; "" if absent
};

// Reads a body of type multipart/form-data in pieces of any size, in constant memory. Calls:
// on_part for each head, then on_bytes for its content, then on_end. Limits: 1000 parts, 8 kB of
// head.
class MultipartParser {
 public:
  struct Events {
    std::function<void(const MultipartPart&)> on_part;
    std::function<void(std::string_view bytes)> on_bytes;
    std::function<void()> on_end;
  };
  MultipartParser(const std::string& boundary, Events events);
  // False once the body is malformed: trouble() says why; nothing more is called.
  bool feed(std::string_view bytes);
  // Whether the last boundary has come.
  [[nodiscard]] bool is_complete() const { return state_ == State::kDone; }
  [[nodiscard]] const std::string& trouble() const { return trouble_; }

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
  std::string trouble_;
};

}  // namespace tarsier::web
