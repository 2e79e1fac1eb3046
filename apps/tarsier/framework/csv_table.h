// SPDX-License-Identifier: MIT
#pragma once

#include <fstream>
#include <string>
#include <string_view>

namespace tarsier::cli {

// The table of --csv. Rows are written as they arrive, as whole lines, and flushed, so the file can
// be used after an interruption.
class CsvTable {
 public:
  // `header`: "frame,time,id". Constructor and add() throw OutputError if the file cannot be
  // written.
  CsvTable(const std::string& path, std::string_view header);
  // Throws OutputError if the file cannot be written. An existing file is not changed.
  static void require_writable(const std::string& path);
  // `row` has no line end; its texts come from csv_field() (core/csv.h).
  void add(std::string_view row);

 private:
  std::string path_;
  std::ofstream file_;
};

}  // namespace tarsier::cli
