// SPDX-License-Identifier: MIT
#pragma once

#include <fstream>
#include <string>
#include <string_view>

namespace tarsier::cli {

// A table of --csv: rows are written as they come, whole lines, flushed, so that what is there can
// be used when the program is interrupted.
class CsvTable {
 public:
  // `header`: "frame,time,id". Throws OutputError where the file cannot be written; so does add().
  CsvTable(const std::string& path, std::string_view header);
  // `row` without the end of its line; its texts are from csv_field() (core/csv.h).
  void add(std::string_view row);

 private:
  std::string path_;
  std::ofstream file_;
};

}  // namespace tarsier::cli
