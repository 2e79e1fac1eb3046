// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/errors.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/name.h"
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

// One row of the log of corrections, with additional data for undoing.
struct Gallery::CorrectionRecord {
  std::int64_t id = 0;
  std::string kind;
  std::int64_t source = 0;
  std::int64_t target = 0;
  std::string source_name;
  std::string target_name;
  bool target_created = false;   // the target was created by the correction
  std::string note;              // of the source, if it was removed
  std::int64_t source_time = 0;  // enrolment time of the source
  std::int64_t undone = 0;
  std::int64_t undoes = 0;
};

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

[[nodiscard]] inline Person person_at(const Statement& row, const std::string& path) {
  Person person{row.integer(0), row.text(1), row.text(2), row.integer(3), row.integer(4)};
  try {
    check_name(person.name);
  } catch (const UsageError& error) {
    throw InputError(path, error.what());
  }
  return person;
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
