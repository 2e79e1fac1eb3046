// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/evaluation.h"
#include "tarsier/plate/text/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <istream>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>

namespace tarsier::plate {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxLine = 10'000'000;
constexpr std::int64_t kMaxTruthBytes = 256'000'000;
constexpr double kMaxCoordinate = 1e6;  // px

[[noreturn]] void fail(const std::string& name, int line, const std::string& reason) {
  throw InputError(name, fmt::format("line {}: {}", line, reason));
}

// --- truth ---

constexpr std::array<std::string_view, 6> kColumns{"image", "x", "y", "w", "h", "text"};

// Index of each of kColumns in the file.
std::array<std::size_t, 6> find_columns(const std::vector<std::string>& header,
                                        const std::string& path) {
  std::array<std::size_t, 6> column_indices{};
  for (std::size_t k = 0; k < kColumns.size(); ++k) {
    column_indices[k] = header.size();
    for (std::size_t n = 0; n < header.size(); ++n) {
      if (header[n] == kColumns[k]) column_indices[k] = n;
    }
    if (column_indices[k] == header.size()) {
      fail(path, 1, fmt::format("no column '{}': the header is image,x,y,w,h,text", kColumns[k]));
    }
  }
  return column_indices;
}

std::optional<cv::Rect2d> parse_box(const std::array<std::string, 6>& fields,
                                    const std::string& path, int line) {
  if (fields[1].empty() && fields[2].empty() && fields[3].empty() && fields[4].empty()) {
    return std::nullopt;
  }
  std::array<double, 4> numbers{};
  for (std::size_t k = 0; k < 4; ++k) {
    const std::string& field = fields[k + 1];
    const char* end = field.data() + field.size();
    const auto [after, error] = std::from_chars(field.data(), end, numbers[k]);
    const bool good = error == std::errc() && after == end &&
                      std::abs(numbers[k]) <= kMaxCoordinate && (k < 2 || numbers[k] >= 0);
    if (!good)
      fail(path, line, fmt::format("'{}' is not a valid {}", printable(field), kColumns[k + 1]));
  }
  return cv::Rect2d{numbers[0], numbers[1], numbers[2], numbers[3]};
}

// Whether a '-' is probably a separator of the plate and no hidden character.
bool has_separator(const std::string& text) {
  constexpr int kMaxHidden = 2;
  if (std::count(text.begin(), text.end(), '-') > kMaxHidden) return true;
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  for (std::size_t k = 1; k + 1 < text.size(); ++k) {
    if (text[k] == '-' && text[k - 1] != '-' && text[k + 1] != '-' &&
        is_digit(text[k - 1]) != is_digit(text[k + 1]))
      return true;
  }
  return false;
}

// --- readings ---

// Reads a line without its newline; false after the last one.
bool get_line(std::istream& lines, std::string& line, const std::string& name, int number) {
  line.clear();
  for (int c = lines.get(); c != std::istream::traits_type::eof(); c = lines.get()) {
    if (c == '\n') return true;
    if (line.size() >= kMaxLine) {
      fail(name, number, fmt::format("longer than {} bytes", kMaxLine));
    }
    line += static_cast<char>(c);
  }
  return !line.empty();
}

json parse_line(const std::string& line, const std::string& name, int number) {
  try {
    return parse_json(line, name, {static_cast<std::int64_t>(kMaxLine), 16, 1'000'000});
  } catch (const InputError& error) {
    const std::string_view reason = std::string_view(error.what()).substr(name.size() + 2);
    constexpr std::string_view kLinePrefix = "line 1, ";
    if (!reason.starts_with(kLinePrefix)) fail(name, number, std::string(reason));
    throw InputError(name, fmt::format("line {}, {}", number, reason.substr(kLinePrefix.size())));
  }
}

class PlateParser {
 public:
  PlateParser(const std::string& name, int number) : name_(name), number_(number) {}

  [[nodiscard]] ImageReadings image(const json& object) const {
    if (!object.is_object()) refuse("a JSON object is expected");
    ImageReadings image;
    image.image = text(object, "image");
    image.milliseconds = number(object, "ms", -1);
    const auto plates = object.find("plates");
    if (plates == object.end() || plates->is_null()) return image;
    if (!plates->is_array()) refuse("\"plates\": expected a list");
    for (const json& plate : *plates) {
      if (!plate.is_object()) refuse("a plate is not a JSON object");
      image.boxes.push_back(box(plate));
      image.plates.push_back(reading(plate, image.boxes.back()));
    }
    return image;
  }

