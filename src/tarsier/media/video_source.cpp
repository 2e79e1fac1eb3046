// SPDX-License-Identifier: MIT
#include "tarsier/media/video_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/lazy_opencv.h"

#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>

#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <string_view>
#include <utility>

namespace tarsier {
namespace {

constexpr double kMaxPixels = 100e6;

// OpenCV prints errors of corrupt files to stderr; here they become one exception.
class QuietOpenCv {
 public:
  QuietOpenCv() : before_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~QuietOpenCv() { cv::utils::logging::setLogLevel(before_); }
  QuietOpenCv(const QuietOpenCv&) = delete;
  QuietOpenCv& operator=(const QuietOpenCv&) = delete;

 private:
  cv::utils::logging::LogLevel before_;
};

double sane_fps(double fps) {
  // 0 and NaN: unknown; 90000 and similar: a time base instead of a rate.
  return std::isfinite(fps) && fps >= 0.01 && fps <= 1000 ? fps : 25;
}

// FFmpeg takes the start of "12:30.avi" for a protocol.
std::string path_to_open(const std::string& path) {
  return path.starts_with('/') || path.starts_with('.') ? path : "./" + path;
}

class VideoSource final : public FrameSource {
 public:
  explicit VideoSource(std::string path) : path_(std::move(path)) {
    const QuietOpenCv quiet;
    // An OpenCV built without FFmpeg still reads MJPEG in AVI.
    open(lazy_opencv::has_backend(cv::CAP_FFMPEG) ? cv::CAP_FFMPEG : cv::CAP_OPENCV_MJPEG);
    if (pending_.empty()) throw InputError(path_, "no frame of this video can be decoded");
    fps_ = sane_fps(capture_->get(cv::CAP_PROP_FPS));
    const double count = capture_->get(cv::CAP_PROP_FRAME_COUNT);
    if (std::isfinite(count) && count >= 1 && count < 1e9)
      count_ = static_cast<std::int64_t>(count);
  }

  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token& stop) override {
    if (ended_ || stop.stop_requested()) return std::nullopt;
    Frame frame;
    if (!pending_.empty()) {
      frame.image = std::exchange(pending_, cv::Mat());
    } else {
      const QuietOpenCv quiet;
      frame.image = read();
    }
    if (frame.image.empty()) {
      ended_ = true;
      if (count_ > 0 && index_ < count_ - count_ / 10 - 2) {
        log_warning("{}: ends after {} of {} frames", path_, index_, count_);
      }
      return std::nullopt;
    }
    frame.index = index_++;
    frame.time = time_;
    frame.name = path_;
    frame.captured = std::chrono::steady_clock::now();
    return frame;
  }

  [[nodiscard]] bool ended() const override { return ended_; }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status;
    status.state = ended_ ? SourceState::kEnded : SourceState::kLive;
    status.detail = detail_;
    status.received = index_;
    return status;
  }
  [[nodiscard]] double fps() const override { return fps_; }
  [[nodiscard]] std::int64_t count() const override { return count_; }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  // Opens the file and reads the first frame: many corrupt files can be opened.
  void open(int backend) {
    try {
      if (!capture_->open(path_to_open(path_), backend)) return;
      const double width = capture_->get(cv::CAP_PROP_FRAME_WIDTH);
      const double height = capture_->get(cv::CAP_PROP_FRAME_HEIGHT);
      if (width * height > kMaxPixels) {
        throw InputError(
            path_, fmt::format("{:.0f}x{:.0f} pixels are more than the limit of 100 million", width,
                               height));
      }
      pending_ = read();
      if (!pending_.empty()) detail_ = fmt::format("{}x{} video", pending_.cols, pending_.rows);
    } catch (const cv::Exception&) {
      capture_->release();
    }
  }

  cv::Mat read() {
    cv::Mat image;  // a new one each time: the caller keeps it
    try {
      if (!capture_->read(image) || image.empty()) return {};
      if (image.type() == CV_8UC1) cv::cvtColor(image, image, cv::COLOR_GRAY2BGR);
      if (image.type() == CV_8UC4) cv::cvtColor(image, image, cv::COLOR_BGRA2BGR);
    } catch (const cv::Exception& error) {
      log_warning("{}: {}", path_, error.err);
      return {};
    }
    if (image.type() != CV_8UC3) return {};
    const double stated = capture_->get(cv::CAP_PROP_POS_MSEC) / 1000;
    const bool is_first = !read_any_;
    read_any_ = true;
    // Files without time stamps report 0 or decreasing times; then the frame rate is used.
    if (is_first) {
      first_stated_ = std::isfinite(stated) ? stated : 0;
      time_ = 0;
    } else {
      const double time = stated - first_stated_;
      const bool is_usable = std::isfinite(time) && time > time_ && time < 1e7;
      time_ = is_usable ? time : time_ + 1 / sane_fps(capture_->get(cv::CAP_PROP_FPS));
    }
    return image;
  }

  const std::string path_;
  std::unique_ptr<cv::VideoCapture> capture_ = lazy_opencv::make_video_capture();
  cv::Mat pending_;
  double fps_ = 25;
  std::int64_t count_ = 0;
  std::int64_t index_ = 0;
  double time_ = 0;
  double first_stated_ = 0;
  bool read_any_ = false;
  bool ended_ = false;
  std::string detail_ = "video";
  const std::vector<std::string> skipped_;
};

}  // namespace

bool looks_like_video(std::span<const std::uint8_t> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const auto has = [&](std::size_t at, std::string_view magic) {
    return text.size() >= at + magic.size() && text.substr(at, magic.size()) == magic;
  };
  if (has(0, "RIFF") && (has(8, "AVI ") || has(8, "AVIX"))) return true;
  for (const std::string_view atom : {"ftyp", "moov", "mdat", "wide", "free", "skip", "pnot"}) {
    if (has(4, atom)) return true;
  }
  static constexpr std::array<std::string_view, 9> kMagics = {
      "\x1a\x45\xdf\xa3",                       // Matroska, WebM
      std::string_view("\x00\x00\x01\xba", 4),  // MPEG program stream
      std::string_view("\x00\x00\x01\xb3", 4),  // MPEG video
      "FLV",
      "OggS",
      "\x30\x26\xb2\x75",  // ASF
      "YUV4MPEG2",
      "\xff\xd8\xff",  // consecutive JPEGs
      "GIF8",
  };
  for (const std::string_view magic : kMagics) {
    if (has(0, magic)) return true;
  }
  if (has(0, std::string_view("\x00\x00\x00\x01", 4)) ||
      has(0, std::string_view("\x00\x00\x01", 3))) {
    return true;  // H.264, H.265, MPEG-4 byte streams
  }
  const auto is_sync = [&](std::size_t at) { return at < bytes.size() && bytes[at] == 0x47; };
  return (is_sync(0) && is_sync(188)) || (is_sync(4) && is_sync(196));  // MPEG transport stream
}

std::unique_ptr<FrameSource> make_video_source(const std::string& path, const SourceOptions&) {
  return std::make_unique<VideoSource>(path);
}

}  // namespace tarsier
