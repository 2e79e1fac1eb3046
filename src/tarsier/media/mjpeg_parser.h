// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace tarsier {

// Finds complete JPEG images in a stream of bytes that comes in pieces of any size:
// multipart/x-mixed-replace as cameras send it, or JPEGs one after the other. The structure of JPEG
// itself (ITU-T T.81, annex B) says where an image begins and ends, so boundaries, part headers
// and Content-Length, which cameras often get wrong, are passed over like any other bytes between
// images, and garbage costs no more than the image it falls into. Thumbnails inside APPn
// segments are not mistaken for images. Pure: no I/O, no clock, no exceptions but std::bad_alloc.
class MjpegParser {
 public:
  static constexpr std::size_t kDefaultFrameLimit = 32U << 20U;

  // An image of more than `frame_limit` bytes (>= 1024) is passed over: that many of its bytes,
  // then the next start is looked for. Memory stays below five times the limit and some pieces of
  // 256 KiB. Each byte costs a bounded number of steps, whatever the stream and its pieces (see
  // work()).
  explicit MjpegParser(std::size_t frame_limit = kDefaultFrameLimit);

  // Takes the next bytes; returns how many images they completed. Only the newest image is
  // kept.
  int feed(std::span<const std::uint8_t> bytes);

  // Whether an image is there that was not taken yet, and that image (empty if there is none).
  [[nodiscard]] bool has_frame() const { return !newest_.empty(); }
  [[nodiscard]] std::vector<std::uint8_t> take();

  // Bytes that belonged to no complete image, part headers included.
  [[nodiscard]] std::uint64_t skipped_bytes() const { return skipped_; }
  // Bytes held, for tests.
  [[nodiscard]] std::size_t held_bytes() const { return buffer_.capacity() + newest_.capacity(); }
  // Bytes looked at, moved or copied, and steps, since the beginning, for tests.
  [[nodiscard]] std::uint64_t work() const { return work_; }

  // Forgets an image begun (the connection was opened again); a complete one stays.
  void reset();

 private:
  enum class Place { kBetween, kMarker, kEntropy };
  enum class Step { kDone, kMoreBytes };

  Step step();
  bool is_too_large();
  [[nodiscard]] std::size_t in_sight() const;  // bytes of the image that are looked at
  Step find_start();
  Step read_marker();
  Step end_image(std::size_t end);
  Step read_entropy();
  void give_up_from(std::size_t resume);
  void let_go();
  std::size_t find_ff(std::size_t from, std::size_t end);

  std::size_t frame_limit_;
  std::vector<std::uint8_t> buffer_;
  std::vector<std::uint8_t> newest_;
  std::size_t begin_ = 0;  // in buffer_: start of the image (or of what may be one)
  std::size_t at_ = 0;     // in buffer_: next byte to look at, >= begin_
  Place place_ = Place::kBetween;
  int segments_ = 0;       // before the first scan
  bool has_size_ = false;  // a start-of-frame segment was seen
  bool has_scan_ = false;
  int completed_ = 0;  // by the present feed()
  std::uint64_t skipped_ = 0;
  std::uint64_t work_ = 0;
};

}  // namespace tarsier
