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

// A cascade of boosted trees on upright Haar features (Viola and Jones, CVPR 2001; Lienhart,
// Kuranov and Pisarevsky, DAGM 2003), read from OpenCV's files. Finds the same windows as
// cv::CascadeClassifier on x86-64: windows with too low contrast are skipped, and so is the window
// after one that fails the first stage. Adjacent windows are evaluated together with vector
// instructions.
class HaarCascade {
 public:
  // Empty for another kind of file (LBP, tilted features, OpenCV 1, no cascade). Throws
  // cv::Exception if it is not an XML file.
  [[nodiscard]] static std::optional<HaarCascade> read(const std::string& path);

  // px; the smallest window.
  [[nodiscard]] cv::Size window() const { return window_; }

  // All windows that pass, by size, then by row and column. Sizes range from min to max (empty: the
  // image's), each `step` (above 1) times the previous one. If no size is in this range, the one
  // nearest to min is searched. `gray`: 8 bits. The result does not depend on the number of
  // threads.
  [[nodiscard]] std::vector<cv::Rect> find(const cv::Mat& gray, double step, cv::Size min,
                                           cv::Size max);

 private:
  // The image at one scale.
  struct Level {
    float scale = 1;  // of the window
    int step = 1;     // px between windows, in both directions
    int columns = 0;  // windows per row
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
  // For the two layouts of the integral images: plain rows, or rows with the even columns first and
  // then the odd ones. In the latter, windows two pixels apart are adjacent.
  std::array<std::vector<HaarNode>, 2> nodes_;
  std::array<RectOffsets, 2> inner_{};  // the window without its border
  int stride_ = 0;                      // row length of an integral image
};

// Merges similar boxes (each side within `eps` of their mean size) into their mean. Keeps results
// of more than `min` boxes, unless they are inside a result of more boxes. Same as
// cv::groupRectangles.
[[nodiscard]] std::vector<cv::Rect> grouped_boxes(const std::vector<cv::Rect>& boxes, int min,
                                                  double eps = 0.2);

}  // namespace tarsier::face
