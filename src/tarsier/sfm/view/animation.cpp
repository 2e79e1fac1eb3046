// SPDX-License-Identifier: MIT
#include "animation.h"

#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <optional>
#include <string_view>
#include <unordered_map>

namespace tarsier::sfm {
namespace {

constexpr std::size_t kColors = 255;  // one index means "as in the previous frame"
constexpr std::uint8_t kUnchanged = 255;
constexpr std::size_t kMaxSamples = 200'000;
constexpr int kCodeBits = 8;  // bits of a pixel

std::uint32_t key_of(const cv::Vec3b& color) {
  return static_cast<std::uint32_t>(color[0] | color[1] << 8 | color[2] << 16);
}

// The colours of the frames, unless there are too many.
std::optional<std::vector<cv::Vec3b>> exact_palette(const std::vector<cv::Mat>& frames) {
  std::vector<cv::Vec3b> colors;
  std::unordered_map<std::uint32_t, bool> seen;
  for (const cv::Mat& frame : frames) {
    for (int y = 0; y < frame.rows; ++y) {
      const auto* row = frame.ptr<cv::Vec3b>(y);
      for (int x = 0; x < frame.cols; ++x) {
        if (x > 0 && row[x] == row[x - 1]) continue;
        if (!seen.emplace(key_of(row[x]), true).second) continue;
        if (colors.size() == kColors) return std::nullopt;
        colors.push_back(row[x]);
      }
    }
  }
  return colors;
}

// A range of the samples, represented by one colour.
struct Box {
  std::size_t begin = 0;
  std::size_t end = 0;
  cv::Vec3d mean;
  int axis = 0;      // the axis along which it is widest
  double error = 0;  // sum of squared deviations from the mean, along the axis
};

Box box_of(const std::vector<cv::Vec3b>& samples, std::size_t begin, std::size_t end) {
  Box box{begin, end, {}, 0, 0};
  cv::Vec3d sum;
  cv::Vec3d squares;
  for (std::size_t i = begin; i < end; ++i) {
    const cv::Vec3d x(samples[i]);
    sum += x;
    squares += x.mul(x);
  }
  const auto count = static_cast<double>(end - begin);
  box.mean = sum / count;
  for (int k = 0; k < 3; ++k) {
    const double error = squares[k] - sum[k] * box.mean[k];
    if (error > box.error) {
      box.error = error;
      box.axis = k;
    }
  }
  return box;
}

// Repeatedly splits the box with the largest error at its mean. A uniform background, however
// large, takes only one colour.
std::vector<cv::Vec3b> reduced_palette(const std::vector<cv::Mat>& frames) {
  const std::size_t pixels = frames.size() * frames[0].total();
  const std::size_t step = std::max<std::size_t>(1, pixels / kMaxSamples);
  std::vector<cv::Vec3b> samples;
  for (std::size_t i = 0; i < pixels; i += step) {
    // A constant step would sample columns at some widths.
    const std::size_t at = std::min(pixels - 1, i + i * 7919 % step);
    const cv::Mat& frame = frames[at / frames[0].total()];
    const std::size_t inside = at % frames[0].total();
    const auto columns = static_cast<std::size_t>(frame.cols);
    samples.push_back(frame.at<cv::Vec3b>(static_cast<int>(inside / columns),
                                          static_cast<int>(inside % columns)));
  }
  std::vector<Box> boxes{box_of(samples, 0, samples.size())};
  while (boxes.size() < kColors) {
    const auto largest_error = std::max_element(
        boxes.begin(), boxes.end(), [](const Box& a, const Box& b) { return a.error < b.error; });
    if (largest_error->error < 0.5) break;
    const Box box = *largest_error;
    const auto first = samples.begin();
    const auto split =
        std::partition(first + static_cast<std::ptrdiff_t>(box.begin),
                       first + static_cast<std::ptrdiff_t>(box.end),
                       [&](const cv::Vec3b& x) { return x[box.axis] <= box.mean[box.axis]; });
    const auto cut = static_cast<std::size_t>(split - first);
    *largest_error = box_of(samples, box.begin, cut);
    boxes.push_back(box_of(samples, cut, box.end));
  }
  std::vector<cv::Vec3b> colors;
  colors.reserve(boxes.size());
  for (const Box& box : boxes) colors.emplace_back(box.mean);
  return colors;
}

// Maps colours to the palette.
class Nearest {
 public:
  Nearest(std::vector<cv::Vec3b> palette, bool exact) : palette_(std::move(palette)) {
    if (exact) {
      for (std::size_t i = 0; i < palette_.size(); ++i)
        exact_[key_of(palette_[i])] = static_cast<std::uint8_t>(i);
    } else {
      known_.assign(std::size_t{1} << 18, -1);
    }
  }

