// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/symbol_labels.h"

#include "tarsier/core/errors.h"
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
    const auto kind = to_integer(next_word(line), 0, kBlank - 1);
    std::array<double, 4> box{};
    bool sane = kind.has_value();
    for (double& value : box) {
      const auto read = to_number(next_word(line));
      sane = sane && read && std::abs(*read) < 2;
      value = read.value_or(0);
    }
    if (!sane || box[2] <= 0 || box[3] <= 0)
      throw InputError(name,
                       fmt::format("line {}: expected class 0..35 and x y w h in 0..1", number));
    labels.push_back({static_cast<int>(*kind), box[0], box[1], box[2], box[3]});
  }
  return labels;
}

std::vector<SymbolLabel> read_symbol_labels(const std::string& path) {
  constexpr std::int64_t kMaxBytes = 1'000'000;
  return parse_symbol_labels(read_file(path, kMaxBytes), path);
}

}  // namespace tarsier::plate
