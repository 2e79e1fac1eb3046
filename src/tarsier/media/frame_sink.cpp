// SPDX-License-Identifier: MIT
#include "tarsier/media/frame_sink.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/http_sink.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/part_file.h"
#include "tarsier/media/video_encoder.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <optional>
#include <set>
#include <sys/statvfs.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

void require_writable_image(const cv::Mat& image) {
  TARSIER_REQUIRE(
      image.dims == 2 && !image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
      "{}x{}, type {}: sinks take 8-bit grey or BGR", image.cols, image.rows, image.type());
}

bool is_video_extension(const std::string& ending) {
  return ending == ".mp4" || ending == ".avi" || ending == ".mkv";
}

class NoSink final : public FrameSink {
 public:
  std::string write(const cv::Mat& image, const Frame&) override {
    require_writable_image(image);
    return {};
  }
  void finish() override {}
  [[nodiscard]] std::string description() const override { return "none"; }
};

class ImageSink final : public FrameSink {
 public:
  ImageSink(std::string path, const SinkOptions& options)
      : path_(std::move(path)), options_(options) {
    if (options.many) {
      throw UsageError(path_ +
                       ": one file cannot hold several images: name a folder (ending in '/')");
    }
    // Detects an error now, not after the work.
    const AtomicFile probe(path_);
  }

  std::string write(const cv::Mat& image, const Frame&) override {
    require_writable_image(image);
    if (written_) {
      throw UsageError(path_ +
                       ": one file cannot hold several images: name a folder (ending in '/')");
    }
    // A device or pipe has no extension that could name a format.
    const std::string ending = is_image_path(path_) ? lowercase_extension(path_) : ".png";
    const std::vector<std::uint8_t> bytes =
        encode_image(ending, image, path_, options_.jpeg_quality);
    write_file_atomically(path_, std::span<const std::uint8_t>(bytes));
    written_ = true;
    return path_;
  }
  void finish() override {}
  [[nodiscard]] std::string description() const override { return path_; }

 private:
  std::string path_;
  SinkOptions options_;
  bool written_ = false;
};

class FolderSink final : public FrameSink {
 public:
  FolderSink(std::string path, SinkOptions options)
      : path_(std::move(path)), options_(std::move(options)) {
    make_folder(path_);
    if (::access(path_.c_str(), W_OK | X_OK) != 0) {
      throw OutputError(path_, "cannot write into this folder: " + errno_text(errno));
    }
    if (!options_.inputs) return;
    for (const std::string& input : options_.inputs->paths())
      refuse_to_replace(fs::path(path_) / still_name(input));
  }

  std::string write(const cv::Mat& image, const Frame& source) override {
    require_writable_image(image);
    std::string target = (fs::path(path_) / unused_name(source)).string();
    refuse_to_replace(target, source.still ? source.name : "");
    write_image(target, image, options_.jpeg_quality);
    ++count_;
    return target;
  }
  void finish() override {}
  [[nodiscard]] std::string description() const override {
    return fmt::format("{} ({} {})", path_, count_, count_ == 1 ? "image" : "images");
  }

 private:
  void refuse_to_replace(const fs::path& target, const std::string& source = {}) const {
    std::error_code ignored;
    if (fs::equivalent(target, source, ignored) ||
        (options_.inputs && options_.inputs->contains(target.string()))) {
      throw UsageError(target.string() +
                       ": is an input and would be replaced; name another folder");
    }
  }

  // The output's name for an image of this path.
  [[nodiscard]] fs::path still_name(const fs::path& source) const {
    std::string stem = source.stem().string().substr(0, 180);  // names end at 255 bytes
    if (stem.empty()) stem = "image";
    std::string ending = options_.folder_extension;
    if (ending.empty() && is_image_path(source.string())) ending = source.extension().string();
    return stem + (ending.empty() ? ".png" : ending);
  }
  [[nodiscard]] fs::path video_frame_name(std::int64_t index) const {
    const std::string& ending = options_.folder_extension;
    return fmt::format("frame_{:06d}{}", index, ending.empty() ? ".png" : ending);
  }

  // A number is added if two sources have the same name.
  std::string unused_name(const Frame& source) {
    const fs::path wanted = source.still ? still_name(source.name) : video_frame_name(source.index);
    std::string name = wanted.string();
    for (int number = 2; !used_.insert(name).second; ++number) {
      name = fmt::format("{}-{}{}", wanted.stem().string(), number, wanted.extension().string());
    }
    return name;
  }

