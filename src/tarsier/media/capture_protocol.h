// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

namespace tarsier {

// What `tarsier-capture` writes to its standard output: records of a header and `length` bytes.
// Both ends are the same program on the same machine, so numbers are in the machine's byte order.
struct CaptureRecord {
  enum class Kind : std::uint32_t {
    kFrame = 1,  // rows of CV_8UC3
    kInfo = 2,   // text for people: what was opened
    kError = 3,  // text: why the stream ends; the last record
  };
  static constexpr std::uint32_t kMagic = 0x31504354;  // "TCP1"
  static constexpr std::int64_t kMaxPixels = 100'000'000;
  static constexpr std::uint64_t kMaxText = 64U << 10U;

  std::uint32_t magic = kMagic;
  Kind kind = Kind::kFrame;
  std::int32_t width = 0;    // px
  std::int32_t height = 0;   // px
  std::int32_t type = 0;     // CV_8UC3
  std::uint32_t frames = 0;  // frames captured since the last record, including this one
  std::int64_t time_ns = 0;  // capture time, CLOCK_MONOTONIC
  double fps = 0;            // kInfo: the rate that the device reports
  std::uint64_t length = 0;  // bytes that follow
};
static_assert(sizeof(CaptureRecord) == 48);

// Parses records as they arrive. It trusts no input and keeps only the newest frame. No I/O.
class CaptureParser {
 public:
  // Takes the next bytes. Returns how many new frames they announce (dropped ones included). After
  // an invalid record is_broken() is true and bytes are ignored.
  std::int64_t feed(std::span<const std::uint8_t> bytes);

  [[nodiscard]] bool is_broken() const { return broken_; }
  [[nodiscard]] bool has_frame() const { return !frame_.empty(); }
  [[nodiscard]] cv::Mat take();                                    // the newest frame
  [[nodiscard]] std::int64_t time_ns() const { return time_ns_; }  // of that frame
  [[nodiscard]] const std::string& info() const { return info_; }  // the newest text
  [[nodiscard]] double fps() const { return fps_; }
  [[nodiscard]] const std::string& error() const { return error_; }

 private:
  bool begin_record();
  std::int64_t end_record();

  std::array<std::uint8_t, sizeof(CaptureRecord)> header_bytes_{};
  std::size_t header_size_ = 0;
  CaptureRecord header_;
  std::uint64_t filled_ = 0;
  cv::Mat partial_;
  std::string text_;
  cv::Mat frame_;
  std::int64_t time_ns_ = 0;
  std::string info_;
  double fps_ = 0;
  std::string error_;
  bool broken_ = false;
};

}  // namespace tarsier
