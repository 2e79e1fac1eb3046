// SPDX-License-Identifier: MIT
#include "csv_table.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"

namespace tarsier::cli {

CsvTable::CsvTable(const std::string& path, std::string_view header)
    : path_(path), file_(path, std::ios::binary) {
  add(header);
}

void CsvTable::require_writable(const std::string& path) { const AtomicFile probe(path); }

void CsvTable::add(std::string_view row) {
  file_ << row << '\n';
  file_.flush();
  if (!file_) throw OutputError(path_, "cannot be written");
}

}  // namespace tarsier::cli