  std::uint8_t operator()(const cv::Vec3b& color) {
    if (!exact_.empty()) return exact_.at(key_of(color));
    // Colours that differ by less than 4 share an entry.
    std::int16_t& known = known_[static_cast<std::size_t>((color[0] >> 2) << 12 |
                                                          (color[1] >> 2) << 6 | color[2] >> 2)];
    if (known < 0) {
      int min_distance = 1 << 30;
      for (std::size_t i = 0; i < palette_.size(); ++i) {
        const cv::Vec3i d = cv::Vec3i(palette_[i]) - cv::Vec3i(color);
        const int distance = d.dot(d);
        if (distance < min_distance) {
          min_distance = distance;
          known = static_cast<std::int16_t>(i);
        }
      }
    }
    return static_cast<std::uint8_t>(known);
  }

 private:
  std::vector<cv::Vec3b> palette_;
  std::unordered_map<std::uint32_t, std::uint8_t> exact_;
  std::vector<std::int16_t> known_;  // -1: not computed yet
};

// Writes bits in blocks of at most 255 bytes, lowest bit first.
class BlockWriter {
 public:
  explicit BlockWriter(std::string& out) : out_(out) {}
  void put(int code, int bits) {
    pending_ |= static_cast<std::uint32_t>(code) << count_;
    for (count_ += bits; count_ >= 8; count_ -= 8) {
      byte(static_cast<char>(pending_ & 255U));
      pending_ >>= 8;
    }
  }
  void finish() {
    if (count_ > 0) byte(static_cast<char>(pending_ & 255U));
    flush();
    out_ += '\0';
  }

 private:
  void byte(char c) {
    block_ += c;
    if (block_.size() == 255) flush();
  }
  void flush() {
    if (block_.empty()) return;
    out_ += static_cast<char>(block_.size());
    out_ += block_;
    block_.clear();
  }
  std::string& out_;
  std::string block_;
  std::uint32_t pending_ = 0;
  int count_ = 0;
};

// The codes of increasingly long strings: (code of all but the last pixel, last pixel) -> code.
class CodeTable {
 public:
  void clear() { slots_.fill({}); }
  // The entry of a string, or the free place for it.
  struct Slot {
    std::int32_t key = -1;
    std::int32_t code = 0;
  };
  Slot& find(int prefix, std::uint8_t pixel) {
    const std::int32_t key = prefix << 8 | pixel;
    auto at = static_cast<std::uint32_t>(key) * 2654435761U >> 18;  // 14 bits
    while (slots_[at].key != key && slots_[at].key != -1) at = (at + 1) & 16383U;
    return slots_[at];
  }