  std::string path_;
  SinkOptions options_;
  std::set<std::string> used_;
  std::int64_t count_ = 0;
};

// `image` as BGR in `size`, with its aspect ratio kept and black borders.
cv::Mat fitted(const cv::Mat& image, cv::Size size) {
  cv::Mat color = image;
  if (image.channels() == 1) cv::cvtColor(image, color, cv::COLOR_GRAY2BGR);
  if (color.size() == size) return color;
  const double scale = std::min(static_cast<double>(size.width) / color.cols,
                                static_cast<double>(size.height) / color.rows);
  const cv::Size inner(
      std::clamp(static_cast<int>(std::lround(color.cols * scale)), 1, size.width),
      std::clamp(static_cast<int>(std::lround(color.rows * scale)), 1, size.height));
  cv::Mat result(size, CV_8UC3, cv::Scalar(0, 0, 0));
  cv::Mat place = result(cv::Rect((size.width - inner.width) / 2, (size.height - inner.height) / 2,
                                  inner.width, inner.height));
  cv::resize(color, place, inner, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
  return result;
}

// The k-th file of a video in segments.
std::string segment_name(const std::string& path, int number) {
  const fs::path file(path);
  return (file.parent_path() /
          fmt::format("{}-{:04d}{}", file.stem().string(), number, file.extension().string()))
      .string();
}

// One more than the highest number of an existing segment, finished or not, so that no file of an
// earlier run is overwritten.
int first_unused_segment(const std::string& path) {
  const fs::path file(path);
  const std::string stem = file.stem().string() + "-";
  const fs::path folder = file.parent_path().empty() ? fs::path(".") : file.parent_path();
  int highest = 0;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const std::string name = entry->path().filename().string();
    if (!name.starts_with(stem) || !name.ends_with(file.extension().string())) continue;
    int number = 0;
    const auto [stop, bad] =
        std::from_chars(name.data() + stem.size(), name.data() + name.size(), number);
    if (bad == std::errc() && *stop == '.') highest = std::max(highest, number);
  }
  return highest + 1;
}

class VideoSink final : public FrameSink {
 public:
  VideoSink(std::string path, SinkOptions options)
      : path_(std::move(path)), ending_(lowercase_extension(path_)), options_(std::move(options)) {
    if (options_.segment_s > 0) {
      segment_ = first_unused_segment(path_);
      segment_frames_ = std::max<std::int64_t>(1, std::llround(options_.segment_s * options_.fps));
    }
    begin_file();  // detects an error now, not after the work
  }

  ~VideoSink() override {
    if (!part_ || written_ == 0) return;  // an atomic file is discarded
    try {
      if (encoder_) encoder_->finish();
    } catch (const Error&) {  // it can be played up to there
    }
    log_warning("{}: what was recorded is kept in {}", target_, part_->path());
  }

  std::string write(const cv::Mat& image, const Frame&) override {
    require_writable_image(image);
    TARSIER_REQUIRE(!finished_, "{} is finished", path_);
    if (segment_frames_ > 0 && written_ == segment_frames_) {
      end_file();
      log_info("{}: {} frames", target_, written_);
      ++segment_;
      begin_file();
    }
    check_disk();
    if (!encoder_) open(image.size());
    cv::Mat frame = fitted(image, image_);
    if (coded_ != image_) {
      // The codecs halve the colour planes: an odd side would lose its last line.
      cv::copyMakeBorder(frame, frame, 0, coded_.height - image_.height, 0,
                         coded_.width - image_.width, cv::BORDER_REPLICATE);
    }
    encoder_->write(frame);
    ++written_;
    ++count_;
    return {};
  }

  void finish() override {
    if (finished_) return;
    finished_ = true;
    if (count_ == 0) log_warning("{}: no frame was received, no video is written", path_);
    end_file();
  }

  [[nodiscard]] std::string description() const override {
    return fmt::format("{} ({} {})", path_, count_, count_ == 1 ? "frame" : "frames");
  }

 private:
  void begin_file() {
    target_ = segment_frames_ > 0 ? segment_name(path_, segment_) : path_;
    written_ = 0;
    if (options_.recording) {
      part_.emplace(target_);
      return;
    }
    file_.emplace(target_);
    std::error_code ignored;
    if (!fs::is_regular_file(file_->path(), ignored))
      throw OutputError(path_, "a video needs a regular file");
  }

