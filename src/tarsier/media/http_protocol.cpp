// SPDX-License-Identifier: MIT
#include "tarsier/media/http_protocol.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"
#include "tarsier/media/frame_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <system_error>
#include <utility>

namespace tarsier {
namespace {

template <typename Number>
bool parse_number(std::string_view text, Number& value, int base = 10) {
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value, base);
  return error == std::errc() && end == text.data() + text.size();
}

std::string percent_decoded(std::string_view text) {
  std::string result;
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    if (text[i] == '%' && i + 2 < text.size() && parse_number(text.substr(i + 1, 2), value, 16)) {
      result += static_cast<char>(value);
      i += 2;
    } else {
      result += text[i];
    }
  }
  return result;
}

}  // namespace

std::string HttpUrl::host_header(std::uint16_t default_port) const {
  std::string text = host.find(':') != std::string::npos ? "[" + host + "]" : host;
  if (port != default_port) text += fmt::format(":{}", port);
  return text;
}

HttpUrl parse_url(std::string_view text, std::string_view scheme, std::uint16_t default_port) {
  const auto refuse = [&](const char* reason) {
    throw InputError(masked(text),
                     fmt::format("{}; expected {}://host[:port]/path", reason, scheme));
  };
  const std::size_t start = scheme.size() + 3;
  if (text.size() < start || lower_case(text.substr(0, start)) != fmt::format("{}://", scheme)) {
    refuse("not such an address");
  }
  if (text.size() > 8192) refuse("too long");
  for (const char c : text) {
    if (static_cast<unsigned char>(c) <= 0x20 || c == 0x7f)
      refuse("has a space or control character");
  }
  HttpUrl url;
  const std::string_view rest = text.substr(start);
  const std::size_t authority_end = std::min(rest.find_first_of("/?#"), rest.size());
  std::string_view authority = rest.substr(0, authority_end);
  std::string_view target = rest.substr(authority_end);
  target = target.substr(0, std::min(target.find('#'), target.size()));
  url.target =
      target.empty() || target.front() != '/' ? fmt::format("/{}", target) : std::string(target);

  if (const std::size_t at = authority.rfind('@'); at != std::string_view::npos) {
    const std::string_view who = authority.substr(0, at);
    const std::size_t colon = std::min(who.find(':'), who.size());
    url.user = percent_decoded(who.substr(0, colon));
    if (colon < who.size()) url.password = percent_decoded(who.substr(colon + 1));
    authority.remove_prefix(at + 1);
  }
  url.port = default_port;
  std::string_view port;
  bool has_port = false;
  if (!authority.empty() && authority.front() == '[') {
    const std::size_t close = authority.find(']');
    if (close == std::string_view::npos) refuse("has no ']' after its IPv6 address");
    url.host = authority.substr(1, close - 1);
    const std::string_view behind = authority.substr(close + 1);
    if (!behind.empty() && behind.front() != ':')
      refuse("has something odd after its IPv6 address");
    has_port = !behind.empty();
    if (has_port) port = behind.substr(1);
  } else {
    const std::size_t colon = authority.find(':');
    url.host = authority.substr(0, std::min(colon, authority.size()));
    has_port = colon != std::string_view::npos;
    if (has_port) port = authority.substr(colon + 1);
  }
  if (url.host.empty()) refuse("has no host name");
  if (has_port && (!parse_number(port, url.port) || url.port == 0)) refuse("has a bad port");
  return url;
}

void HttpResponseParser::fail(std::string reason) {
  state_ = State::kBroken;
  error_message_ = std::move(reason);
}

void HttpResponseParser::feed(std::span<const std::uint8_t> bytes,
                              std::vector<std::uint8_t>& body) {
  while (state_ == State::kHeader && !bytes.empty()) bytes = bytes.subspan(read_header(bytes));
  if (state_ == State::kBody) read_body(bytes, body);
}

