// SPDX-License-Identifier: MIT
#include "tarsier/media/image_probe.h"

#include "tarsier/core/log.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <climits>
#include <string_view>

namespace tarsier {
namespace {

using Bytes = std::span<const std::uint8_t>;

// Reads at an offset that may be out of range: then it returns nullopt and reads nothing.
class Cursor {
 public:
  explicit Cursor(Bytes bytes, std::size_t at = 0) : bytes_(bytes), at_(at) {}
  [[nodiscard]] std::size_t at() const { return at_; }
  [[nodiscard]] std::size_t left() const { return at_ < bytes_.size() ? bytes_.size() - at_ : 0; }
  [[nodiscard]] bool has(std::size_t count) const { return left() >= count; }
  bool skip(std::size_t count) {
    if (!has(count)) return false;
    at_ += count;
    return true;
  }
  std::optional<std::uint32_t> big_endian(int count) {
    if (!has(static_cast<std::size_t>(count))) return std::nullopt;
    std::uint32_t value = 0;
    for (int i = 0; i < count; ++i) value = value << 8U | bytes_[at_++];
    return value;
  }
  std::optional<std::uint32_t> little_endian(int count) {
    if (!has(static_cast<std::size_t>(count))) return std::nullopt;
    std::uint32_t value = 0;
    for (int i = 0; i < count; ++i)
      value |= std::uint32_t{bytes_[at_++]} << (8U * static_cast<unsigned>(i));
    return value;
  }

 private:
  Bytes bytes_;
  std::size_t at_;
};

bool starts_with(Bytes bytes, std::string_view magic, std::size_t at = 0) {
  if (bytes.size() < at || bytes.size() - at < magic.size()) return false;
  return std::equal(magic.begin(), magic.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at),
                    [](char c, std::uint8_t b) { return static_cast<std::uint8_t>(c) == b; });
}

constexpr std::string_view kPngMagic("\x89PNG\r\n\x1a\n", 8);

// A size that int cannot hold is as good as the largest int: both exceed every limit.
int clamped(std::uint64_t value) {
  return static_cast<int>(std::min<std::uint64_t>(value, static_cast<std::uint64_t>(INT_MAX)));
}

// --- JPEG: ITU-T T.81, annex B ---

struct JpegWalk {
  int width = 0;
  int height = 0;
  bool has_frame = false;
  bool complete = false;  // the data of the scans ends with an end-of-image marker
  std::int64_t scans = 0;
  std::string broken;  // why the segments are invalid
};

constexpr bool is_frame_header(std::uint8_t marker) {
  return marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
}

// Walks over the segments, only to the frame header or to the end of the image.
JpegWalk walk_jpeg(Bytes bytes, bool whole) {
  JpegWalk walk;
  std::size_t at = 2;
  while (at < bytes.size()) {
    if (bytes[at] != 0xFF) {
      ++at;  // stray bytes between segments: decoders skip them, too
      continue;
    }
    while (at < bytes.size() && bytes[at] == 0xFF) ++at;
    if (at >= bytes.size()) return walk;
    const std::uint8_t marker = bytes[at++];
    if (marker == 0x00 || marker == 0x01 || (marker >= 0xD0 && marker <= 0xD7)) continue;
    if (marker == 0xD9) {
      walk.complete = walk.scans > 0;
      return walk;
    }
    if (marker == 0xD8) {
      walk.broken = "a second image starts inside the first";
      return walk;
    }
    Cursor segment(bytes, at);
    const auto length = segment.big_endian(2);
    if (!length) return walk;
    if (*length < 2) {
      walk.broken = "a segment of impossible length";
      return walk;
    }
    if (is_frame_header(marker)) {
      if (walk.has_frame) {
        walk.broken = "two frame headers";
        return walk;
      }
      (void)segment.skip(1);  // precision
      const auto height = segment.big_endian(2);
      const auto width = segment.big_endian(2);
      if (!width) return walk;
      walk.has_frame = true;
      walk.width = static_cast<int>(*width);
      walk.height = static_cast<int>(*height);
      if (!whole) return walk;
    }
    if (bytes.size() - at < *length) return walk;
    at += *length;
    if (marker == 0xDA) {
      ++walk.scans;
      // Entropy-coded data: FF 00 is the byte FF, FF D0..D7 a restart; anything else ends it.
      while (at + 1 < bytes.size()) {
        if (bytes[at] != 0xFF) {
          ++at;
        } else if (bytes[at + 1] == 0x00 || (bytes[at + 1] >= 0xD0 && bytes[at + 1] <= 0xD7)) {
          at += 2;
        } else if (bytes[at + 1] == 0xFF) {
          ++at;
        } else {
          break;
        }
      }
      if (at + 1 >= bytes.size()) return walk;
    }
  }
  return walk;
}

// --- PNG: ISO/IEC 15948 ---

constexpr std::array<std::uint32_t, 256> make_crc_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t n = 0; n < 256; ++n) {
    std::uint32_t c = n;
    for (int k = 0; k < 8; ++k) c = (c & 1U) != 0 ? 0xEDB88320U ^ (c >> 1U) : c >> 1U;
    table[n] = c;
  }
  return table;
}

