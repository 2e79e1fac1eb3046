// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sqlite.h"

#include <fmt/format.h>
#include <opencv2/core/mat.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// The storage format of faces in a gallery's rows; internal to the gallery's sources.
namespace tarsier::face::people {

inline constexpr std::size_t kMaxSourceBytes = 1000;         // bytes
inline constexpr std::size_t kMaxTemplateNumbers = 200'000;  // numbers

// Runs a statement without result rows; its parameters ?1, ?2, .. are integers.
template <typename... Numbers>
void run_statement(Database& database, std::string_view statement, Numbers... numbers) {
  Statement one(database, statement);
  int parameter = 0;
  (one.bind(++parameter, std::int64_t{numbers}), ...);
  (void)one.step();
}

[[nodiscard]] inline std::span<const std::uint8_t> bytes_of(std::span<const float> numbers) {
  return {reinterpret_cast<const std::uint8_t*>(numbers.data()), numbers.size() * sizeof(float)};
}

[[nodiscard]] inline std::vector<float> numbers_of(const std::vector<std::uint8_t>& bytes,
                                                   const std::string& path, std::int64_t id) {
  if (bytes.size() % sizeof(float) != 0 || bytes.size() > kMaxTemplateNumbers * sizeof(float))
    throw InputError(path, fmt::format("face {}: its template is damaged", id));
  std::vector<float> numbers(bytes.size() / sizeof(float));
  if (!bytes.empty()) std::memcpy(numbers.data(), bytes.data(), bytes.size());
  for (const float number : numbers)
    if (!std::isfinite(number))
      throw InputError(path, fmt::format("face {}: its template is damaged", id));
  return numbers;
}

[[nodiscard]] inline double quality_of(double stored, const std::string& path, std::int64_t id) {
  if (!std::isfinite(stored))
    throw InputError(path, fmt::format("face {}: its quality is damaged", id));
  return stored;
}

[[nodiscard]] inline cv::Mat crop_of(const std::vector<std::uint8_t>& png, const std::string& path,
                                     std::int64_t id) {
  ImageLimits limits;
  limits.max_pixels = 4'000'000;
  const cv::Mat color = decode_image(png, fmt::format("{}: face {}", path, id), limits);
  cv::Mat gray;
  cv::cvtColor(color, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

}  // namespace tarsier::face::people
