// SPDX-License-Identifier: MIT
#include "tarsier/face/head/point_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <vector>

namespace tarsier::face::head {
namespace {

constexpr std::size_t kMaxPoints = 100'000;
constexpr double kMaxValue = 1e9;

std::vector<double> numbers_of(std::string_view line, const std::string& path, int number) {
  std::vector<double> values;
  const auto is_space = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == ','; };
  while (true) {
    while (!line.empty() && is_space(line.front())) line.remove_prefix(1);
    if (line.empty() || line.front() == '#') return values;
    std::size_t end = 0;
    while (end < line.size() && !is_space(line[end]) && line[end] != '#') ++end;
    std::string_view word = line.substr(0, end);
    line.remove_prefix(end);
    if (word.front() == '+') word.remove_prefix(1);
    double value = 0;
    const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (error != std::errc() || stop != word.data() + word.size()) {
      throw InputError(
          path, fmt::format("line {}: expected a number, got '{}'", number, word.substr(0, 40)));
    }
    if (!(std::abs(value) <= kMaxValue)) {
      throw InputError(
          path, fmt::format("line {}: {} is not finite or beyond 1e9", number, word.substr(0, 40)));
    }
    if (values.size() > 64) throw InputError(path, fmt::format("line {}: too long", number));
    values.push_back(value);
  }
}

// `header`: a first line of integers, fewer than `dimensions`, gives the number of points.
Eigen::MatrixXd read(const std::string& path, int dimensions, bool header) {
  const std::string text = read_file(path, 10'000'000);
  std::vector<double> all;
  std::size_t max_points = std::numeric_limits<std::size_t>::max();
  bool is_first = true;
  int number = 0;
  for (std::string_view rest = text; !rest.empty();) {
    const std::size_t end = rest.find('\n');
    const std::vector<double> values = numbers_of(rest.substr(0, end), path, ++number);
    rest.remove_prefix(end == std::string_view::npos ? rest.size() : end + 1);
    if (values.empty()) continue;
    const bool tells_count =
        header && is_first && values.size() < static_cast<std::size_t>(dimensions);
    is_first = false;
    if (tells_count) {
      if (!(values[0] >= 1 && values[0] <= static_cast<double>(kMaxPoints))) {
        throw InputError(path, fmt::format("line {}: {} points", number, values[0]));
      }
      max_points = static_cast<std::size_t>(values[0]);
      continue;
    }
    if (values.size() != static_cast<std::size_t>(dimensions)) {
      throw InputError(path, fmt::format("line {}: {} numbers where a point has {}", number,
                                         values.size(), dimensions));
    }
    if (all.size() / static_cast<std::size_t>(dimensions) >= kMaxPoints) {
      throw InputError(path, fmt::format("more than {} points", kMaxPoints));
    }
    all.insert(all.end(), values.begin(), values.end());
    if (all.size() / static_cast<std::size_t>(dimensions) >= max_points) break;
  }
  if (all.empty()) throw InputError(path, "has no points");
  return Eigen::Map<const Eigen::MatrixXd>(all.data(), dimensions,
                                           static_cast<Eigen::Index>(all.size()) / dimensions);
}

}  // namespace

Eigen::MatrixXd read_point_file(const std::string& path, int dimensions) {
  TARSIER_REQUIRE(dimensions == 2 || dimensions == 3, "points of {} numbers", dimensions);
  return read(path, dimensions, false);
}

Eigen::Matrix3Xd read_landmarks3d(const std::string& path) { return read(path, 3, true); }

}  // namespace tarsier::face::head