std::uint32_t crc_of(Bytes bytes) {
  static constexpr auto kTable = make_crc_table();
  std::uint32_t c = 0xFFFFFFFFU;
  for (const std::uint8_t byte : bytes) c = kTable[(c ^ byte) & 0xFFU] ^ (c >> 8U);
  return ~c;
}

// Checks all chunks and copies to `needed_chunks` those that the pixels (and their orientation)
// need. The other chunks (text, colour profiles) can hold decompression bombs and cause warnings of
// the decoder. Returns what is wrong.
std::string check_png(Bytes bytes, std::vector<std::uint8_t>& needed_chunks) {
  needed_chunks.reserve(bytes.size());
  needed_chunks.assign(bytes.begin(),
                       bytes.begin() + static_cast<std::ptrdiff_t>(kPngMagic.size()));
  std::size_t at = kPngMagic.size();
  bool has_data = false;
  while (true) {
    Cursor cursor(bytes, at);
    const auto length = cursor.big_endian(4);
    if (!length || !cursor.has(std::size_t{*length} + 8)) return "truncated PNG";
    const Bytes chunk = bytes.subspan(at, std::size_t{*length} + 12);
    const std::string type(chunk.begin() + 4, chunk.begin() + 8);
    if (!std::all_of(type.begin(), type.end(),
                     [](char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; })) {
      return "broken PNG: a chunk without a name";
    }
    const std::uint32_t crc = *Cursor(chunk, chunk.size() - 4).big_endian(4);
    if (crc_of(chunk.subspan(4, std::size_t{*length} + 4)) != crc) {
      return fmt::format("broken PNG: wrong checksum of chunk {} at byte {}", type, at);
    }
    constexpr std::array<std::string_view, 6> kNeeded{"IHDR", "PLTE", "tRNS",
                                                      "IDAT", "IEND", "eXIf"};
    if (std::find(kNeeded.begin(), kNeeded.end(), type) != kNeeded.end()) {
      needed_chunks.insert(needed_chunks.end(), chunk.begin(), chunk.end());
    }
    has_data = has_data || type == "IDAT";
    at += chunk.size();
    if (type == "IEND") return has_data ? "" : "broken PNG: no image data";
  }
}

// --- the others ---

std::optional<ImageHeader> probe_png(Bytes bytes) {
  Cursor cursor(bytes, 8);
  const auto length = cursor.big_endian(4);
  if (!length || *length != 13 || !starts_with(bytes, "IHDR", 12)) return std::nullopt;
  (void)cursor.skip(4);
  const auto width = cursor.big_endian(4);
  const auto height = cursor.big_endian(4);
  if (!height) return std::nullopt;
  return ImageHeader{ImageFormat::kPng, clamped(*width), clamped(*height)};
}

