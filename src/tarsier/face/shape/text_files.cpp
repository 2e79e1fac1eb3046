// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/text_files.h"

#include "tarsier/core/errors.h"
#include "tarsier/face/shape/markup_check.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <string_view>

namespace tarsier::face::shape {

namespace {

constexpr std::int64_t kMaxBytes = 64'000'000;
constexpr int kMaxShapes = 1000000;

// Lines of numbers, without empty lines and comments.
class NumberLines {
 public:
  NumberLines(const std::string& path, std::string_view text) : path_(path), rest_(text) {}

  // The numbers of the next line; empty at the end.
  std::optional<std::vector<double>> next() {
    while (!rest_.empty()) {
      const std::size_t end = std::min(rest_.find('\n'), rest_.size());
      std::string_view line = rest_.substr(0, end);
      rest_.remove_prefix(std::min(end + 1, rest_.size()));
      ++line_;
      line = line.substr(0, line.find('#'));
      std::vector<double> numbers = parse(line);
      if (!numbers.empty()) return numbers;
    }
    return std::nullopt;
  }
  [[noreturn]] void fail(const std::string& reason) const {
    throw InputError(path_, fmt::format("line {}: {}", line_, reason));
  }

 private:
  [[nodiscard]] std::vector<double> parse(std::string_view line) const {
    constexpr std::string_view kSpace = " \t\r,;";
    std::vector<double> numbers;
    for (;;) {
      const std::size_t first = line.find_first_not_of(kSpace);
      if (first == std::string_view::npos) return numbers;
      line.remove_prefix(first);
      double value = 0;
      const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), value);
      const auto used = static_cast<std::size_t>(end - line.data());
      if (error != std::errc() ||
          (used < line.size() && kSpace.find(line[used]) == std::string_view::npos) ||
          !std::isfinite(value) || std::abs(value) > kMaxCoordinate)
        fail("a number of at most 10 000 000 was expected");
      numbers.push_back(value);
      line.remove_prefix(used);
    }
  }

  const std::string& path_;
  std::string_view rest_;
  int line_ = 0;
};

bool is_count(double value, int low, int high) {
  return value == std::floor(value) && value >= low && value <= high;
}

}  // namespace

std::vector<Eigen::Matrix2Xd> read_text_shapes(const std::string& path) {
  const std::string text = read_file(path, kMaxBytes);
  NumberLines lines(path, text);
  const auto head = lines.next();
  if (!head) throw InputError(path, "is empty; 'N 2k' and N lines of x y pairs are expected");
  if (head->size() != 2 || !is_count((*head)[0], 1, kMaxShapes) ||
      !is_count((*head)[1], 6, 2 * kMaxPoints) || static_cast<int>((*head)[1]) % 2 != 0)
    lines.fail("'N 2k' is expected: the number of shapes, and of numbers in each");
  const auto count = static_cast<std::size_t>((*head)[0]);
  const auto numbers = static_cast<std::size_t>((*head)[1]);
  std::vector<Eigen::Matrix2Xd> shapes;
  while (const auto line = lines.next()) {
    if (line->size() != numbers)
      lines.fail(fmt::format("{} numbers, {} are expected", line->size(), numbers));
    if (shapes.size() == count) lines.fail(fmt::format("more than the {} shapes stated", count));
    shapes.emplace_back(Eigen::Map<const Eigen::Matrix2Xd>(line->data(), 2,
                                                           static_cast<Eigen::Index>(numbers / 2)));
  }
  if (shapes.size() != count)
    throw InputError(path, fmt::format("ends after {} of {} shapes", shapes.size(), count));
  return shapes;
}

bool is_text_shapes(const std::string& path) {
  try {
    const std::string text = read_file(path, kMaxBytes);
    const auto head = NumberLines(path, text).next();
    return head && head->size() == 2 && is_count((*head)[0], 1, kMaxShapes) &&
           is_count((*head)[1], 6, 2 * kMaxPoints);
  } catch (const InputError&) {
    return false;
  }
}

std::vector<Triangle> read_triangles(const std::string& path, int points) {
  const std::string text = read_file(path, kMaxBytes);
  NumberLines lines(path, text);
  std::vector<Triangle> triangles;
  while (const auto line = lines.next()) {
    if (line->size() != 3) lines.fail("three point numbers are expected");
    Triangle triangle{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (!is_count((*line)[k], 0, points - 1))
        lines.fail(fmt::format("points are 0..{}", points - 1));
      triangle[k] = static_cast<int>((*line)[k]);
    }
    if (triangle[0] == triangle[1] || triangle[1] == triangle[2] || triangle[0] == triangle[2])
      lines.fail("the corners of a triangle differ");
    triangles.push_back(triangle);
  }
  if (triangles.empty()) throw InputError(path, "holds no triangles");
  return triangles;
}

}  // namespace tarsier::face::shape
