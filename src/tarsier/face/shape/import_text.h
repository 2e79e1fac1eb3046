// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/import.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <string_view>

// What the readers of annotations share. For the .cpp files of this module.
namespace tarsier::face::shape {

inline constexpr double kMaxImportedCoordinate = 1e7;  // px

// Lines and words of an untrusted text; knows where it is for messages.
class TextLines {
 public:
  TextLines(std::string path, std::string_view text);

  // The next line without its end and blanks around it; nothing at the end of the text.
  std::optional<std::string_view> next();
  // Throws InputError(path, "line N: reason") for the line read last.
  [[noreturn]] void fail(const std::string& reason) const;
  // The word as a number within +-`most`, or fail().
  [[nodiscard]] double number(std::string_view word, double most) const;
  [[nodiscard]] int integer(std::string_view word, int low, int high) const;

 private:
  std::string path_;
  std::string_view rest_;
  int line_ = 0;
};

// Cuts up to the next comma off `rest`, trimmed; none at its end.
std::optional<std::string_view> cut_cell(std::optional<std::string_view>& rest);

// The image with the name of `stem` (a path without its ending) in the first of its forms that
// exists; "" for none.
[[nodiscard]] std::string image_beside(const std::string& stem);

// Samples of a table; images that are not there are named in `skipped`.
void import_muct(const std::string& path, const ImportOptions& options, Imported& imported);
void import_dlib(const std::string& path, const ImportOptions& options, Imported& imported);

}  // namespace tarsier::face::shape
