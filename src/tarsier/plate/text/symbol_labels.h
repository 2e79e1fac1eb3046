// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <string>
#include <string_view>
#include <vector>

// Symbols marked in the image of a plate as the trainers of YOLO networks want them: beside
// NAME.png a NAME.txt, a line "CLASS X Y W H" for each symbol.
namespace tarsier::plate {

struct SymbolLabel {
  int kind = 0;  // class number, 0..kBlank-1 (reading.h)
  // The middle and the size of its box, in parts of the image's width and height: x, y within
  // +-2, w, h in (0, 2).
  double x = 0;
  double y = 0;
  double w = 0;
  double h = 0;
};

// Empty lines are passed over, words after the fifth too. Throws InputError that names `name` and
// the line.
[[nodiscard]] std::vector<SymbolLabel> parse_symbol_labels(std::string_view text,
                                                           const std::string& name);
// The lines of such a file: a box, px, for each symbol of `text` (of kAlphabet). Throws
// std::invalid_argument for another number of boxes.
[[nodiscard]] std::string symbol_labels_text(std::string_view text,
                                             const std::vector<cv::Rect2f>& boxes, cv::Size image);
// Of a file of at most 1 MB. Throws InputError.
[[nodiscard]] std::vector<SymbolLabel> read_symbol_labels(const std::string& path);

}  // namespace tarsier::plate