std::optional<ImageHeader> probe_webp(Bytes bytes) {
  ImageHeader header{ImageFormat::kWebp, 0, 0};
  if (starts_with(bytes, "VP8X", 12)) {
    Cursor cursor(bytes, 24);
    const auto width = cursor.little_endian(3);
    const auto height = cursor.little_endian(3);
    if (!height) return std::nullopt;
    header.width = static_cast<int>(*width) + 1;
    header.height = static_cast<int>(*height) + 1;
    return header;
  }
  if (starts_with(bytes, "VP8L", 12)) {
    Cursor cursor(bytes, 20);
    const auto signature = cursor.little_endian(1);
    const auto bits = cursor.little_endian(4);
    constexpr unsigned kVersionAt = 29;  // three bits, 0: the version that libwebp reads
    if (!bits || *signature != 0x2F || *bits >> kVersionAt != 0) return std::nullopt;
    header.width = static_cast<int>(*bits & 0x3FFFU) + 1;
    header.height = static_cast<int>(*bits >> 14U & 0x3FFFU) + 1;
    return header;
  }
  if (starts_with(bytes, "VP8 ", 12)) {
    Cursor cursor(bytes, 23);
    const auto start_code = cursor.big_endian(3);
    const auto width = cursor.little_endian(2);
    const auto height = cursor.little_endian(2);
    if (!height || *start_code != 0x9D012A) return std::nullopt;
    header.width = static_cast<int>(*width & 0x3FFFU);
    header.height = static_cast<int>(*height & 0x3FFFU);
    return header;
  }
  return std::nullopt;
}

struct BmpHeader {
  ImageHeader image{ImageFormat::kBmp, 0, 0};
  std::uint32_t data_at = 0;
  std::uint32_t bits = 0;
  std::uint32_t compression = 0;
};

std::optional<BmpHeader> parse_bmp(Bytes bytes) {
  BmpHeader bmp;
  Cursor cursor(bytes, 10);
  const auto data_at = cursor.little_endian(4);
  const auto size = cursor.little_endian(4);
  if (!size) return std::nullopt;
  bmp.data_at = *data_at;
  std::optional<std::uint32_t> bits;
  if (*size == 12) {
    const auto width = cursor.little_endian(2);
    const auto height = cursor.little_endian(2);
    (void)cursor.skip(2);
    bits = cursor.little_endian(2);
    if (!bits) return std::nullopt;
    bmp.image.width = static_cast<int>(*width);
    bmp.image.height = static_cast<int>(*height);
  } else {
    const auto width = cursor.little_endian(4);
    const auto height = cursor.little_endian(4);
    (void)cursor.skip(2);
    bits = cursor.little_endian(2);
    if (!bits) return std::nullopt;
    // Signed; a negative height means that the first row is the top one. A negative width is
    // invalid.
    const auto signed_width = static_cast<std::int64_t>(static_cast<std::int32_t>(*width));
    const auto signed_height = static_cast<std::int64_t>(static_cast<std::int32_t>(*height));
    bmp.image.width = signed_width < 0 ? 0 : clamped(static_cast<std::uint64_t>(signed_width));
    bmp.image.height =
        clamped(static_cast<std::uint64_t>(signed_height < 0 ? -signed_height : signed_height));
    if (*size > 16) {
      const auto compression = cursor.little_endian(4);
      if (!compression) return std::nullopt;
      bmp.compression = *compression;
    }
  }
  bmp.bits = *bits;
  return bmp;
}

struct PnmHeader {
  ImageHeader image{ImageFormat::kPnm, 0, 0};
  char kind = 0;  // '1'..'6'
  std::uint64_t max_value = 1;
  std::size_t data_at = 0;
};

