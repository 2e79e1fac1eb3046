// SPDX-License-Identifier: MIT
#include "tarsier/media/image_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/log.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_codec.h"
#include "tarsier/media/image_probe.h"
#include "tarsier/media/lazy_opencv.h"
#include "tarsier/media/stored_image.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cerrno>
#include <climits>
#include <fcntl.h>
#include <new>
#include <sys/stat.h>
#include <unistd.h>
#include <vector>

namespace tarsier {
namespace {

constexpr NameTable<ImageFormat, 6> kFormats{"format",
                                             {{{ImageFormat::kJpeg, "JPEG"},
                                               {ImageFormat::kPng, "PNG"},
                                               {ImageFormat::kWebp, "WebP"},
                                               {ImageFormat::kBmp, "BMP"},
                                               {ImageFormat::kPnm, "PNM"},
                                               {ImageFormat::kTiff, "TIFF"}}}};
using Bytes = std::span<const std::uint8_t>;

cv::Mat decode(Bytes bytes, const std::string& name, const ImageLimits& limits, int flags) {
  TARSIER_REQUIRE(limits.max_pixels >= 1 && limits.max_bytes >= 1, "image limits {} px, {} bytes",
                  limits.max_pixels, limits.max_bytes);
  if (bytes.empty()) throw InputError(name, "empty file");
  if (static_cast<std::uint64_t>(bytes.size()) > static_cast<std::uint64_t>(limits.max_bytes) ||
      bytes.size() > static_cast<std::size_t>(INT_MAX)) {
    throw InputError(name, fmt::format("{} bytes are more than the limit of {}", bytes.size(),
                                       std::min<std::int64_t>(limits.max_bytes, INT_MAX)));
  }
  const auto format = image_format_of(bytes);
  if (!format) throw InputError(name, describe_not_an_image(bytes));
  if (*format == ImageFormat::kTiff && !limits.allow_tiff) {
    throw InputError(name, "TIFF images are not read: convert it to PNG");
  }
  const auto header = probe_image(bytes);
  if (!header) throw InputError(name, fmt::format("truncated {}: no size in it", name_of(*format)));
  if (header->width < 1 || header->height < 1) {
    throw InputError(name, fmt::format("broken {}: {}x{} pixels", name_of(*format), header->width,
                                       header->height));
  }
  if (std::int64_t{header->width} * header->height > limits.max_pixels) {
    throw InputError(
        name, fmt::format("{}x{} pixels are more than the limit of {} million", header->width,
                          header->height, static_cast<double>(limits.max_pixels) / 1e6));
  }
  cv::Mat image;
  try {
    std::vector<std::uint8_t> replacement;
    const std::string damage = find_image_damage(bytes, *header, replacement);
    if (!damage.empty()) throw InputError(name, damage);
    const Bytes source = replacement.empty() ? bytes : Bytes(replacement);
    image = decode_plain(source, *header, (flags & cv::IMREAD_COLOR) == 0);
    if (image.empty()) {
      const cv::Mat data(1, static_cast<int>(source.size()), CV_8UC1,
                         const_cast<std::uint8_t*>(source.data()));
      image = lazy_opencv::imdecode(data, flags);
    }
  } catch (const cv::Exception& error) {
    throw InputError(name, fmt::format("broken {}: {}", name_of(*format), error.err));
  } catch (const std::bad_alloc&) {
    throw InputError(
        name, fmt::format("not enough memory for {}x{} pixels", header->width, header->height));
  }
  if (image.empty())
    throw InputError(name, fmt::format("broken {}: cannot be decoded", name_of(*format)));
  const bool upright = image.cols == header->width && image.rows == header->height;
  const bool turned = image.cols == header->height && image.rows == header->width;
  if (!upright && !turned) {
    throw InputError(
        name, fmt::format("broken {}: {}x{} in the header, {}x{} in the data", name_of(*format),
                          header->width, header->height, image.cols, image.rows));
  }
  return image;
}

cv::Mat read_with(const std::string& path, const ImageLimits& limits, int flags) {
  const std::string bytes = read_file(path, limits.max_bytes);
  return decode(Bytes(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()), path,
                limits, flags);
}

}  // namespace

std::string_view name_of(ImageFormat format) { return kFormats.name(format); }

cv::Mat decode_image(std::span<const std::uint8_t> bytes, const std::string& name,
                     const ImageLimits& limits) {
  return decode(bytes, name, limits, cv::IMREAD_COLOR);
}

cv::Mat read_image(const std::string& path, const ImageLimits& limits) {
  return read_with(path, limits, cv::IMREAD_COLOR);
}

cv::Mat read_gray_image(const std::string& path, const ImageLimits& limits) {
  return read_with(path, limits, cv::IMREAD_GRAYSCALE);
}

cv::Mat decode_stored_image(std::span<const std::uint8_t> bytes, const std::string& name,
                            const ImageLimits& limits) {
  return decode(bytes, name, limits, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
}

cv::Mat read_stored_image(const std::string& path, const ImageLimits& limits) {
  return read_with(path, limits, cv::IMREAD_COLOR | cv::IMREAD_IGNORE_ORIENTATION);
}

cv::Mat read_stored_gray_image(const std::string& path, const ImageLimits& limits) {
  return read_with(path, limits, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
}

bool is_image_path(std::string_view path) {
  constexpr std::array<std::string_view, 7> kEndings{".png", ".jpg", ".jpeg", ".webp",
                                                     ".bmp", ".ppm", ".pgm"};
  return std::find(kEndings.begin(), kEndings.end(), lowercase_extension(path)) != kEndings.end();
}

std::vector<std::uint8_t> encode_image(std::string_view ending, const cv::Mat& image,
                                       const std::string& name, int jpeg_quality) {
  TARSIER_REQUIRE(!image.empty() && image.dims == 2,
                  "an array of {}x{} is not an image to write to {}", image.cols, image.rows, name);
  TARSIER_REQUIRE(jpeg_quality >= 1 && jpeg_quality <= 100, "JPEG quality {} outside 1..100",
                  jpeg_quality);
  const std::string kind = lowercase_extension(fmt::format("x{}", ending));
  if (!is_image_path("x" + kind)) {
    throw UsageError(
        name + ": unknown ending for an image: .png, .jpg, .webp, .bmp, .ppm and .pgm are written");
  }
  const int depth = image.depth();
  const int channels = image.channels();
  TARSIER_REQUIRE(channels == 1 || channels == 3 || channels == 4,
                  "{} channels cannot be written to {}", channels, name);
  TARSIER_REQUIRE(depth == CV_8U || (depth == CV_16U && kind == ".png"),
                  "{}: only 8-bit images (16-bit in .png) can be written", name);
  std::vector<std::uint8_t> bytes;
  bool encoded = false;
  try {
    cv::Mat ready = image;
    const bool takes_alpha = kind == ".png" || kind == ".webp";
    if (kind == ".pgm" && channels != 1) {
      cv::cvtColor(image, ready, channels == 4 ? cv::COLOR_BGRA2GRAY : cv::COLOR_BGR2GRAY);
    } else if (channels == 4 && !takes_alpha) {
      cv::cvtColor(image, ready, cv::COLOR_BGRA2BGR);
    } else if (kind == ".ppm" && channels == 1) {
      cv::cvtColor(image, ready, cv::COLOR_GRAY2BGR);
    }
    bytes = encode_plain(kind, ready, jpeg_quality);
    encoded = !bytes.empty();
    if (!encoded) {
      std::vector<int> parameters;
      if (kind == ".jpg" || kind == ".jpeg") parameters = {cv::IMWRITE_JPEG_QUALITY, jpeg_quality};
      encoded = lazy_opencv::imencode(kind, ready, bytes, parameters);
    }
  } catch (const cv::Exception& error) {
    throw OutputError(
        name, fmt::format("cannot encode {}x{} pixels: {}", image.cols, image.rows, error.err));
  } catch (const std::bad_alloc&) {
    throw OutputError(
        name, fmt::format("not enough memory to encode {}x{} pixels", image.cols, image.rows));
  }
  if (!encoded || bytes.empty()) {
    throw OutputError(name, fmt::format("cannot encode {}x{} pixels as {}", image.cols, image.rows,
                                        kind.substr(1)));
  }
  return bytes;
}

void write_image(const std::string& path, const cv::Mat& image, int jpeg_quality) {
  const std::vector<std::uint8_t> bytes =
      encode_image(lowercase_extension(path), image, path, jpeg_quality);
  write_file_atomically(path, std::span<const std::uint8_t>(bytes));
}

namespace {

// Reads up to `max_bytes` of a file; with `whole` throws if there are more.
std::string read_bytes(const std::string& path, std::int64_t max_bytes, bool whole) {
  TARSIER_REQUIRE(max_bytes >= 1, "limit of {} bytes", max_bytes);
  const auto reason = [](int error) {
    return error == ENOENT ? std::string("no such file") : errno_text(error);
  };
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) throw InputError(path, reason(errno));
  struct Closer {
    int fd;
    ~Closer() { ::close(fd); }
  } const closer{fd};
  struct ::stat info {};
  if (::fstat(fd, &info) != 0) throw InputError(path, reason(errno));
  if (S_ISDIR(info.st_mode)) throw InputError(path, "is a folder, not a file");
  if (S_ISBLK(info.st_mode)) throw InputError(path, "is a disk, not a file");
  const auto too_large = [&] {
    return InputError(path, fmt::format("larger than the limit of {} bytes", max_bytes));
  };
  const bool regular = S_ISREG(info.st_mode);
  if (whole && regular && info.st_size > max_bytes) throw too_large();
  try {
    std::string bytes;
    // Pipes and files of /proc do not report their size: they are read to their end. One byte more
    // than the file's size, so that its end is detected without growing.
    const std::int64_t known = std::min<std::int64_t>(info.st_size, max_bytes);
    bytes.resize(regular && known > 0 ? static_cast<std::size_t>(known) + 1 : 65536);
    std::size_t size = 0;
    while (true) {
      if (size == bytes.size())
        bytes.resize(std::min(size * 2, static_cast<std::size_t>(max_bytes) + 1));
      const ssize_t got = ::read(fd, bytes.data() + size, bytes.size() - size);
      if (got < 0) {
        if (errno == EINTR) continue;
        throw InputError(path, reason(errno));
      }
      if (got == 0) break;
      size += static_cast<std::size_t>(got);
      if (size <= static_cast<std::size_t>(max_bytes)) continue;
      if (whole) throw too_large();
      size = static_cast<std::size_t>(max_bytes);
      break;
    }
    bytes.resize(size);
    return bytes;
  } catch (const std::bad_alloc&) {
    throw InputError(path, "not enough memory to read it");
  }
}

}  // namespace

std::string read_start(const std::string& path, std::int64_t max_bytes) {
  return read_bytes(path, max_bytes, false);
}

std::string read_file(const std::string& path, std::int64_t max_bytes) {
  return read_bytes(path, max_bytes, true);
}

}  // namespace tarsier
