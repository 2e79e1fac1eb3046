// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <string>
#include <string_view>
#include <vector>

// Labels of the symbols in a plate image, in the format of YOLO training data: NAME.txt beside
// NAME.png, with one line "CLASS X Y W H" per symbol.
namespace tarsier::plate {

struct SymbolLabel {
  int class_id = 0;  // class number, 0..kBlank-1 (reading.h)
  // Centre and size of the box, relative to the image's width and height: x, y within +-2, w, h in
  // (0, 2).
  double x = 0;
  double y = 0;
  double w = 0;
  double h = 0;
};

// Skips empty lines and ignores words after the fifth. Throws InputError, which names `name` and
// the line.
[[nodiscard]] std::vector<SymbolLabel> parse_symbol_labels(std::string_view text,
                                                           const std::string& name);
// Writes the lines of such a file, with one box (px) for each symbol of `text` (of kAlphabet).
// Throws std::invalid_argument if the number of boxes differs.
[[nodiscard]] std::string symbol_labels_text(std::string_view text,
                                             const std::vector<cv::Rect2f>& boxes, cv::Size image);
// Reads a file of at most 1 MB. Throws InputError.
[[nodiscard]] std::vector<SymbolLabel> read_symbol_labels(const std::string& path);

}  // namespace tarsier::plate