std::optional<PnmHeader> parse_pnm(Bytes bytes) {
  PnmHeader pnm;
  pnm.kind = static_cast<char>(bytes[1]);
  std::size_t at = 2;
  const auto number = [&]() -> std::optional<std::uint64_t> {
    while (at < bytes.size()) {
      if (bytes[at] == '#') {
        while (at < bytes.size() && bytes[at] != '\n' && bytes[at] != '\r') ++at;
      } else if (std::isspace(bytes[at]) != 0) {
        ++at;
      } else {
        break;
      }
    }
    std::uint64_t value = 0;
    const std::size_t start = at;
    for (; at < bytes.size() && std::isdigit(bytes[at]) != 0; ++at) {
      value = std::min<std::uint64_t>(value * 10 + (bytes[at] - std::uint64_t{'0'}), 1ULL << 40U);
    }
    // A number at the end of the bytes may be incomplete.
    if (at == start || at >= bytes.size()) return std::nullopt;
    return value;
  };
  const auto width = number();
  const auto height = width ? number() : std::nullopt;
  if (!height) return std::nullopt;
  if (pnm.kind != '1' && pnm.kind != '4') {
    const auto max_value = number();
    if (!max_value) return std::nullopt;
    pnm.max_value = *max_value;
  }
  pnm.data_at = at + 1;  // one white space
  pnm.image.width = clamped(*width);
  pnm.image.height = clamped(*height);
  return pnm;
}

// The binary image with samples up to 255 or 65535: OpenCV does not scale those of another maximum.
std::vector<std::uint8_t> with_full_range(Bytes bytes, const PnmHeader& pnm,
                                          std::uint64_t samples) {
  const bool is_wide = pnm.max_value > 255;  // two bytes, the higher one first
  const std::uint64_t full = is_wide ? 65535 : 255;
  const std::string header =
      fmt::format("P{}\n{} {}\n{}\n", pnm.kind, pnm.image.width, pnm.image.height, full);
  std::vector<std::uint8_t> scaled(header.begin(), header.end());
  scaled.reserve(header.size() + samples * (is_wide ? 2 : 1));
  std::size_t at = pnm.data_at;
  for (std::uint64_t i = 0; i < samples; ++i) {
    std::uint64_t value = bytes[at++];
    if (is_wide) value = value * 256 + bytes[at++];
    value = (std::min(value, pnm.max_value) * full + pnm.max_value / 2) / pnm.max_value;
    if (is_wide) scaled.push_back(static_cast<std::uint8_t>(value >> 8U));
    scaled.push_back(static_cast<std::uint8_t>(value & 0xFFU));
  }
  return scaled;
}

// Counts the numbers of an image in decimal digits. Returns what is wrong.
std::string check_ascii_pnm(Bytes bytes, const PnmHeader& pnm, std::uint64_t numbers) {
  const bool bitmap = pnm.kind == '1';  // its digits need no space between them
  std::uint64_t found = 0;
  bool inside = false;
  for (std::size_t at = pnm.data_at; at < bytes.size() && found < numbers; ++at) {
    const std::uint8_t c = bytes[at];
    if (std::isdigit(c) != 0) {
      if (bitmap) {
        ++found;
      } else {
        inside = true;
      }
      continue;
    }
    if (inside) ++found;
    inside = false;
    if (c == '#') {
      while (at < bytes.size() && bytes[at] != '\n' && bytes[at] != '\r') ++at;
    } else if (std::isspace(c) == 0 && found < numbers) {
      return fmt::format("broken PNM: no number at byte {}", at);
    }
  }
  return found + (inside ? 1 : 0) < numbers ? "truncated PNM" : "";
}

std::optional<ImageHeader> probe_tiff(Bytes bytes) {
  const bool little_endian = bytes[0] == 'I';
  const auto read = [&](Cursor& cursor, int count) {
    return little_endian ? cursor.little_endian(count) : cursor.big_endian(count);
  };
  Cursor cursor(bytes, 4);
  const auto directory = read(cursor, 4);
  if (!directory) return std::nullopt;
  Cursor entry(bytes, *directory);
  const auto count = read(entry, 2);
  if (!count) return std::nullopt;
  std::optional<std::uint32_t> width;
  std::optional<std::uint32_t> height;
  for (std::uint32_t i = 0; i < *count && !(width && height); ++i) {
    const auto tag = read(entry, 2);
    const auto type = read(entry, 2);
    const auto values = read(entry, 4);
    if (!values) return std::nullopt;
    Cursor value(bytes, entry.at());
    const auto size = *type == 3 ? read(value, 2) : read(value, 4);
    if (!entry.skip(4)) return std::nullopt;
    if (*tag == 256) width = size;
    if (*tag == 257) height = size;
  }
  if (!width || !height) return std::nullopt;
  return ImageHeader{ImageFormat::kTiff, clamped(*width), clamped(*height)};
}

