// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/region.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <string>
#include <system_error>

namespace tarsier::plate {
namespace {

constexpr double kMaxCoordinate = 100'000;  // px
constexpr std::size_t kMaxCorners = 32;

[[noreturn]] void refuse(std::string_view text) {
  throw UsageError(
      fmt::format("'{}' is not a region: expected x,y,w,h or corners x,y x,y x,y .., in pixels, "
                  "or all as shares of the image, at most 1",
                  printable(text)));
}

// Parses "1,2,3": at least two numbers.
std::vector<double> numbers_of(std::string_view word, std::string_view whole) {
  std::vector<double> numbers;
  while (true) {
    const std::size_t comma = word.find(',');
    const std::string_view part = word.substr(0, comma);
    double value = 0;
    const char* end = part.data() + part.size();
    const auto [after, error] = std::from_chars(part.data(), end, value);
    if (error != std::errc() || after != end || !(value >= 0) || !(value <= kMaxCoordinate)) {
      refuse(whole);
    }
    numbers.push_back(value);
    if (comma == std::string_view::npos) return numbers;
    word.remove_prefix(comma + 1);
  }
}

double area_of(const std::vector<cv::Point2d>& corners) {
  double sum = 0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    sum += corners[k].cross(corners[(k + 1) % corners.size()]);
  }
  return std::abs(sum) / 2;
}

}  // namespace

bool Region::contains(cv::Point2d point, cv::Size image) const {
  if (corners.empty()) return true;
  if (relative) {
    point.x /= std::max(image.width, 1);
    point.y /= std::max(image.height, 1);
  }
  bool inside = false;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const cv::Point2d a = corners[k];
    const cv::Point2d b = corners[(k + 1) % corners.size()];
    if ((a.y > point.y) == (b.y > point.y)) continue;
    if (point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)) inside = !inside;
  }
  return inside;
}

bool Region::contains_center(const cv::Rect& box, cv::Size image) const {
  return contains({box.x + box.width / 2.0, box.y + box.height / 2.0}, image);
}

std::vector<cv::Point> Region::outline(cv::Size image) const {
  std::vector<cv::Point> points;
  points.reserve(corners.size());
  for (const cv::Point2d& corner : corners) {
    points.emplace_back(static_cast<int>(std::lround(corner.x * (relative ? image.width : 1))),
                        static_cast<int>(std::lround(corner.y * (relative ? image.height : 1))));
  }
  return points;
}

Region parse_region(std::string_view text) {
  constexpr std::string_view kSeparators = " \t;";
  Region region;
  std::string_view rest = text;
  double largest = 0;
  while (true) {
    rest.remove_prefix(std::min(rest.find_first_not_of(kSeparators), rest.size()));
    if (rest.empty()) break;
    const std::string_view word = rest.substr(0, rest.find_first_of(kSeparators));
    rest.remove_prefix(word.size());
    const std::vector<double> numbers = numbers_of(word, text);
    for (const double number : numbers) largest = std::max(largest, number);
    if (numbers.size() == 2) {
      region.corners.emplace_back(numbers[0], numbers[1]);
    } else if (numbers.size() == 4 && region.corners.empty() && rest.empty()) {
      const double right = numbers[0] + numbers[2];
      const double bottom = numbers[1] + numbers[3];
      region.corners = {
          {numbers[0], numbers[1]}, {right, numbers[1]}, {right, bottom}, {numbers[0], bottom}};
    } else {
      refuse(text);
    }
  }
  region.relative = largest <= 1;
  if (region.corners.size() < 3 || region.corners.size() > kMaxCorners ||
      !(area_of(region.corners) > 0)) {
    refuse(text);
  }
  return region;
}

}  // namespace tarsier::plate