 private:
  [[noreturn]] void refuse(const std::string& reason) const { fail(name_, number_, reason); }

  [[nodiscard]] std::string text(const json& object, const char* key) const {
    const auto found = object.find(key);
    if (found == object.end() || !found->is_string()) refuse(fmt::format("no text \"{}\"", key));
    return found->get<std::string>();
  }

  [[nodiscard]] double number(const json& object, const char* key, double default_value) const {
    const auto found = object.find(key);
    if (found == object.end() || found->is_null()) return default_value;
    if (!found->is_number()) refuse(fmt::format("\"{}\": expected a number", key));
    return found->get<double>();
  }

  [[nodiscard]] cv::Rect2d box(const json& plate) const {
    const auto found = plate.find("box");
    if (found == plate.end() || found->is_null()) return {};
    std::array<double, 4> numbers{};
    if (!found->is_array() || found->size() != numbers.size()) {
      refuse("\"box\": expected a list of four numbers");
    }
    for (std::size_t k = 0; k < numbers.size(); ++k) {
      const json& value = (*found)[k];
      if (!value.is_number() || !(std::abs(value.get<double>()) <= kMaxCoordinate)) {
        refuse("\"box\": expected a list of four numbers up to 1000000");
      }
      numbers[k] = value.get<double>();
    }
    return {numbers[0], numbers[1], numbers[2], numbers[3]};
  }

  [[nodiscard]] Reading reading(const json& plate, const cv::Rect2d& box) const {
    Reading reading;
    reading.text = text(plate, "text");
    reading.confidence = number(plate, "confidence", 0);
    reading.box = {static_cast<int>(std::lround(box.x)), static_cast<int>(std::lround(box.y)),
                   static_cast<int>(std::lround(box.width)),
                   static_cast<int>(std::lround(box.height))};
    const auto candidates = plate.find("candidates");
    if (candidates == plate.end() || candidates->is_null()) return reading;
    if (!candidates->is_array()) refuse("\"candidates\": expected a list");
    for (const json& candidate : *candidates) {
      if (candidate.is_string()) {
        reading.candidates.push_back({candidate.get<std::string>(), 0, ""});
      } else if (candidate.is_object()) {
        reading.candidates.push_back(
            {text(candidate, "text"), number(candidate, "confidence", 0), ""});
      } else {
        refuse("a candidate is neither a text nor an object");
      }
    }
    return reading;
  }

  const std::string& name_;
  int number_;
};

}  // namespace

PlateTruth read_plate_truth(const std::string& path) {
  const std::string bytes = read_file(path, kMaxTruthBytes);
  std::string_view text = bytes;
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  PlateTruth truth;
  std::array<std::size_t, 6> column_indices{};
  std::size_t width = 0;
  int separators = 0;
  std::string example;
  for (int line = 1; !text.empty(); ++line) {
    std::string_view content = next_line(text);
    if (content.ends_with('\r')) content.remove_suffix(1);
    if (content.empty() && line > 1) continue;
    const auto fields = csv_fields(content);
    if (!fields) fail(path, line, "a quote without its other end, or within a field");
    if (line == 1) {
      column_indices = find_columns(*fields, path);
      width = fields->size();
      continue;
    }
    if (fields->size() != width) {
      fail(path, line, fmt::format("{} fields, the header has {}", fields->size(), width));
    }
    std::array<std::string, 6> values;
    for (std::size_t k = 0; k < values.size(); ++k) values[k] = (*fields)[column_indices[k]];
    const std::string image = values[0].substr(values[0].rfind('/') + 1);
    if (image.empty()) fail(path, line, "no image");
    truth[image].push_back({parse_box(values, path, line), plate_symbols(values[5], true)});
    if (has_separator(truth[image].back().text) && separators++ == 0)
      example = truth[image].back().text;
  }
  if (separators > 0) {
    log_warning(
        "{}: {} texts like {}: a '-' is a hidden character, so any character of a reading is "
        "right; "
        "omit the hyphens of a plate",
        path, separators, example);
  }
  if (width == 0) throw InputError(path, "empty: the header image,x,y,w,h,text is expected");
  return truth;
}

std::vector<ImageReadings> parse_readings(std::istream& lines, const std::string& name) {
  std::vector<ImageReadings> readings;
  std::string line;
  for (int number = 1; get_line(lines, line, name, number); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    readings.push_back(PlateParser(name, number).image(parse_line(line, name, number)));
  }
  return readings;
}

}  // namespace tarsier::plate