// --- checks before decoding ---

std::string describe_start(Bytes bytes) {
  const std::size_t count = std::min<std::size_t>(bytes.size(), 12);
  const std::string text(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(count));
  return fmt::format("\"{}{}\"", printable(text), bytes.size() > count ? ".." : "");
}

}  // namespace

std::optional<ImageFormat> image_format_of(Bytes bytes) {
  if (starts_with(bytes, "\xff\xd8\xff")) return ImageFormat::kJpeg;
  if (starts_with(bytes, kPngMagic)) return ImageFormat::kPng;
  if (starts_with(bytes, "RIFF") && starts_with(bytes, "WEBP", 8)) return ImageFormat::kWebp;
  if (starts_with(bytes, std::string_view("II*\0", 4)) ||
      starts_with(bytes, std::string_view("MM\0*", 4))) {
    return ImageFormat::kTiff;
  }
  if (bytes.size() >= 3 && bytes[0] == 'P' && bytes[1] >= '1' && bytes[1] <= '6' &&
      (std::isspace(bytes[2]) != 0 || bytes[2] == '#')) {
    return ImageFormat::kPnm;
  }
  if (starts_with(bytes, "BM") && bytes.size() >= 18) {
    const std::uint32_t size = *Cursor(bytes, 14).little_endian(4);
    constexpr std::array<std::uint32_t, 8> kHeaderSizes{12, 16, 40, 52, 56, 64, 108, 124};
    if (std::find(kHeaderSizes.begin(), kHeaderSizes.end(), size) != kHeaderSizes.end()) {
      return ImageFormat::kBmp;
    }
  }
  return std::nullopt;
}

std::optional<ImageHeader> probe_image(std::span<const std::uint8_t> bytes) {
  const auto format = image_format_of(bytes);
  if (!format) return std::nullopt;
  switch (*format) {
    case ImageFormat::kJpeg: {
      const JpegWalk walk = walk_jpeg(bytes, false);
      if (!walk.has_frame) return std::nullopt;
      return ImageHeader{ImageFormat::kJpeg, walk.width, walk.height};
    }
    case ImageFormat::kPng:
      return probe_png(bytes);
    case ImageFormat::kWebp:
      return probe_webp(bytes);
    case ImageFormat::kBmp: {
      const auto bmp = parse_bmp(bytes);
      return bmp ? std::optional<ImageHeader>(bmp->image) : std::nullopt;
    }
    case ImageFormat::kPnm: {
      const auto pnm = parse_pnm(bytes);
      return pnm ? std::optional<ImageHeader>(pnm->image) : std::nullopt;
    }
    case ImageFormat::kTiff:
      return probe_tiff(bytes);
  }
  return std::nullopt;
}

std::string describe_not_an_image(Bytes bytes) {
  struct Other {
    std::size_t at;
    std::string_view magic;
    std::string_view name;
  };
  static constexpr std::array<Other, 9> kOthers{{{0, "GIF8", "a GIF"},
                                                 {0, "%PDF", "a PDF"},
                                                 {4, "ftypheic", "a HEIC image"},
                                                 {4, "ftypmif1", "a HEIF image"},
                                                 {4, "ftypavif", "an AVIF image"},
                                                 {4, "ftyp", "an MP4 video"},
                                                 {0, "<svg", "an SVG drawing"},
                                                 {4, "jP  ", "a JPEG 2000 image"},
                                                 {0, "RIFF", "a RIFF file (a video?)"}}};
  constexpr std::string_view kAllowed = "JPEG, PNG, WebP, BMP and PNM are read";
  for (const Other& other : kOthers) {
    if (starts_with(bytes, other.magic, other.at))
      return fmt::format("is {}: {}", other.name, kAllowed);
  }
  return fmt::format("not an image: starts with {}; {}", describe_start(bytes), kAllowed);
}