 private:
  std::array<Slot, 16384> slots_;
};

void write_pixels(const std::vector<std::uint8_t>& pixels, std::string& out) {
  constexpr int kClear = 1 << kCodeBits;
  constexpr int kEnd = kClear + 1;
  constexpr int kMaxCodes = 4096;
  out += static_cast<char>(kCodeBits);
  BlockWriter writer(out);
  CodeTable table;
  int next = kEnd + 1;
  int bits = kCodeBits + 1;
  writer.put(kClear, bits);
  int prefix = pixels[0];
  for (std::size_t i = 1; i < pixels.size(); ++i) {
    CodeTable::Slot& slot = table.find(prefix, pixels[i]);
    if (slot.key >= 0) {
      prefix = slot.code;
      continue;
    }
    writer.put(prefix, bits);
    if (next == kMaxCodes) {
      writer.put(kClear, bits);
      table.clear();
      next = kEnd + 1;
      bits = kCodeBits + 1;
    } else {
      if (next == 1 << bits) ++bits;
      slot = {prefix << 8 | pixels[i], next++};
    }
    prefix = pixels[i];
  }
  writer.put(prefix, bits);
  // The reader adds one more code at this point, and may need one more bit for it.
  if (next == 1 << bits && bits < 12) ++bits;
  writer.put(kEnd, bits);
  writer.finish();
}

void put_16(std::string& out, int value) {
  out += static_cast<char>(value & 255);
  out += static_cast<char>(value >> 8 & 255);
}

}  // namespace

void write_gif(const std::string& path, const std::vector<cv::Mat>& frames, double fps) {
  TARSIER_REQUIRE(!frames.empty(), "no frames");
  TARSIER_REQUIRE(fps >= 0.01 && fps <= 50, "{}", fps);
  const cv::Size size = frames[0].size();
  TARSIER_REQUIRE(!size.empty() && size.width <= 65535 && size.height <= 65535, "{} x {}",
                  size.width, size.height);
  for (const cv::Mat& frame : frames)
    TARSIER_REQUIRE(frame.type() == CV_8UC3 && frame.size() == size, "{} x {}, type {}", frame.cols,
                    frame.rows, frame.type());

  const auto exact_colors = exact_palette(frames);
  const std::vector<cv::Vec3b> palette = exact_colors ? *exact_colors : reduced_palette(frames);
  std::string out = "GIF89a";
  put_16(out, size.width);
  put_16(out, size.height);
  out += "\xf7";                       // a palette of 256 colours of 8 bits
  out += std::string_view("\0\0", 2);  // background, aspect ratio of a pixel
  for (std::size_t i = 0; i < 256; ++i) {
    const cv::Vec3b color = i < palette.size() ? palette[i] : cv::Vec3b();
    for (int k = 2; k >= 0; --k) out += static_cast<char>(color[k]);
  }
  out += std::string_view("\x21\xff\x0bNETSCAPE2.0\x03\x01\0\0\0", 19);  // repeat forever

  Nearest nearest(palette, exact_colors.has_value());
  std::vector<std::uint8_t> previous;
  std::vector<std::uint8_t> current(frames[0].total());
  std::vector<std::uint8_t> written(current.size());
  for (std::size_t i = 0; i < frames.size(); ++i) {
    std::size_t at = 0;
    for (int y = 0; y < size.height; ++y) {
      const auto* row = frames[i].ptr<cv::Vec3b>(y);
      for (int x = 0; x < size.width; ++x, ++at) {
        current[at] = nearest(row[x]);
        written[at] = !previous.empty() && previous[at] == current[at] ? kUnchanged : current[at];
      }
    }
    // Rounded over the whole animation, so that its speed is exact.
    const auto until = [fps](std::size_t n) {
      return std::lround(100.0 * static_cast<double>(n) / fps);
    };
    // keep the previous frame, one transparent index
    out += std::string_view("\x21\xf9\x04\x05", 4);
    put_16(out, static_cast<int>(std::clamp(until(i + 1) - until(i), 2L, 65535L)));
    out += static_cast<char>(kUnchanged);
    out += std::string_view("\0\x2c\0\0\0\0", 6);
    put_16(out, size.width);
    put_16(out, size.height);
    out += '\0';
    write_pixels(written, out);
    previous = current;
  }
  out += '\x3b';
  write_file_atomically(path, std::string_view(out));
}

}  // namespace tarsier::sfm
