// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"
#include "tarsier/media/live_source.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

namespace tarsier {

// Images that another program of this machine hands over, as a server does with the camera of
// someone who looks at its page: records of a length (32 bits, big-endian) and so many bytes of a
// JPEG, through an inherited file descriptor.

// Reads records as they come, trusting nothing. Only the newest image is kept. Pure.
class ViewerParser {
 public:
  static constexpr std::size_t kMaxBytes = 16U << 20U;  // of one image

  // Takes the next bytes; returns how many records they completed. After a length of 0 or beyond
  // kMaxBytes is_broken(), and bytes are ignored.
  std::int64_t feed(std::span<const std::uint8_t> bytes);

  [[nodiscard]] bool is_broken() const { return broken_; }
  [[nodiscard]] bool has_image() const { return !newest_.empty(); }
  // The newest record's bytes, whatever they are; empty if there is none.
  [[nodiscard]] std::vector<std::uint8_t> take();
  // Bytes held, for tests: at most about two images, and never more than twice what came.
  [[nodiscard]] std::size_t held_bytes() const { return partial_.capacity() + newest_.capacity(); }

 private:
  std::array<std::uint8_t, 4> length_bytes_{};
  std::size_t length_size_ = 0;
  std::size_t length_ = 0;
  std::vector<std::uint8_t> partial_;
  std::vector<std::uint8_t> newest_;
  bool broken_ = false;
};

// What is wrong with a record: no JPEG, cut short, too many pixels; empty if nothing is seen
// without decoding.
[[nodiscard]] std::string trouble_of_viewer_image(std::span<const std::uint8_t> bytes);

// One connection over `fd`, which it closes. Images that are none are passed over, with a warning
// once a second at most; the end of the records is the end of the source.
[[nodiscard]] std::unique_ptr<LiveBackend> make_viewer_backend(int fd, const std::string& label);

// "viewer:NAME": a live source that reads the file descriptor that the environment's TARSIER_VIEWER
// names. It is opened once and never again: a silent one is stale until it speaks, its end is the
// end of the source. Throws InputError: TARSIER_VIEWER is not set, names no open descriptor, or was
// opened before; a NAME that is empty, longer than 64 bytes or of other letters than A-Z a-z 0-9 _ -.
[[nodiscard]] Scheme viewer_scheme();

}  // namespace tarsier
