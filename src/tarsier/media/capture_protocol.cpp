// SPDX-License-Identifier: MIT
#include "tarsier/media/capture_protocol.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <utility>

namespace tarsier {

cv::Mat CaptureParser::take() { return std::exchange(frame_, cv::Mat()); }

bool CaptureParser::begin_record() {
  std::memcpy(&header_, header_bytes_.data(), sizeof header_);
  header_size_ = 0;
  filled_ = 0;
  if (header_.magic != CaptureRecord::kMagic) return false;
  if (header_.kind == CaptureRecord::Kind::kFrame) {
    const std::int64_t pixels = static_cast<std::int64_t>(header_.width) * header_.height;
    if (header_.width < 1 || header_.height < 1 || pixels > CaptureRecord::kMaxPixels ||
        header_.type != CV_8UC3 || header_.length != static_cast<std::uint64_t>(pixels) * 3) {
      return false;
    }
    partial_.create(header_.height, header_.width, CV_8UC3);
    return true;
  }
  if (header_.kind != CaptureRecord::Kind::kInfo && header_.kind != CaptureRecord::Kind::kError) {
    return false;
  }
  if (header_.length == 0 || header_.length > CaptureRecord::kMaxText) return false;
  text_.assign(static_cast<std::size_t>(header_.length), '\0');
  return true;
}

std::int64_t CaptureParser::end_record() {
  const bool is_frame = header_.kind == CaptureRecord::Kind::kFrame;
  if (is_frame) {
    frame_ = std::exchange(partial_, cv::Mat());
    time_ns_ = header_.time_ns;
  } else if (header_.kind == CaptureRecord::Kind::kInfo) {
    info_ = text_;
    fps_ = std::isfinite(header_.fps) && header_.fps > 0 && header_.fps <= 1000 ? header_.fps : 0;
  } else {
    error_ = text_;
  }
  const std::int64_t frames = is_frame ? std::max<std::int64_t>(1, header_.frames) : 0;
  header_ = {};
  return frames;
}

std::int64_t CaptureParser::feed(std::span<const std::uint8_t> bytes) {
  std::int64_t frames = 0;
  while (!bytes.empty() && !broken_) {
    if (header_.length == 0) {
      const std::size_t part = std::min(bytes.size(), header_bytes_.size() - header_size_);
      std::memcpy(header_bytes_.data() + header_size_, bytes.data(), part);
      header_size_ += part;
      bytes = bytes.subspan(part);
      if (header_size_ == header_bytes_.size() && !begin_record()) broken_ = true;
      continue;
    }
    const auto part =
        static_cast<std::size_t>(std::min<std::uint64_t>(bytes.size(), header_.length - filled_));
    auto* target = header_.kind == CaptureRecord::Kind::kFrame
                       ? partial_.data
                       : reinterpret_cast<std::uint8_t*>(text_.data());
    std::memcpy(target + filled_, bytes.data(), part);
    filled_ += part;
    bytes = bytes.subspan(part);
    if (filled_ == header_.length) frames += end_record();
  }
  return frames;
}

}  // namespace tarsier
