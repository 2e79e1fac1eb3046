// SPDX-License-Identifier: MIT
#include "tarsier/media/mjpeg_parser.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cstring>
#include <utility>

namespace tarsier {
namespace {

constexpr std::uint8_t kStartOfImage = 0xd8;
constexpr std::uint8_t kEndOfImage = 0xd9;
constexpr std::uint8_t kStartOfScan = 0xda;
constexpr std::size_t kPiece = 256U << 10U;
// Limit before the first scan; cameras write about ten. Data that only looks like an image is
// examined up to this limit, and again from each start inside it.
constexpr int kMaxSegments = 32;

bool is_start_of_frame(std::uint8_t marker) {
  return marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
}

}  // namespace

MjpegParser::MjpegParser(std::size_t frame_limit) : frame_limit_(frame_limit) {
  TARSIER_REQUIRE(frame_limit >= 1024, "{} bytes", frame_limit);
}

int MjpegParser::feed(std::span<const std::uint8_t> bytes) {
  completed_ = 0;
  while (!bytes.empty()) {
    const auto piece = bytes.first(std::min(bytes.size(), kPiece));
    bytes = bytes.subspan(piece.size());
    buffer_.insert(buffer_.end(), piece.begin(), piece.end());
    work_ += piece.size();
    while (step() == Step::kDone || is_too_large()) {
    }
    discard_consumed();
  }
  return completed_;
}

// Drops the bytes before begin_ if they are at least as many as those behind it. So each byte is
// moved once on average, however small the pieces.
void MjpegParser::discard_consumed() {
  const std::size_t left = buffer_.size() - begin_;
  if (begin_ == 0 || begin_ < left) return;
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(begin_));
  work_ += left;
  at_ -= begin_;
  begin_ = 0;
}

MjpegParser::Step MjpegParser::step() {
  ++work_;
  switch (state_) {
    case ParserState::kBetween:
      return find_start();
    case ParserState::kMarker:
      return read_marker();
    case ParserState::kEntropy:
      break;
  }
  return read_entropy();
}

// An image beyond the limit is dropped up to the limit, whatever follows in the buffer, so that the
// result does not depend on how the bytes were split.
bool MjpegParser::is_too_large() {
  if (state_ == ParserState::kBetween || buffer_.size() - begin_ <= frame_limit_) return false;
  restart_at(begin_ + frame_limit_);
  return true;
}

std::size_t MjpegParser::examinable_end() const {
  return std::min(buffer_.size(), begin_ + frame_limit_);
}

std::vector<std::uint8_t> MjpegParser::take() { return std::exchange(newest_, {}); }

void MjpegParser::reset() {
  skipped_ += buffer_.size() - begin_;
  buffer_.clear();
  begin_ = 0;
  at_ = 0;
  state_ = ParserState::kBetween;
}

// There is no image at begin_; search for the next one from `resume`.
void MjpegParser::restart_at(std::size_t resume) {
  skipped_ += resume - begin_;
  begin_ = resume;
  at_ = resume;
  state_ = ParserState::kBetween;
}

// The first byte FF in [from, end); `end` if there is none.
std::size_t MjpegParser::find_ff(std::size_t from, std::size_t end) {
  const void* found = std::memchr(buffer_.data() + from, 0xff, end - from);
  const std::size_t at =
      found == nullptr
          ? end
          : static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - buffer_.data());
  work_ += at - from + 1;
  return at;
}

// FF D8 FF: the start of an image and the first byte of its first segment.
MjpegParser::Step MjpegParser::find_start() {
  std::size_t at = begin_;
  const std::size_t size = buffer_.size();
  while (at < size) {
    at = find_ff(at, size);
    const std::size_t left = size - at;
    if (left >= 2 && buffer_[at + 1] != kStartOfImage) {
      ++at;
      continue;
    }
    if (left >= 3 && buffer_[at + 2] != 0xff) {
      at += 2;
      continue;
    }
    break;  // a start, or its first bytes, or the end
  }
  const bool found = size - at >= 3;
  restart_at(at);
  if (!found) return Step::kMoreBytes;
  at_ = begin_ + 2;
  state_ = ParserState::kMarker;
  segments_ = 0;
  has_size_ = false;
  has_scan_ = false;
  return Step::kDone;
}

// Expects a marker at at_: FF, optional FF fill bytes, its code, and for most markers a length and
// that many bytes. Continues from segment to segment.
MjpegParser::Step MjpegParser::read_marker() {
  const std::size_t size = examinable_end();
  const std::uint8_t* const bytes = buffer_.data();
  // Where to continue if this is not an image.
  const auto reject = [&](std::size_t at) {
    restart_at(has_scan_ ? at : begin_ + 2);
    return Step::kDone;
  };
  while (true) {
    ++work_;
    if (at_ < size && bytes[at_] != 0xff) return reject(at_);
    while (at_ + 1 < size && bytes[at_ + 1] == 0xff) {  // fill bytes are examined only once
      ++at_;
      ++work_;
    }
    if (at_ + 1 >= size) return Step::kMoreBytes;
    const std::size_t at = at_ + 1;
    const std::uint8_t marker = bytes[at];
    if (marker == kStartOfImage) {  // a new image: the old one was truncated
      restart_at(at_);
      return Step::kDone;
    }
    if (marker == kEndOfImage) return end_image(at + 1);
    if (marker < 0xc0 || (marker >= 0xd0 && marker <= 0xd7)) return reject(at);
    if (!has_scan_ && segments_ == kMaxSegments) return reject(at);
    if (size - at < 3) return Step::kMoreBytes;
    const std::size_t length = (static_cast<std::size_t>(bytes[at + 1]) << 8U) | bytes[at + 2];
    if (length < 2 || (marker == kStartOfScan && !has_size_)) return reject(at);
    if (size - at - 1 < length) return Step::kMoreBytes;
    ++segments_;
    if (is_start_of_frame(marker)) has_size_ = true;
    at_ = at + 1 + length;
    if (marker == kStartOfScan) {
      has_scan_ = true;
      state_ = ParserState::kEntropy;
      return Step::kDone;
    }
  }
}

MjpegParser::Step MjpegParser::end_image(std::size_t end) {
  if (!has_size_ || !has_scan_) {
    restart_at(end);
    return Step::kDone;
  }
  newest_.assign(buffer_.begin() + static_cast<std::ptrdiff_t>(begin_),
                 buffer_.begin() + static_cast<std::ptrdiff_t>(end));
  work_ += newest_.size();
  ++completed_;
  begin_ = end;
  at_ = end;
  state_ = ParserState::kBetween;
  return Step::kDone;
}

// Coded data ends at an FF that is followed by neither 00 (a data byte FF) nor a restart marker.
MjpegParser::Step MjpegParser::read_entropy() {
  const std::size_t size = examinable_end();
  while (at_ < size) {
    at_ = find_ff(at_, size);
    if (at_ + 1 >= size) return Step::kMoreBytes;
    const std::uint8_t next = buffer_[at_ + 1];
    if (next == 0x00 || (next >= 0xd0 && next <= 0xd7)) {
      at_ += 2;
      continue;
    }
    state_ = ParserState::kMarker;
    return Step::kDone;
  }
  return Step::kMoreBytes;
}

}  // namespace tarsier