// Takes bytes of one header, at most to its end; returns how many.
std::size_t HttpResponseParser::read_header(std::span<const std::uint8_t> bytes) {
  const std::size_t before = header_.size();
  const std::size_t count = std::min(kHeaderLimit - before, bytes.size());
  header_.append(reinterpret_cast<const char*>(bytes.data()), count);
  // The status line is checked as early as possible: a server that is not HTTP may never send an
  // empty line.
  const std::string_view magic = "HTTP/1.";
  const std::size_t compared = std::min(magic.size(), header_.size());
  if (std::string_view(header_).substr(0, compared) != magic.substr(0, compared)) {
    fail("does not speak HTTP");
    return count;
  }
  const std::size_t search_from = before > 3 ? before - 3 : 0;
  std::size_t end = header_.find("\r\n\r\n", search_from);
  std::size_t gap = 4;
  if (const std::size_t bare = header_.find("\n\n", search_from); bare < end) {
    end = bare;  // some small cameras send this
    gap = 2;
  }
  if (end == std::string::npos) {
    if (header_.size() >= kHeaderLimit) fail("sends an HTTP header without end");
    return count;
  }
  header_.resize(end);
  const std::size_t used = end + gap - before;
  if (!parse_header()) return used;
  header_.clear();
  if (status_ < 200 && status_ != 101) {  // an interim response; the final one follows
    status_ = 0;
    if (++interim_ > kMaxInterim) fail("sends interim answers without end");
    return used;
  }
  state_ = has_length_ && remaining_ == 0 && !chunked_ ? State::kDone : State::kBody;
  return used;
}

bool HttpResponseParser::parse_header() {
  std::string_view rest = header_;
  bool is_first = true;
  content_type_.clear();
  location_.clear();
  chunked_ = false;
  has_length_ = false;
  remaining_ = 0;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    const std::string_view line = trimmed(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (is_first) {
      is_first = false;
      if (line.size() < 12 || line[8] != ' ' || !parse_number(line.substr(9, 3), status_) ||
          status_ < 100 || status_ > 599) {
        fail("sends a broken HTTP status line");
        return false;
      }
      status_text_ = trimmed(line.substr(12));
      continue;
    }
    const std::size_t colon = line.find(':');
    if (colon == std::string_view::npos) continue;
    const std::string name = lower_case(trimmed(line.substr(0, colon)));
    const std::string_view value = trimmed(line.substr(colon + 1));
    if (name == "content-type") {
      content_type_ = value;
    } else if (name == "location") {
      location_ = value;
    } else if (name == "transfer-encoding") {
      chunked_ = lower_case(value).find("chunked") != std::string::npos;
    } else if (name == "content-length") {
      has_length_ = parse_number(value, remaining_);
      if (!has_length_) remaining_ = 0;
    }
  }
  // Some cameras send a length for their endless stream.
  if (lower_case(content_type_).starts_with("multipart/")) has_length_ = false;
  return true;
}

void HttpResponseParser::read_body(std::span<const std::uint8_t> bytes,
                                   std::vector<std::uint8_t>& body) {
  if (chunked_) {
    read_chunks(bytes, body);
    return;
  }
  if (has_length_) {
    bytes =
        bytes.first(static_cast<std::size_t>(std::min<std::uint64_t>(remaining_, bytes.size())));
    remaining_ -= bytes.size();
    if (remaining_ == 0) state_ = State::kDone;
  }
  body.insert(body.end(), bytes.begin(), bytes.end());
}

void HttpResponseParser::read_chunks(std::span<const std::uint8_t> bytes,
                                     std::vector<std::uint8_t>& body) {
  while (!bytes.empty() && state_ == State::kBody) {
    if (chunk_ == Chunk::kData) {
      const auto part =
          bytes.first(static_cast<std::size_t>(std::min<std::uint64_t>(remaining_, bytes.size())));
      body.insert(body.end(), part.begin(), part.end());
      bytes = bytes.subspan(part.size());
      remaining_ -= part.size();
      if (remaining_ == 0) chunk_ = Chunk::kDataEnd;
      continue;
    }
    const char c = static_cast<char>(bytes.front());
    bytes = bytes.subspan(1);
    if (c != '\n') {
      line_ += c;
      if (line_.size() > 4096) fail("sends a broken chunked stream");
      continue;
    }
    const std::string line = std::exchange(line_, {});
    const std::string_view text = trimmed(line);
    if (chunk_ == Chunk::kDataEnd) {
      if (!text.empty()) fail("sends a broken chunked stream");
      chunk_ = Chunk::kSize;
    } else if (chunk_ == Chunk::kTrailer) {
      if (text.empty()) state_ = State::kDone;
    } else {
      const std::string_view size = trimmed(text.substr(0, std::min(text.find(';'), text.size())));
      if (!parse_number(size, remaining_, 16)) {
        fail("sends a broken chunked stream");
      } else {
        chunk_ = remaining_ == 0 ? Chunk::kTrailer : Chunk::kData;
      }
    }
  }
}

}  // namespace tarsier
