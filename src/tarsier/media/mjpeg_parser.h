// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace tarsier {

// Finds complete JPEG images in a stream of bytes that arrives in pieces of any size:
// multipart/x-mixed-replace as cameras send it, or consecutive JPEGs. The structure of JPEG itself
// (ITU-T T.81, annex B) determines where an image begins and ends. Boundaries, part headers and
// Content-Length, which cameras often get wrong, are skipped like any other bytes between images.
// Garbage destroys only the image in which it occurs. Thumbnails inside APPn segments are not
// mistaken for images. No I/O, no clock, no exceptions except std::bad_alloc.
class MjpegParser {
 public:
  static constexpr std::size_t kDefaultFrameLimit = 32U << 20U;

  // An image of more than `frame_limit` bytes (>= 1024) is skipped: the parser drops that many
  // bytes and searches for the next start. Memory stays below five times the limit plus some pieces
  // of 256 KiB. Each byte costs a bounded number of steps for any stream (see work()).
  explicit MjpegParser(std::size_t frame_limit = kDefaultFrameLimit);

  // Takes the next bytes; returns how many images they completed. Only the newest image is kept.
  int feed(std::span<const std::uint8_t> bytes);

  // Whether there is an image that was not taken yet, and that image (empty if there is none).
  [[nodiscard]] bool has_frame() const { return !newest_.empty(); }
  [[nodiscard]] std::vector<std::uint8_t> take();

  // Bytes outside complete images, part headers included.
  [[nodiscard]] std::uint64_t skipped_bytes() const { return skipped_; }
  // Bytes of memory held; for tests.
  [[nodiscard]] std::size_t held_bytes() const { return buffer_.capacity() + newest_.capacity(); }
  // Bytes read, moved or copied, plus steps, since the beginning; for tests.
  [[nodiscard]] std::uint64_t work() const { return work_; }

  // Drops a partial image (the connection was reopened); a complete one stays.
  void reset();

 private:
  enum class ParserState { kBetween, kMarker, kEntropy };
  enum class Step { kDone, kMoreBytes };

  Step step();
  bool is_too_large();
  [[nodiscard]] std::size_t examinable_end() const;  // bytes of the image that may be examined
  Step find_start();
  Step read_marker();
  Step end_image(std::size_t end);
  Step read_entropy();
  void restart_at(std::size_t resume);
  void discard_consumed();
  std::size_t find_ff(std::size_t from, std::size_t end);

  std::size_t frame_limit_;
  std::vector<std::uint8_t> buffer_;
  std::vector<std::uint8_t> newest_;
  std::size_t begin_ = 0;  // in buffer_: start of the image, or of a possible image
  std::size_t at_ = 0;     // in buffer_: next byte to examine, >= begin_
  ParserState state_ = ParserState::kBetween;
  int segments_ = 0;       // before the first scan
  bool has_size_ = false;  // a start-of-frame segment was seen
  bool has_scan_ = false;
  int completed_ = 0;  // by the current feed()
  std::uint64_t skipped_ = 0;
  std::uint64_t work_ = 0;
};

}  // namespace tarsier