  void end_file() {
    if (written_ > 0) {
      const std::unique_ptr<VideoEncoder> encoder = std::move(encoder_);
      encoder->finish();
      if (part_) part_->commit();
      if (file_) file_->commit();
    }
    part_.reset();
    file_.reset();
  }

  void open(cv::Size size) {
    if (count_ == 0) {
      image_ = size;
      coded_ = {(size.width + 1) / 2 * 2, (size.height + 1) / 2 * 2};
    }
    VideoEncoderOptions options;
    options.extension = ending_;
    options.fps = options_.fps;
    options.crash_safe = options_.recording;
    encoder_ = std::make_unique<VideoEncoder>(part_ ? part_->path() : file_->path(), target_,
                                              coded_, options);
  }

  // Checked early, so that hours of work are not spent on a video that cannot be stored.
  void check_disk() const {
    constexpr std::uint64_t kMinFreeBytes = 1 << 20U;
    struct ::statvfs disk {};
    const std::string& file = part_ ? part_->path() : file_->path();
    if (::statvfs(file.c_str(), &disk) != 0) return;
    if (std::uint64_t{disk.f_bavail} * disk.f_frsize < kMinFreeBytes)
      throw OutputError(path_, "the disk is full");
  }

  std::string path_;  // as given
  std::string ending_;
  SinkOptions options_;
  std::string target_;              // of the current file
  std::optional<AtomicFile> file_;  // for a video that can be made again
  std::optional<PartFile> part_;    // for a recording
  std::unique_ptr<VideoEncoder> encoder_;
  int segment_ = 0;
  std::int64_t segment_frames_ = 0;  // 0: one file
  cv::Size image_;                   // of the first frame
  cv::Size coded_;                   // rounded up to even numbers
  std::int64_t written_ = 0;         // into the current file
  std::int64_t count_ = 0;
  bool finished_ = false;
};

}  // namespace

void SinkOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(folder_extension.empty() || (folder_extension.find('/') == std::string::npos &&
                                               is_image_path("x" + folder_extension)),
                  "'{}' is not an ending of image files", folder_extension);
}

SinkKind classify_sink(const std::string& text) {
  if (text.empty())
    throw UsageError("an empty output: name a file, a folder, http://127.0.0.1:8080/ or none");
  if (text == "none") return SinkKind::kNone;
  if (text.rfind("http://", 0) == 0) return SinkKind::kHttp;
  if (text.find("://") != std::string::npos) {
    throw UsageError(text + ": only http:// can be served; put a proxy in front for anything else");
  }
  if (text == "-") throw UsageError("-: name /dev/stdout to write one image (PNG) to stdout");
  if (text.back() == '/') return SinkKind::kFolder;
  std::error_code error;
  const fs::file_status status = fs::status(text, error);
  if (fs::is_directory(status)) return SinkKind::kFolder;
  const std::string ending = lowercase_extension(text);
  if (is_image_path(text)) return SinkKind::kImage;
  if (is_video_extension(ending)) return SinkKind::kVideo;
  if (fs::exists(status) && !fs::is_regular_file(status))
    return SinkKind::kImage;  // a device or pipe
  if (ending.empty()) return SinkKind::kFolder;
  throw UsageError(fmt::format(
      "{}: unknown file ending '{}': .png, .jpg, .webp, .bmp, .mp4, .avi and .mkv are written; "
      "a folder ends in '/'",
      text, ending));
}

std::unique_ptr<FrameSink> open_sink(const std::string& text, const SinkOptions& options) {
  options.check();
  const SinkKind kind = classify_sink(text);
  if (options.segment_s > 0 && kind != SinkKind::kVideo) {
    throw UsageError(text + ": only videos are cut into segments: name an .mp4, .avi or .mkv file");
  }
  switch (kind) {
    case SinkKind::kNone:
      return std::make_unique<NoSink>();
    case SinkKind::kImage:
      return std::make_unique<ImageSink>(text, options);
    case SinkKind::kFolder:
      return std::make_unique<FolderSink>(text, options);
    case SinkKind::kVideo:
      return std::make_unique<VideoSink>(text, options);
    case SinkKind::kHttp:
      return open_http_sink(text, options);
  }
  throw UsageError(text + ": no such output");
}

}  // namespace tarsier
