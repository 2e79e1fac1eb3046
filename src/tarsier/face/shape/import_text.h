// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/import.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <string_view>

// Functions shared by the readers of annotations. For the .cpp files of this module.
namespace tarsier::face::shape {

inline constexpr double kMaxImportedCoordinate = 1e7;  // px

// Lines and words of an untrusted text, with the line number for messages.
class TextLines {
 public:
  TextLines(std::string path, std::string_view text);

  // The next line, trimmed; empty at the end of the text.
  std::optional<std::string_view> next();
  // Throws InputError(path, "line N: reason") for the last line that was read.
  [[noreturn]] void fail(const std::string& reason) const;
  // The word as a number within +-`max_abs`; calls fail() if it is not.
  [[nodiscard]] double number(std::string_view word, double max_abs) const;
  [[nodiscard]] int integer(std::string_view word, int low, int high) const;

 private:
  std::string path_;
  std::string_view rest_;
  int line_ = 0;
};

// Removes and returns the next cell of `rest`, up to a comma, trimmed; empty at its end.
std::optional<std::string_view> next_cell(std::optional<std::string_view>& rest);

// The existing image with the path `stem` (without extension) and the first supported extension; ""
// if there is none.
[[nodiscard]] std::string find_image(const std::string& stem);

// Import the samples of a table; missing images are listed in `skipped`.
void import_muct(const std::string& path, const ImportOptions& options, Imported& imported);
void import_dlib(const std::string& path, const ImportOptions& options, Imported& imported);

}  // namespace tarsier::face::shape
