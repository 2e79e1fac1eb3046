// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/haar_kernels.h"

#include <opencv2/core.hpp>

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face {

// A cascade of boosted trees on upright Haar features (Viola and Jones, CVPR 2001; Lienhart, Kuranov and Pisarevsky,
// DAGM 2003), as OpenCV's files hold it. Finds the same windows as cv::CascadeClassifier does on x86-64: a window of
// which the contrast is too low is left out, and after one that fails the first stage the next one is, too. Windows side
// by side are judged together, in vectors.
class HaarCascade {
 public:
  // Empty for a file of another kind (LBP, tilted features, OpenCV 1, no cascade). Throws cv::Exception where it is no
  // XML file.
  [[nodiscard]] static std::optional<HaarCascade> read(const std::string& path);

  // px; the smallest window.
  [[nodiscard]] cv::Size window() const { return window_; }

  // All windows that pass, by size, then by row and column: of sizes min to max (empty: the image's), each `step` (above
  // 1) times the one before. Where no size is between them, the nearest to min is searched. `gray`: 8 bits. The same for
  // any number of threads.
  [[nodiscard]] std::vector<cv::Rect> find(const cv::Mat& gray, double step, cv::Size min,
                                           cv::Size max);

 private:
  // The image at one size.
  struct Level {
    float scale = 1;  // of the window
    int step = 1;     // px between windows, in both directions
    int columns = 0;  // windows in a row
    int rows = 0;
    cv::Mat1i sum;
    cv::Mat1i squares;
  };
  [[nodiscard]] std::vector<float> scales_between(cv::Size image, double step, cv::Size min,
                                                  cv::Size max) const;
  void prepare(const cv::Mat& gray, Level& level) const;
  void lay_out(int stride);
  [[nodiscard]] RectOffsets offsets_of(const cv::Rect& rect, bool split) const;
  void search_row(const Level& level, int row, std::vector<cv::Rect>& found) const;

  cv::Size window_;
  std::vector<std::array<cv::Rect, 3>> rects_;  // of each node
  std::vector<HaarStage> stages_;
  std::vector<HaarTree> trees_;
  // By how the integral images are laid out: each row as it is, or its even columns, then its odd ones, so that windows
  // two pixels apart lie side by side.
  std::array<std::vector<HaarNode>, 2> nodes_;
  std::array<RectOffsets, 2> inner_{};  // the window without its border
  int stride_ = 0;                      // numbers in a row of an integral image
};

// Boxes that are alike (each side within `eps` of their mean size) become their mean; those of more than `min` boxes are
// kept, unless they lie within one of more boxes. As cv::groupRectangles.
[[nodiscard]] std::vector<cv::Rect> grouped_boxes(const std::vector<cv::Rect>& boxes, int min,
                                                  double eps = 0.2);

}  // namespace tarsier::face
