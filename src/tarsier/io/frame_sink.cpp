// SPDX-License-Identifier: MIT
#include "tarsier/io/frame_sink.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/io/atomic_file.h"
#include "tarsier/io/http_sink.h"
#include "tarsier/io/image_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
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

std::string lower_ending(const std::string& path) {
  std::string ending = fs::path(path).extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return ending;
}

bool is_video_ending(const std::string& ending) {
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
      throw UsageError(
          path_ + ": is one picture, and more are to come: name a folder instead (ending in '/')");
    }
    // Found out now, not after the work.
    const AtomicFile probe(path_);
  }

  std::string write(const cv::Mat& image, const Frame&) override {
    require_writable_image(image);
    if (written_) {
      throw UsageError(
          path_ + ": is one picture, and a second has come: name a folder instead (ending in '/')");
    }
    // A device or pipe has no ending that could name a format.
    const std::string ending = is_image_path(path_) ? lower_ending(path_) : ".png";
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
  FolderSink(std::string path, const SinkOptions& options)
      : path_(std::move(path)), options_(options) {
    make_folder(path_);
    if (::access(path_.c_str(), W_OK | X_OK) != 0) {
      throw OutputError(path_,
                        "cannot write into this folder: " + std::generic_category().message(errno));
    }
  }

  std::string write(const cv::Mat& image, const Frame& source) override {
    require_writable_image(image);
    const std::string target = (fs::path(path_) / free_name(source)).string();
    std::error_code ignored;
    if (source.still && fs::equivalent(target, source.name, ignored)) {
      throw OutputError(target, "would replace its own source: name another folder");
    }
    write_image(target, image, options_.jpeg_quality);
    ++count_;
    return target;
  }
  void finish() override {}
  [[nodiscard]] std::string description() const override {
    return fmt::format("{} ({} {})", path_, count_, count_ == 1 ? "picture" : "pictures");
  }

 private:
  // The source's base name; a number is added where two sources share one.
  std::string free_name(const Frame& source) {
    std::string stem;
    std::string ending = options_.folder_extension;
    if (source.still) {
      const fs::path path(source.name);
      stem = path.stem().string().substr(0, 180);  // names end at 255 bytes
      if (ending.empty() && is_image_path(source.name)) ending = path.extension().string();
    } else {
      stem = fmt::format("frame_{:06d}", source.index);
    }
    if (stem.empty()) stem = "picture";
    if (ending.empty()) ending = ".png";
    std::string name = stem + ending;
    for (int number = 2; !used_.insert(name).second; ++number)
      name = fmt::format("{}-{}{}", stem, number, ending);
    return name;
  }

  std::string path_;
  SinkOptions options_;
  std::set<std::string> used_;
  std::int64_t count_ = 0;
};

// `image` as BGR in `size`, aspect kept, the rest black.
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

// A muxer that runs into a full disk says nothing: OpenCV drops its errors. But the sizes that it
// noted in the file then disagree with the file's own. The outer boxes of AVI, MP4 and Matroska are
// followed to the end.
bool is_whole_container(const std::string& path, const std::string& ending) {
  std::error_code error;
  const std::uintmax_t size = fs::file_size(path, error);
  if (error || size < 16) return false;
  std::ifstream file(path, std::ios::binary);
  std::uint64_t at = 0;
  std::array<unsigned char, 16> head{};
  const auto read_at = [&](std::uint64_t place) {
    head.fill(0);
    file.clear();
    file.seekg(static_cast<std::streamoff>(place));
    file.read(reinterpret_cast<char*>(head.data()),
              static_cast<std::streamsize>(std::min<std::uint64_t>(16, size - place)));
    return !file.bad() && file.gcount() >= 8;
  };
  const auto big = [&](std::size_t from, std::size_t count) {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < count; ++i) value = value << 8U | head[from + i];
    return value;
  };
  bool has_index = false;
  while (at + 8 <= size) {
    if (!read_at(at)) return false;
    std::uint64_t length = 0;
    if (ending == ".avi") {
      if (std::memcmp(head.data(), "RIFF", 4) != 0) return false;
      length = 8 + (head[4] | static_cast<std::uint64_t>(head[5]) << 8U |
                    static_cast<std::uint64_t>(head[6]) << 16U |
                    static_cast<std::uint64_t>(head[7]) << 24U);
      has_index = true;
    } else if (ending == ".mp4") {
      length = big(0, 4);
      if (length == 1) length = big(8, 8);
      has_index = has_index || std::memcmp(head.data() + 4, "moov", 4) == 0;
      if (length < 8) return false;
    } else {
      // EBML: the length of the identifier, and of the size, is the number of leading zero bits of
      // their first byte.
      const auto width = [](unsigned char first) {
        std::size_t count = 1;
        while (count <= 8 && (first & (0x80U >> (count - 1))) == 0) ++count;
        return count;
      };
      const std::size_t id_bytes = width(head[0]);
      if (id_bytes > 4) return false;
      const std::size_t size_bytes = width(head[id_bytes]);
      if (size_bytes > 8 || id_bytes + size_bytes > 16) return false;
      const std::uint64_t mask = (std::uint64_t{1} << (7 * size_bytes)) - 1;
      const std::uint64_t content = big(id_bytes, size_bytes) & mask;
      if (content == mask) return false;  // "unknown": the end was never written
      length = id_bytes + size_bytes + content;
      has_index = has_index || big(0, 4) == 0x18538067;  // Segment
    }
    if (length > size - at) return false;
    at += length;
  }
  return at == size && has_index;
}

