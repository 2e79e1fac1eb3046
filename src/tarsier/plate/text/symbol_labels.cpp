// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/symbol_labels.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/reading.h"

#include <fmt/format.h>

#include <array>
#include <cmath>

namespace tarsier::plate {

std::vector<SymbolLabel> parse_symbol_labels(std::string_view text, const std::string& name) {
  std::vector<SymbolLabel> labels;
  for (int number = 1; !text.empty(); ++number) {
    std::string_view line = trimmed(next_line(text));
    if (line.empty()) continue;
    const auto class_id = to_integer(next_word(line), 0, kBlank - 1);
    std::array<double, 4> box{};
    bool is_valid = class_id.has_value();
    for (double& value : box) {
      const auto read = to_number(next_word(line));
      is_valid = is_valid && read && std::abs(*read) < 2;
      value = read.value_or(0);
    }
    if (!is_valid || box[2] <= 0 || box[3] <= 0)
      throw InputError(name,
                       fmt::format("line {}: expected class 0..35 and x y w h in 0..1", number));
    labels.push_back({static_cast<int>(*class_id), box[0], box[1], box[2], box[3]});
  }
  return labels;
}

std::string symbol_labels_text(std::string_view text, const std::vector<cv::Rect2f>& boxes,
                               cv::Size image) {
  TARSIER_REQUIRE(text.size() == boxes.size(), "{} boxes of {} symbols", boxes.size(), text.size());
  const auto cols = static_cast<float>(image.width);
  const auto rows = static_cast<float>(image.height);
  std::string lines;
  for (std::size_t k = 0; k < boxes.size(); ++k) {
    const cv::Rect2f& box = boxes[k];
    lines +=
        fmt::format("{} {:.5f} {:.5f} {:.5f} {:.5f}\n", class_of(text[k]),
                    (box.x + box.width / 2 + 0.5F) / cols, (box.y + box.height / 2 + 0.5F) / rows,
                    box.width / cols, box.height / rows);
  }
  return lines;
}

std::vector<SymbolLabel> read_symbol_labels(const std::string& path) {
  constexpr std::int64_t kMaxBytes = 1'000'000;
  return parse_symbol_labels(read_file(path, kMaxBytes), path);
}

}  // namespace tarsier::plate
