// SPDX-License-Identifier: MIT
#include "multipart.h"

#include "tarsier/core/words.h"

#include <algorithm>

namespace tarsier::web {
namespace {

constexpr std::size_t kMaxParts = 1000;
constexpr std::size_t kMaxHead = 8192;
constexpr std::size_t kMaxName = 1024;

// The value of `; key=value` or `; key="value"`; nullopt if it is absent or malformed.
std::optional<std::string> parameter_of(std::string_view text, std::string_view key) {
  std::size_t at = text.find(';');
  while (at != std::string_view::npos) {
    std::string_view rest = trimmed(text.substr(at + 1));
    const std::size_t equals = rest.find_first_of("=;");
    if (equals == std::string_view::npos) return std::nullopt;
    if (rest[equals] == ';') {
      text = rest;
      at = equals;
      continue;
    }
    const std::string name = lower_case(trimmed(rest.substr(0, equals)));
    rest = trimmed(rest.substr(equals + 1));
    std::string value;
    std::size_t end = 0;
    if (!rest.empty() && rest.front() == '"') {
      for (end = 1; end < rest.size() && rest[end] != '"'; ++end) {
        // Browsers escape only the quotation mark, as %22; other clients use a backslash.
        if (rest[end] == '\\' && end + 1 < rest.size() &&
            (rest[end + 1] == '"' || rest[end + 1] == '\\'))
          ++end;
        value += rest[end];
      }
      if (end >= rest.size()) return std::nullopt;
      ++end;
    } else {
      end = std::min(rest.find(';'), rest.size());
      value = trimmed(rest.substr(0, end));
    }
    if (name == key) return value;
    text = rest.substr(end);
    at = text.find(';');
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::string> multipart_boundary(std::string_view content_type) {
  const std::size_t end = std::min(content_type.find(';'), content_type.size());
  if (lower_case(trimmed(content_type.substr(0, end))) != "multipart/form-data")
    return std::nullopt;
  const auto boundary = parameter_of(content_type.substr(end), "boundary");
  if (!boundary || boundary->empty() || boundary->size() > 70 || boundary->back() == ' ')
    return std::nullopt;
  const bool plain = std::all_of(boundary->begin(), boundary->end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           std::string_view("'()+_,-./:=? ").find(c) != std::string_view::npos;
  });
  return plain ? boundary : std::nullopt;
}

MultipartParser::MultipartParser(const std::string& boundary, Events events)
    : delimiter_("\r\n--" + boundary), events_(std::move(events)), pending_("\r\n") {}

bool MultipartParser::fail(std::string why) {
  state_ = State::kBroken;
  error_ = std::move(why);
  pending_.clear();
  return false;
}

bool MultipartParser::feed(std::string_view bytes) {
  while (state_ != State::kBroken && state_ != State::kDone && !bytes.empty()) {
    // In pieces, so that the buffer stays small.
    const std::size_t count = std::min<std::size_t>(bytes.size(), 65536);
    pending_.append(bytes.substr(0, count));
    bytes.remove_prefix(count);
    bool more = true;
    while (more) {
      if (!step(more)) return false;
    }
  }
  return state_ != State::kBroken;
}

// Parses one part of the buffered body; `more`: whether another call can continue.
bool MultipartParser::step(bool& more) {
  more = false;
  switch (state_) {
    case State::kPreamble:
    case State::kContent: {
      const std::size_t at = pending_.find(delimiter_);
      // Without a delimiter, the end of the buffer may be the start of one.
      const std::size_t safe =
          at != std::string::npos
              ? at
              : pending_.size() - std::min(pending_.size(), delimiter_.size() - 1);
      if (state_ == State::kContent && safe > 0)
        events_.on_bytes(std::string_view(pending_).substr(0, safe));
      pending_.erase(0, safe);
      if (at == std::string::npos) return true;
      if (state_ == State::kContent) events_.on_end();
      pending_.erase(0, delimiter_.size());
      state_ = State::kAfterBoundary;
      more = true;
      return true;
    }
    case State::kAfterBoundary: {
      if (pending_.size() < 2) return true;
      if (pending_.starts_with("--")) {
        state_ = State::kDone;
        pending_.clear();
        return true;
      }
      const std::size_t end = pending_.find("\r\n");
      const std::size_t blanks = pending_.find_first_not_of(" \t");
      if (blanks != std::string::npos && pending_[blanks] != '\r')
        return fail("a boundary is not followed by a line end");
      if (end == std::string::npos)
        return pending_.size() > kMaxHead ? fail("a boundary line is too long") : true;
      if (++parts_ > kMaxParts) return fail("more than 1000 parts");
      // The line end stays: an empty head is an empty line.
      pending_.erase(0, end);
      state_ = State::kHead;
      more = true;
      return true;
    }
    case State::kHead: {
      const std::size_t end = pending_.find("\r\n\r\n");
      if (end == std::string::npos)
        return pending_.size() > kMaxHead ? fail("the head of a part is longer than 8 kB") : true;
      if (end > kMaxHead) return fail("the head of a part is longer than 8 kB");
      const std::string head = pending_.substr(0, end);
      if (!read_head(head)) return false;
      pending_.erase(0, end + 4);
      state_ = State::kContent;
      more = true;
      return true;
    }
    case State::kDone:
    case State::kBroken:
      return true;
  }
  return true;
}

bool MultipartParser::read_head(std::string_view head) {
  MultipartPart part;
  bool is_named = false;
  while (!head.empty()) {
    const std::string_view line = trimmed(next_line(head));
    if (line.empty()) continue;
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) return fail("a line in the head of a part has no ':'");
    const std::string name = lower_case(trimmed(line.substr(0, colon)));
    const std::string_view value = trimmed(line.substr(colon + 1));
    if (name == "content-disposition") {
      const std::size_t end = std::min(value.find(';'), value.size());
      if (lower_case(trimmed(value.substr(0, end))) != "form-data")
        return fail("a part is not form-data");
      const auto field = parameter_of(value.substr(end), "name");
      if (!field) return fail("a part has no name");
      part.name = *field;
      part.file_name = parameter_of(value.substr(end), "filename").value_or("");
      is_named = true;
    } else if (name == "content-type") {
      part.content_type = lower_case(trimmed(value.substr(0, value.find(';'))));
    }
  }
  if (!is_named) return fail("a part has no name");
  if (part.name.size() > kMaxName || part.file_name.size() > kMaxName)
    return fail("a name in the head of a part is too long");
  if (part.name.find('\0') != std::string::npos || part.file_name.find('\0') != std::string::npos)
    return fail("a name in the head of a part contains a NUL");
  events_.on_part(part);
  return true;
}

}  // namespace tarsier::web
