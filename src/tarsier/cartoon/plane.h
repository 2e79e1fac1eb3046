// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/kernels.h"

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <new>
#include <vector>

namespace tarsier::cartoon {

// Allocates bytes at multiples of kRowSlack. Accesses that cross a cache line cost twice as much.
template <typename T>
struct AlignedAllocator {
  using value_type = T;
  AlignedAllocator() = default;
  template <typename U>
  AlignedAllocator(const AlignedAllocator<U>& /*other*/) {}  // NOLINT: converts as allocators do
  T* allocate(size_t n) {
    return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(kRowSlack)));
  }
  void deallocate(T* p, size_t /*n*/) { ::operator delete(p, std::align_val_t(kRowSlack)); }
  bool operator==(const AlignedAllocator& /*other*/) const { return true; }
};
using AlignedBytes = std::vector<std::uint8_t, AlignedAllocator<std::uint8_t>>;

// A grey image with the padding that the kernels need: kMargin pixels on every side, and a row
// pitch that is a multiple of 64 bytes. Keeps its memory while the size does not change.
class Plane {
 public:
  // Rows above and below; on the left and right there are at least 64 bytes.
  static constexpr int kMargin = 8;

  void resize(int width, int height) {
    if (width == width_ && height == height_) return;
    width_ = width;
    height_ = height;
    stride_ = (width + 2 * kRowSlack + 2 * kMargin + kRowSlack - 1) / kRowSlack * kRowSlack;
    bytes_.assign(static_cast<size_t>(stride_) * static_cast<size_t>(height + 2 * kMargin), 0);
  }

  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] std::ptrdiff_t stride() const { return stride_; }

  // y from -kMargin to height + kMargin - 1.
  [[nodiscard]] std::uint8_t* row(int y) {
    return bytes_.data() + (y + kMargin) * stride_ + kRowSlack;
  }
  [[nodiscard]] const std::uint8_t* row(int y) const {
    return bytes_.data() + (y + kMargin) * stride_ + kRowSlack;
  }

  // The image without its margin; shares the memory.
  [[nodiscard]] cv::Mat view() {
    return {height_, width_, CV_8UC1, row(0), static_cast<size_t>(stride_)};
  }

  // Fill the margin of one row, or of the rows above and below, from the image (at most kMargin
  // wide).
  void extend_row_by_copies(int y, int margin) {  // aaa|abc|ccc
    std::uint8_t* r = row(y);
    for (int i = 1; i <= margin; ++i) {
      r[-i] = r[0];
      r[width_ - 1 + i] = r[width_ - 1];
    }
  }
  void extend_row_by_reflection(int y, int margin) {  // cb|abc|ba
    std::uint8_t* r = row(y);
    if (width_ > margin) {
      for (int i = 1; i <= margin; ++i) {
        r[-i] = r[i];
        r[width_ - 1 + i] = r[width_ - 1 - i];
      }
      return;
    }
    for (int i = 1; i <= margin; ++i) {
      r[-i] = r[reflected(-i, width_)];
      r[width_ - 1 + i] = r[reflected(width_ - 1 + i, width_)];
    }
  }
  // Copies whole rows, so extend the rows themselves first.
  void extend_height_by_copies(int margin) {
    for (int i = 1; i <= margin; ++i) {
      copy_row(0, -i);
      copy_row(height_ - 1, height_ - 1 + i);
    }
  }
  void extend_height_by_reflection(int margin) {
    for (int i = 1; i <= margin; ++i) {
      copy_row(reflected(-i, height_), -i);
      copy_row(reflected(height_ - 1 + i, height_), height_ - 1 + i);
    }
  }

  // Mirrors an index i outside 0..size-1 without repeating the border pixel (any distance).
  static int reflected(int i, int size) {
    if (size == 1) return 0;
    const int period = 2 * size - 2;
    i = i < 0 ? -i : i;
    i %= period;
    return i < size ? i : period - i;
  }

 private:
  void copy_row(int from, int to) {
    std::memcpy(row(to) - kMargin, row(from) - kMargin, static_cast<size_t>(width_ + 2 * kMargin));
  }

  int width_ = 0;
  int height_ = 0;
  std::ptrdiff_t stride_ = 0;
  AlignedBytes bytes_;
};

}  // namespace tarsier::cartoon