class VideoSink final : public FrameSink {
 public:
  VideoSink(std::string path, const SinkOptions& options)
      : path_(std::move(path)),
        ending_(lower_ending(path_)),
        fps_(options.fps),
        file_(std::in_place, path_) {
    std::error_code ignored;
    if (!fs::is_regular_file(file_->path(), ignored))
      throw OutputError(path_, "a video needs a regular file");
  }

  ~VideoSink() override {
    try {
      writer_.release();
    } catch (...) {  // the file is thrown away
    }
  }

  std::string write(const cv::Mat& image, const Frame&) override {
    require_writable_image(image);
    TARSIER_REQUIRE(!finished_, "{} is finished", path_);
    if (count_ == 0) open(image.size());
    check_disk();
    cv::Mat frame = fitted(image, picture_);
    if (coded_ != picture_) {
      // The codecs halve the colour planes: an odd side would lose its last line.
      cv::copyMakeBorder(frame, frame, 0, coded_.height - picture_.height, 0,
                         coded_.width - picture_.width, cv::BORDER_REPLICATE);
    }
    try {
      writer_.write(frame);
    } catch (const cv::Exception& error) {
      throw OutputError(path_, "cannot encode: " + error.err);
    }
    ++count_;
    return {};
  }

  void finish() override {
    if (finished_) return;
    finished_ = true;
    if (count_ == 0) {
      log_warning("{}: no frame came, no video is written", path_);
      file_.reset();
      return;
    }
    try {
      writer_.release();
    } catch (const cv::Exception& error) {
      throw OutputError(path_, "cannot encode: " + error.err);
    }
    if (!is_whole_container(file_->path(), ending_)) {
      throw OutputError(path_, "the video could not be written to its end: is the disk full?");
    }
    file_->commit();
  }

  [[nodiscard]] std::string description() const override {
    return fmt::format("{} ({} {})", path_, count_, count_ == 1 ? "frame" : "frames");
  }

 private:
  void open(cv::Size size) {
    picture_ = size;
    coded_ = {(size.width + 1) / 2 * 2, (size.height + 1) / 2 * 2};
    const int codec = ending_ == ".avi"   ? cv::VideoWriter::fourcc('M', 'J', 'P', 'G')
                      : ending_ == ".mp4" ? cv::VideoWriter::fourcc('m', 'p', '4', 'v')
                                          : cv::VideoWriter::fourcc('F', 'M', 'P', '4');
    bool opened = false;
    std::string reason;
    try {
      // Absolute: FFmpeg takes "a:b.mp4" for a protocol.
      opened = writer_.open(fs::absolute(file_->path()).string(), cv::CAP_FFMPEG, codec, fps_,
                            coded_, true);
    } catch (const std::exception& error) {
      reason = error.what();
    }
    if (!opened) {
      throw OutputError(
          path_, fmt::format("cannot encode {}x{} video at {:g} frames per second{}", coded_.width,
                             coded_.height, fps_, reason.empty() ? "" : ": " + reason));
    }
  }

  // Early, so that hours of work are not spent on a video that cannot be kept.
  void check_disk() const {
    constexpr std::uint64_t kLeast = 1 << 20U;
    struct ::statvfs disk {};
    if (::statvfs(file_->path().c_str(), &disk) != 0) return;
    if (std::uint64_t{disk.f_bavail} * disk.f_frsize < kLeast)
      throw OutputError(path_, "the disk is full");
  }

  std::string path_;
  std::string ending_;
  double fps_;
  std::optional<AtomicFile> file_;
  cv::VideoWriter writer_;
  cv::Size picture_;  // of the first frame
  cv::Size coded_;    // the same, made even
  std::int64_t count_ = 0;
  bool finished_ = false;
};

}  // namespace

void SinkOptions::check() const {
  TARSIER_REQUIRE(fps > 0 && fps <= 1000, "fps {} outside (0, 1000]", fps);
  TARSIER_REQUIRE(jpeg_quality >= 1 && jpeg_quality <= 100, "JPEG quality {} outside 1..100",
                  jpeg_quality);
  TARSIER_REQUIRE(max_viewers >= 1 && max_viewers <= 64, "{} viewers outside 1..64", max_viewers);
  TARSIER_REQUIRE(folder_extension.empty() || (folder_extension.find('/') == std::string::npos &&
                                               is_image_path("x" + folder_extension)),
                  "'{}' is no ending for pictures", folder_extension);
}

SinkKind classify_sink(const std::string& text) {
  if (text.empty())
    throw UsageError("an empty output: name a file, a folder, http://127.0.0.1:8080/ or none");
  if (text == "none") return SinkKind::kNone;
  if (text.rfind("http://", 0) == 0) return SinkKind::kHttp;
  if (text.find("://") != std::string::npos) {
    throw UsageError(text + ": only http:// can be served; put a proxy in front for anything else");
  }
  if (text == "-") throw UsageError("-: name /dev/stdout to write one picture (PNG) to stdout");
  if (text.back() == '/') return SinkKind::kFolder;
  std::error_code error;
  const fs::file_status status = fs::status(text, error);
  if (fs::is_directory(status)) return SinkKind::kFolder;
  const std::string ending = lower_ending(text);
  if (is_image_path(text)) return SinkKind::kImage;
  if (is_video_ending(ending)) return SinkKind::kVideo;
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
  switch (classify_sink(text)) {
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
