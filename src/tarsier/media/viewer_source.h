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

// Images that another program of this machine provides, for example a server that forwards the
// camera of a visitor of its page. Each record is a length (32 bits, big-endian) and that many
// bytes of a JPEG. Records arrive through an inherited file descriptor.

// Parses records as they arrive. It trusts no input and keeps only the newest image. No I/O.
class ViewerParser {
 public:
  static constexpr std::size_t kMaxBytes = 16U << 20U;  // of one image

  // Takes the next bytes; returns how many records they completed. After a length of 0 or above
  // kMaxBytes is_broken() is true and bytes are ignored.
  std::int64_t feed(std::span<const std::uint8_t> bytes);

  [[nodiscard]] bool is_broken() const { return broken_; }
  [[nodiscard]] bool has_image() const { return !newest_.empty(); }
  // The bytes of the newest record, unchecked; empty if there is none.
  [[nodiscard]] std::vector<std::uint8_t> take();
  // Bytes of memory held, for tests: at most about two images, and never more than twice the
  // received bytes.
  [[nodiscard]] std::size_t held_bytes() const { return partial_.capacity() + newest_.capacity(); }

 private:
  std::array<std::uint8_t, 4> length_bytes_{};
  std::size_t length_size_ = 0;
  std::size_t length_ = 0;
  std::vector<std::uint8_t> partial_;
  std::vector<std::uint8_t> newest_;
  bool broken_ = false;
};

// The error in a record: not a JPEG, truncated, too many pixels. Empty if none is found without
// decoding.
[[nodiscard]] std::string viewer_image_error(std::span<const std::uint8_t> bytes);

// One connection over `fd`, which the backend closes. Invalid images are skipped, with a warning at
// most once a second. The end of the records is the end of the source.
[[nodiscard]] std::unique_ptr<LiveBackend> make_viewer_backend(int fd, const std::string& label);

// "viewer:NAME": a live source that reads the file descriptor in the environment variable
// TARSIER_VIEWER. It is opened once and never reopened: a silent source is stale until it sends
// again, and its end is the end of the source. Throws InputError if TARSIER_VIEWER is not set, is
// not an open descriptor, or was opened before; and for a NAME that is empty, longer than 64 bytes
// or has other characters than A-Z a-z 0-9 _ -.
[[nodiscard]] Scheme viewer_scheme();

}  // namespace tarsier