std::string find_image_damage(Bytes bytes, const ImageHeader& header,
                              std::vector<std::uint8_t>& replacement) {
  const auto width = static_cast<std::uint64_t>(header.width);
  const auto height = static_cast<std::uint64_t>(header.height);
  // OpenCV tries its other decoders for data that libwebp or its PNM reader refuse, and its DICOM
  // decoder ends the process for a corrupt file.
  if ((header.format == ImageFormat::kWebp || header.format == ImageFormat::kPnm) &&
      starts_with(bytes, "DICM", 128)) {
    return fmt::format("{} that is a DICOM file as well: refused", name_of(header.format));
  }
  switch (header.format) {
    case ImageFormat::kJpeg: {
      const JpegWalk walk = walk_jpeg(bytes, true);
      if (!walk.broken.empty()) return "broken JPEG: " + walk.broken;
      if (!walk.complete) return "truncated JPEG: the end-of-image marker is missing";
      // Each scan of a progressive image passes over the whole image: a few bytes can cost minutes.
      constexpr std::int64_t kMaxScans = 500;
      constexpr std::int64_t kMaxScanPixels = 2'000'000'000;
      const auto pixels = static_cast<std::int64_t>(width * height);
      if (walk.scans > kMaxScans || (walk.scans > 20 && walk.scans * pixels > kMaxScanPixels)) {
        return fmt::format("JPEG with {} scans: refused", walk.scans);
      }
      return {};
    }
    case ImageFormat::kPng:
      return check_png(bytes, replacement);
    case ImageFormat::kWebp: {
      const std::uint64_t size = *Cursor(bytes, 4).little_endian(4);
      return bytes.size() < size + 8 ? "truncated WebP" : "";
    }
    case ImageFormat::kBmp: {
      const auto bmp = parse_bmp(bytes);
      if (!bmp) return "truncated BMP";
      constexpr std::array<std::uint32_t, 6> kBits{1, 4, 8, 16, 24, 32};
      if (std::find(kBits.begin(), kBits.end(), bmp->bits) == kBits.end()) {
        return fmt::format("broken BMP: {} bits per pixel", bmp->bits);
      }
      if (bmp->compression > 3) {
        return fmt::format("BMP with compression {}: not read", bmp->compression);
      }
      const bool run_length = bmp->compression == 1 || bmp->compression == 2;
      const std::uint64_t row = (width * bmp->bits + 31) / 32 * 4;
      const std::uint64_t data = run_length ? 1 : row * height;
      return bytes.size() < bmp->data_at + data ? "truncated BMP" : "";
    }
    case ImageFormat::kPnm: {
      const auto pnm = parse_pnm(bytes);
      if (!pnm) return "truncated PNM";
      if (pnm->max_value < 1 || pnm->max_value > 65535)
        return "broken PNM: maximum outside 1..65535";
      const std::uint64_t channels = pnm->kind == '3' || pnm->kind == '6' ? 3 : 1;
      if (pnm->kind <= '3') return check_ascii_pnm(bytes, *pnm, width * height * channels);
      const std::uint64_t row =
          pnm->kind == '4' ? (width + 7) / 8 : width * channels * (pnm->max_value > 255 ? 2 : 1);
      if (bytes.size() < pnm->data_at + row * height) return "truncated PNM";
      if (pnm->kind >= '5' && pnm->max_value != 255 && pnm->max_value != 65535)
        replacement = with_full_range(bytes, *pnm, width * height * channels);
      return {};
    }
    case ImageFormat::kTiff:
      return {};
  }
  return {};
}

}  // namespace tarsier
