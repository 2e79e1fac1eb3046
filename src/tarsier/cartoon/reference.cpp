// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/reference.h"

#include "tarsier/cartoon/skin.h"
#include "tarsier/core/image.h"

#include <opencv2/imgproc.hpp>

#include <utility>

namespace tarsier::cartoon::reference {
namespace {

bool border_is_white(const cv::Mat& mask, int x, int y) {
  for (int dy = -2; dy <= 2; ++dy) {
    const auto* row = mask.ptr(y + dy);
    const bool whole_row = dy == -2 || dy == 2;
    for (int dx = -2; dx <= 2; dx += whole_row ? 1 : 4) {
      if (row[x + dx] == 0) return false;
    }
  }
  return true;
}

cv::Mat masked(const cv::Mat& image, const cv::Mat& mask) {
  cv::Mat result(image.size(), CV_8UC3, cv::Scalar::all(0));
  image.copyTo(result, mask);
  return result;
}

cv::Mat enlarged(const cv::Mat& small, cv::Size size) {
  cv::Mat result;
  cv::resize(small, result, size, 0, 0, cv::INTER_LINEAR);
  return result;
}

cv::Mat gray_to_bgr(const cv::Mat& mask) {
  cv::Mat result;
  cv::cvtColor(mask, result, cv::COLOR_GRAY2BGR);
  return result;
}

}  // namespace

cv::Mat smooth_gray(const cv::Mat& frame, const SketchOptions& options) {
  require_bgr(frame);
  cv::Mat gray;
  cv::cvtColor(frame, gray, cv::COLOR_BGR2GRAY);
  cv::Mat smooth;
  cv::medianBlur(gray, smooth, options.median_size);
  return smooth;
}

cv::Mat line_response(const cv::Mat& gray, const SketchOptions& options) {
  cv::Mat response;
  cv::Laplacian(gray, response, CV_8U, options.laplacian_size);
  return response;
}

cv::Mat evil_response(const cv::Mat& gray, const EvilOptions& options) {
  cv::Mat edges;
  cv::Mat part;
  cv::Scharr(gray, edges, CV_8U, 1, 0);
  cv::Scharr(gray, part, CV_8U, 1, 0, -1);
  edges += part;
  if (options.both_axes) {
    for (const double sign : {1.0, -1.0}) {
      cv::Scharr(gray, part, CV_8U, 0, 1, sign);
      edges += part;
    }
  }
  return edges;
}

void remove_pepper(cv::Mat& mask) {
  require_gray(mask);
  const cv::Mat before = mask.clone();
  for (int y = 2; y < mask.rows - 2; ++y) {
    const auto* row = before.ptr(y);
    for (int x = 2; x < mask.cols - 2; ++x) {
      if (row[x] == 0 && border_is_white(before, x, y)) {
        mask(cv::Rect(x - 1, y - 1, 3, 3)).setTo(255);
      }
    }
  }
}

cv::Mat sketch_mask(const cv::Mat& frame, const SketchOptions& options) {
  cv::Mat mask;
  cv::threshold(line_response(smooth_gray(frame, options), options), mask, options.threshold, 255,
                cv::THRESH_BINARY_INV);
  if (options.remove_pepper) remove_pepper(mask);
  return mask;
}

cv::Mat evil_mask(const cv::Mat& frame, const SketchOptions& sketch, const EvilOptions& options) {
  cv::Mat mask;
  cv::threshold(evil_response(smooth_gray(frame, sketch), options), mask, options.threshold, 255,
                cv::THRESH_BINARY_INV);
  if (options.median_size > 1) {
    cv::Mat smooth;
    cv::medianBlur(mask, smooth, options.median_size);
    mask = smooth;
  }
  return mask;
}

cv::Mat paint_small(const cv::Mat& frame, const PaintOptions& options) {
  require_bgr(frame);
  cv::Mat small;
  cv::resize(frame, small, cv::Size(frame.cols / 2, frame.rows / 2), 0, 0, cv::INTER_LINEAR);
  cv::Mat other;
  for (int i = 0; i < 2 * options.rounds; ++i) {
    cv::bilateralFilter(small, other, options.diameter, options.sigma_color, options.sigma_space);
    std::swap(small, other);
  }
  return small;
}

cv::Mat cartoonize(const cv::Mat& frame, const CartoonOptions& options) {
  require_bgr(frame);
  options.check();
  const cv::Size size = frame.size();
  switch (options.mode) {
    case Mode::kNone:
      return frame.clone();
    case Mode::kSketch:
      return gray_to_bgr(sketch_mask(frame, options.sketch));
    case Mode::kEvilSketch:
      return gray_to_bgr(evil_mask(frame, options.sketch, options.evil));
    case Mode::kPaint:
      return enlarged(paint_small(frame, options.paint), size);
    case Mode::kCartoon:
      return masked(enlarged(paint_small(frame, options.paint), size),
                    sketch_mask(frame, options.sketch));
    case Mode::kEvil:
      return masked(enlarged(paint_small(frame, options.paint), size),
                    evil_mask(frame, options.sketch, options.evil));
    case Mode::kAlien:
    case Mode::kSmooth:
      break;
  }
  const cv::Mat gray = smooth_gray(frame, options.sketch);
  const cv::Mat response = line_response(gray, options.sketch);
  cv::Mat small = paint_small(frame, options.paint);
  SkinBuffers buffers;
  const cv::Mat skin = find_skin(small, response, options.skin, buffers);
  if (options.mode == Mode::kSmooth) {
    cv::Mat result;
    smooth_skin(frame, enlarged(small, size), skin, buffers, result);
    return result;
  }
  color_skin(small, skin, options.skin);
  cv::Mat mask;
  cv::threshold(response, mask, options.sketch.threshold, 255, cv::THRESH_BINARY_INV);
  if (options.sketch.remove_pepper) remove_pepper(mask);
  return masked(enlarged(small, size), mask);
}

}  // namespace tarsier::cartoon::reference
