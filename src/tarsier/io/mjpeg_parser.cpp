// SPDX-License-Identifier: MIT
#include "tarsier/io/mjpeg_parser.h"

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
// More than any camera writes; keeps a hostile stream of tiny segments from costing quadratic time.
constexpr int kMaxSegments = 1024;

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
    while (step() == Step::kDone || is_too_large()) {
    }
  }
  return completed_;
}

MjpegParser::Step MjpegParser::step() {
  switch (place_) {
    case Place::kBetween:
      return find_start();
    case Place::kMarker:
      return read_marker();
    case Place::kEntropy:
      break;
  }
  return read_entropy();
}

// A picture that goes on beyond the limit is dropped up to there, whatever follows in the buffer:
// what is found does not depend on the pieces in which the bytes came.
bool MjpegParser::is_too_large() {
  if (place_ == Place::kBetween || buffer_.size() <= frame_limit_) return false;
  give_up_from(frame_limit_);
  return true;
}

std::size_t MjpegParser::in_sight() const { return std::min(buffer_.size(), frame_limit_); }

std::vector<std::uint8_t> MjpegParser::take() { return std::exchange(newest_, {}); }

void MjpegParser::reset() {
  skipped_ += buffer_.size();
  buffer_.clear();
  at_ = 0;
  place_ = Place::kBetween;
}

// What began at the front of the buffer is no picture; look for the next one from `resume` on.
void MjpegParser::give_up_from(std::size_t resume) {
  skipped_ += resume;
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(resume));
  at_ = 0;
  place_ = Place::kBetween;
}

// FF D8 FF: the start of a picture and the first byte of its first segment.
MjpegParser::Step MjpegParser::find_start() {
  std::size_t at = 0;
  while (at < buffer_.size()) {
    const void* found = std::memchr(buffer_.data() + at, 0xff, buffer_.size() - at);
    if (found == nullptr) {
      at = buffer_.size();
      break;
    }
    at = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - buffer_.data());
    const std::size_t left = buffer_.size() - at;
    if (left >= 2 && buffer_[at + 1] != kStartOfImage) {
      ++at;
      continue;
    }
    if (left >= 3 && buffer_[at + 2] != 0xff) {
      at += 2;
      continue;
    }
    break;  // a start, or the beginning of one
  }
  const bool found = buffer_.size() - at >= 3;
  give_up_from(at);
  if (!found) return Step::kMoreBytes;
  at_ = 2;
  place_ = Place::kMarker;
  segments_ = 0;
  has_size_ = false;
  has_scan_ = false;
  return Step::kDone;
}

// At at_ a marker must stand: FF, perhaps more FF as filling, its code, and for most a length and
// that many bytes.
MjpegParser::Step MjpegParser::read_marker() {
  std::size_t at = at_;
  const std::size_t size = in_sight();
  if (at < size && buffer_[at] != 0xff) {
    give_up_from(has_scan_ ? at : 2);
    return Step::kDone;
  }
  while (at < size && buffer_[at] == 0xff) ++at;
  if (at == size) return Step::kMoreBytes;
  const std::uint8_t marker = buffer_[at];
  if (marker == kStartOfImage) {  // a new picture: the old one was cut short
    give_up_from(at - 1);
    return Step::kDone;
  }
  if (marker == kEndOfImage) {
    const std::size_t end = at + 1;
    if (!has_size_ || !has_scan_) {
      give_up_from(end);
      return Step::kDone;
    }
    newest_.assign(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(end));
    ++completed_;
    buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(end));
    at_ = 0;
    place_ = Place::kBetween;
    return Step::kDone;
  }
  if (marker < 0xc0 || (marker >= 0xd0 && marker <= 0xd7) || ++segments_ > kMaxSegments) {
    give_up_from(has_scan_ ? at : 2);
    return Step::kDone;
  }
  if (size - at < 3) {
    --segments_;  // it is looked at again
    return Step::kMoreBytes;
  }
  const std::size_t length = (static_cast<std::size_t>(buffer_[at + 1]) << 8U) | buffer_[at + 2];
  if (length < 2 || (marker == kStartOfScan && !has_size_)) {
    give_up_from(has_scan_ ? at : 2);
    return Step::kDone;
  }
  if (size - at - 1 < length) {
    --segments_;
    return Step::kMoreBytes;
  }
  if (is_start_of_frame(marker)) has_size_ = true;
  at_ = at + 1 + length;
  if (marker == kStartOfScan) {
    has_scan_ = true;
    place_ = Place::kEntropy;
  }
  return Step::kDone;
}

// Coded data ends at an FF that is followed by neither 00 (a data byte FF) nor a restart marker.
MjpegParser::Step MjpegParser::read_entropy() {
  const std::size_t size = in_sight();
  while (at_ < size) {
    const void* found = std::memchr(buffer_.data() + at_, 0xff, size - at_);
    if (found == nullptr) {
      at_ = size;
      return Step::kMoreBytes;
    }
    at_ = static_cast<std::size_t>(static_cast<const std::uint8_t*>(found) - buffer_.data());
    if (at_ + 1 == size) return Step::kMoreBytes;
    const std::uint8_t next = buffer_[at_ + 1];
    if (next == 0x00 || (next >= 0xd0 && next <= 0xd7)) {
      at_ += 2;
      continue;
    }
    place_ = Place::kMarker;
    return Step::kDone;
  }
  return Step::kMoreBytes;
}

}  // namespace tarsier
