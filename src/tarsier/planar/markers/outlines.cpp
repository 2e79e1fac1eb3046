// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/outlines.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

namespace tarsier::planar::markers {
namespace {

constexpr int kTile = 4;
constexpr int kMaxRuns = 7;  // mean per row of a component; more is foliage

constexpr int kNoiseMargin = 3;
constexpr int kMaxNoise = 64;  // grey levels; more is an image without a flat region

using Bytes = std::vector<std::uint8_t>;

std::size_t size(int n) { return static_cast<std::size_t>(n); }

struct Tiles {
  int columns;
  int rows;
};

// Darkest and brightest pixel of each tile. The last tiles may be smaller.
void tile_extremes(const cv::Mat& gray, const Tiles& tiles, Bytes& lows, Bytes& highs) {
  lows.resize(size(tiles.columns) * size(tiles.rows));
  highs.resize(lows.size());
  // The extremes of the columns of one row of tiles, padded to whole tiles.
  const std::size_t columns = size(gray.cols);
  const std::size_t padded_width = size(tiles.columns * kTile);
  Bytes low_row(padded_width);
  Bytes high_row(padded_width);
  // Local pointers, so that the compiler can exclude aliasing with the written bytes.
  auto* const low = low_row.data();
  auto* const high = high_row.data();
  for (int row = 0; row < tiles.rows; ++row) {
    const int top = row * kTile;
    const auto* line = gray.ptr<std::uint8_t>(top);
    std::memcpy(low, line, columns);
    std::memcpy(high, line, columns);
    for (int y = top + 1; y < std::min(gray.rows, top + kTile); ++y) {
      line = gray.ptr<std::uint8_t>(y);
      for (std::size_t x = 0; x < columns; ++x) {
        low[x] = std::min(low[x], line[x]);
        high[x] = std::max(high[x], line[x]);
      }
    }
    for (std::size_t x = columns; x < padded_width; ++x) {
      low[x] = low[x - 1];
      high[x] = high[x - 1];
    }
    auto* to_low = lows.data() + size(row) * size(tiles.columns);
    auto* to_high = highs.data() + size(row) * size(tiles.columns);
    for (std::size_t i = 0; i < padded_width / kTile; ++i) {
      const auto* a = low + i * kTile;
      const auto* b = high + i * kTile;
      to_low[i] = std::min(std::min(a[0], a[1]), std::min(a[2], a[3]));
      to_high[i] = std::max(std::max(b[0], b[1]), std::max(b[2], b[3]));
    }
  }
}

// Extremes over the 3 x 3 tiles around each tile.
template <typename Better>
void spread(const Bytes& from, const Tiles& tiles, Bytes& to, Better better) {
  to.resize(from.size());
  const std::size_t columns = size(tiles.columns);
  Bytes middle_row(columns);
  auto* const middle = middle_row.data();
  for (int row = 0; row < tiles.rows; ++row) {
    const auto* above = &from[size(std::max(0, row - 1)) * columns];
    const auto* here = &from[size(row) * columns];
    const auto* below = &from[size(std::min(tiles.rows - 1, row + 1)) * columns];
    for (std::size_t i = 0; i < columns; ++i)
      middle[i] = better(above[i], better(here[i], below[i]));
    auto* out = &to[size(row) * columns];
    out[0] = better(middle[0], middle[std::min<std::size_t>(1, columns - 1)]);
    for (std::size_t i = 1; i + 1 < columns; ++i)
      out[i] = better(middle[i - 1], better(middle[i], middle[i + 1]));
    if (columns > 1) out[columns - 1] = better(middle[columns - 2], middle[columns - 1]);
  }
}

// Differences of brightness below this are indistinguishable from noise: the range of tiles that
// show only noise (at least a fifth of the tiles of most images), with a margin.
int noise_contrast(const Bytes& lows, const Bytes& highs) {
  std::array<std::size_t, 256> counts{};
  for (std::size_t i = 0; i < lows.size(); ++i) ++counts[size(highs[i] - lows[i])];
  std::size_t sum = 0;
  int spread = 0;
  while (5 * (sum += counts[size(spread)]) < lows.size()) ++spread;
  return std::min(kMaxNoise, spread + spread / kNoiseMargin);
}

// The mask of dark pixels, with a border of one non-dark pixel.
void binarize(const cv::Mat& gray, int min_contrast, OutlineWorkspace& w) {
  const Tiles tiles{(gray.cols + kTile - 1) / kTile, (gray.rows + kTile - 1) / kTile};
  tile_extremes(gray, tiles, w.lows, w.highs);
  spread(w.lows, tiles, w.spread_lows, [](auto a, auto b) { return std::min(a, b); });
  spread(w.highs, tiles, w.spread_highs, [](auto a, auto b) { return std::max(a, b); });
  min_contrast = std::max(min_contrast, noise_contrast(w.spread_lows, w.spread_highs));
  const std::size_t columns = size(gray.cols);
  const std::size_t stride = columns + 2;
  // Rows are read eight pixels at a time, hence the extra bytes at the end.
  w.dark.assign(stride * (size(gray.rows) + 2) + 8, 0);
  w.thresholds.resize(size(tiles.columns * kTile));
  auto* const thresholds = w.thresholds.data();
  for (int row = 0; row < tiles.rows; ++row) {
    const auto* low = &w.spread_lows[size(row) * size(tiles.columns)];
    const auto* high = &w.spread_highs[size(row) * size(tiles.columns)];
    for (std::size_t i = 0; i < size(tiles.columns); ++i) {
      const int middle = (low[i] + high[i] + 1) / 2;
      const auto threshold =
          static_cast<std::uint8_t>(high[i] - low[i] < min_contrast ? 0 : middle);
      std::memset(thresholds + i * kTile, threshold, kTile);
    }
    for (int y = row * kTile; y < std::min(gray.rows, (row + 1) * kTile); ++y) {
      const auto* line = gray.ptr<std::uint8_t>(y);
      auto* dark = &w.dark[(size(y) + 1) * stride + 1];
      for (std::size_t x = 0; x < columns; ++x) dark[x] = line[x] < thresholds[x] ? 255 : 0;
    }
  }
}

int root_of(std::vector<OutlineWorkspace::Component>& components, int component) {
  while (components[size(component)].parent != component) {
    auto& t = components[size(component)];
    t.parent = components[size(t.parent)].parent;
    component = t.parent;
  }
  return component;
}

// Merges two components; the earlier one represents both.
int join(std::vector<OutlineWorkspace::Component>& components, int a, int b) {
  a = root_of(components, a);
  b = root_of(components, b);
  if (b < a) std::swap(a, b);
  components[size(b)].parent = a;
  return a;
}

// Writes to `changes` the positions where a row of 0 and 255 changes, from the left, and returns
// their number. Reads up to seven bytes after the row.
int find_changes(const std::uint8_t* row, int columns, int* changes) {
  std::uint64_t carry = 0;
  int count = 0;
  for (int x0 = 0; x0 < columns; x0 += 64) {
    // 64 pixels as bits: a multiplication gathers the lowest bits of eight bytes at a time.
    std::uint64_t bits = 0;
    const int n = std::min(64, columns - x0);
    for (int k = 0; k < n; k += 8) {
      std::uint64_t eight = 0;
      std::memcpy(&eight, row + x0 + k, 8);
      if constexpr (std::endian::native == std::endian::big) eight = __builtin_bswap64(eight);
      const std::uint64_t gathered =
          ((eight & 0x0101010101010101ULL) * 0x0102040810204080ULL) >> 56U;
      bits |= gathered << static_cast<unsigned>(k);
    }
    if (n < 64) bits &= (std::uint64_t{1} << static_cast<unsigned>(n)) - 1;
    std::uint64_t differ = bits ^ ((bits << 1U) | carry);
    carry = bits >> 63U;
    while (differ != 0) {
      changes[count++] = x0 + std::countr_zero(differ);
      differ &= differ - 1;
    }
  }
  return count;
}

// Row by row: a run belongs to the component of the run that it touches above, and merges all
// components that it touches. Component data are accumulated on the way.
void find_things(int columns, int rows, OutlineWorkspace& w) {
  w.components.clear();
  w.above.clear();
  w.changes.resize(size(columns) + 2);
  const std::size_t stride = size(columns) + 2;
  for (int y = 0; y < rows; ++y) {
    w.here.clear();
    // Includes one column of the border, so that runs at the right edge end there.
    const int changes =
        find_changes(&w.dark[(size(y) + 1) * stride + 1], columns + 1, w.changes.data());
    std::size_t up = 0;
    for (int i = 0; i < changes; i += 2) {
      const int first = w.changes[size(i)];
      const int last = w.changes[size(i) + 1] - 1;
      while (up < w.above.size() && w.above[up].last < first) ++up;
      int component = -1;
      for (std::size_t k = up; k < w.above.size() && w.above[k].first <= last; ++k) {
        const int other = w.above[k].component;
        if (component < 0)
          component = other;
        else if (component != other)
          component = join(w.components, component, other);
      }
      if (component < 0) {
        component = static_cast<int>(w.components.size());
        w.components.push_back({component, first, y, first, last, y, 1});
      } else {
        auto& t = w.components[size(component)];
        t.left = std::min(t.left, first);
        t.right = std::max(t.right, last);
        t.bottom = y;
        ++t.runs;
      }
      w.here.push_back({first, last, component});
    }
    std::swap(w.above, w.here);
  }
  // Merged components are added to the earliest one; later ones first.
  for (std::size_t i = w.components.size(); i-- > 0;) {
    const auto& t = w.components[i];
    if (t.parent == static_cast<int>(i)) continue;
    auto& parent = w.components[size(t.parent)];
    parent.left = std::min(parent.left, t.left);
    parent.right = std::max(parent.right, t.right);
    parent.bottom = std::max(parent.bottom, t.bottom);
    parent.runs += t.runs;
  }
}

// Directions: right, down, left, up. In `dark`, bit k is set if the neighbour in direction k is
// dark. kNextDirection[d][dark] is the first dark direction clockwise after d; 4 if there is none.
constexpr std::array<std::array<std::uint8_t, 16>, 4> kNextDirection = [] {
  std::array<std::array<std::uint8_t, 16>, 4> next{};
  for (unsigned direction = 0; direction < 4; ++direction) {
    for (unsigned dark = 0; dark < 16; ++dark) {
      next[direction][dark] = 4;
      for (unsigned k = 4; k >= 1; --k) {
        const unsigned heading = (direction + k) % 4;
        if ((dark >> heading) & 1U) next[direction][dark] = static_cast<std::uint8_t>(heading);
      }
    }
  }
  return next;
}();

// Traces the outer border from the first pixel, with the outside on the left; false if it is longer
// than `longest`.
bool trace(const OutlineWorkspace::Component& component, int columns, std::size_t longest,
           OutlineWorkspace& w) {
  const std::ptrdiff_t stride = columns + 2;
  constexpr std::array<int, 4> kX{1, 0, -1, 0};
  constexpr std::array<int, 4> kY{0, 1, 0, -1};
  const std::array<std::ptrdiff_t, 4> step{1, stride, -1, -stride};
  const std::uint8_t* const start = w.dark.data() + (component.y + 1) * stride + component.x + 1;
  const auto darkness = [stride](const std::uint8_t* p) {
    return static_cast<unsigned>((p[1] & 1) | (p[stride] & 2) | (p[-1] & 4) | (p[-stride] & 8));
  };
  // No pixel of the component lies above, or to the left in this row: starts from the left,
  // clockwise.
  const std::size_t first_heading = kNextDirection[2][darkness(start)];
  if (first_heading == 4) return false;  // one pixel
  const std::size_t begin = w.points.size();
  w.points.resize(begin + longest);
  cv::Point* out = w.points.data() + begin;
  const cv::Point* const end = out + longest;
  const std::uint8_t* at = start;
  cv::Point position(component.x, component.y);
  std::size_t heading = first_heading;
  do {
    if (out == end) return false;
    *out++ = position;
    at += step[heading];
    position.x += kX[heading];
    position.y += kY[heading];
    heading = kNextDirection[(heading + 2) % 4][darkness(at)];  // from the previous pixel
  } while (at != start || heading != first_heading);
  w.points.resize(static_cast<std::size_t>(out - w.points.data()));
  return true;
}

}  // namespace

void find_dark_outlines(const cv::Mat& gray, const OutlineOptions& options, OutlineWorkspace& w) {
  options.check();
  TARSIER_REQUIRE(gray.type() == CV_8UC1, "an image that is not grey");
  w.points.clear();
  w.outlines.clear();
  if (gray.empty()) return;
  binarize(gray, options.min_contrast, w);
  find_things(gray.cols, gray.rows, w);
  for (std::size_t i = 0; i < w.components.size(); ++i) {
    const auto& component = w.components[i];
    if (component.parent != static_cast<int>(i)) continue;
    const int width = component.right - component.left + 1;
    const int height = component.bottom - component.y + 1;
    if (std::max(width, height) < options.min_size) continue;
    if (3 * std::min(width, height) < options.min_size) continue;
    if (component.runs > kMaxRuns * height) continue;
    // The border of a convex component is at most twice as long; the margin is for noise.
    const std::size_t longest = 3 * size(width + height);
    const std::size_t begin = w.points.size();
    if (trace(component, gray.cols, longest, w))
      w.outlines.push_back({begin, w.points.size() - begin});
    else
      w.points.resize(begin);
  }
}

}  // namespace tarsier::planar::markers
