// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/enlarge.h"

#include "tarsier/cartoon/kernels.h"
#include "tarsier/cartoon/rows.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::cartoon {
namespace {

// Lines are sparse: whole words without a line are skipped.
void draw_lines(const Plane& mask, cv::Mat& image) {
  const int width = image.cols;
  for_row_bands(image.rows, [&](int first, int last) {
    for (int y = first; y < last; ++y) {
      const std::uint8_t* lines = mask.row(y);
      auto* out = image.ptr<cv::Vec3b>(y);
      int x = 0;
      for (; x + 8 <= width; x += 8) {
        std::uint64_t word = 0;
        std::memcpy(&word, lines + x, 8);
        if (~word == 0) continue;
        for (int i = x; i < x + 8; ++i) {
          if (lines[i] == 0) out[i] = {0, 0, 0};
        }
      }
      for (; x < width; ++x) {
        if (lines[x] == 0) out[x] = {0, 0, 0};
      }
    }
  });
}

}  // namespace

void Enlarger::enlarge(const cv::Mat& small, const Plane* mask, cv::Mat& large) {
  require_bgr(small);
  require_bgr(large);
  TARSIER_REQUIRE(mask == nullptr || (mask->width() == large.cols && mask->height() == large.rows),
                  "the mask is not of the size of the image, {}x{}", large.cols, large.rows);
  if (large.cols != 2 * small.cols || large.rows != 2 * small.rows || !kernels().vectorized) {
    cv::resize(small, large, large.size(), 0, 0, cv::INTER_LINEAR);
    if (mask != nullptr) draw_lines(*mask, large);
    return;
  }
  const Kernels& kernel = kernels();
  const int width = small.cols;
  scratch_.resize(std::max(scratch_.size(), static_cast<size_t>(number_of_bands(small.rows))));
  for_row_bands(small.rows, [&](int band, int first, int last) {
    std::array<Plane, 3>& planes = scratch_[static_cast<size_t>(band)];
    for (Plane& plane : planes) plane.resize(width, 3);
    // Beyond the image, rows are clamped to its border, like columns.
    const auto within = [&](int y) { return std::clamp(y, 0, small.rows - 1); };
    const auto split = [&](int y) {
      const int turn = (y + 3) % 3;
      std::uint8_t* const rows[3] = {planes[0].row(turn), planes[1].row(turn), planes[2].row(turn)};
      kernel.split_row(small.ptr(within(y)), rows, width);
      for (Plane& plane : planes) plane.extend_row_by_copies(turn, 1);
    };
    split(first - 1);
    split(first);
    for (int y = first; y < last; ++y) {
      split(y + 1);
      const auto row = [&](int of) {
        const int turn = (of + 3) % 3;
        return std::array<const std::uint8_t*, 3>{planes[0].row(turn), planes[1].row(turn),
                                                  planes[2].row(turn)};
      };
      const auto near = row(y);
      for (const int half : {0, 1}) {
        const int out = 2 * y + half;
        const auto far = row(half == 0 ? y - 1 : y + 1);
        kernel.enlarge_row(near.data(), far.data(), mask != nullptr ? mask->row(out) : nullptr,
                           large.ptr(out), width);
      }
    }
  });
}

}  // namespace tarsier::cartoon
