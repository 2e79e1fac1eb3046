// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Parsing of HTTP addresses and responses. Nothing here uses the network.
namespace tarsier {

struct HttpUrl {
  std::string host;  // without the brackets of an IPv6 address
  std::uint16_t port = 80;
  std::string target;  // path and query, starts with '/'
  std::string user;    // percent-decoded
  std::string password;
  // "host", or "host:port" if the port is not the default of the scheme.
  [[nodiscard]] std::string host_header(std::uint16_t default_port = 80) const;
};

// Parses "scheme://[user[:password]@]host[:port][/path][?query]" for the given scheme (not case
// sensitive). Throws InputError with the masked URL if the text is not valid: spaces, control
// characters, no host, a port outside 1..65535.
[[nodiscard]] HttpUrl parse_url(std::string_view text, std::string_view scheme,
                                std::uint16_t default_port);

// Parses an HTTP/1.x response incrementally: status line, header, and the body with chunked coding
// removed. No I/O.
class HttpResponseParser {
 public:
  static constexpr std::size_t kHeaderLimit = 64U << 10U;
  static constexpr int kMaxInterim = 16;  // responses of status 1xx before the final one

  enum class State { kHeader, kBody, kDone, kBroken };

  // Takes bytes; appends bytes of the body to `body`.
  void feed(std::span<const std::uint8_t> bytes, std::vector<std::uint8_t>& body);

  [[nodiscard]] State state() const { return state_; }
  [[nodiscard]] const std::string& error_message() const {
    return error_message_;
  }  // the reason of kBroken
  // Valid after the header:
  [[nodiscard]] int status() const { return status_; }
  [[nodiscard]] const std::string& status_text() const { return status_text_; }
  [[nodiscard]] const std::string& content_type() const { return content_type_; }  // as sent
  [[nodiscard]] const std::string& location() const { return location_; }

 private:
  enum class Chunk { kSize, kData, kDataEnd, kTrailer };

  void fail(std::string reason);
  std::size_t read_header(std::span<const std::uint8_t> bytes);
  bool parse_header();
  void read_body(std::span<const std::uint8_t> bytes, std::vector<std::uint8_t>& body);
  void read_chunks(std::span<const std::uint8_t> bytes, std::vector<std::uint8_t>& body);

  State state_ = State::kHeader;
  std::string error_message_;
  std::string header_;
  int interim_ = 0;
  int status_ = 0;
  std::string status_text_;
  std::string content_type_;
  std::string location_;
  bool chunked_ = false;
  bool has_length_ = false;
  std::uint64_t remaining_ = 0;  // remaining bytes of the body (has_length_) or of the chunk
  Chunk chunk_ = Chunk::kSize;
  std::string line_;
};

}  // namespace tarsier
