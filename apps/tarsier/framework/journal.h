// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// The result of one input of a batch.
struct JournalEntry {
  std::int64_t input = 0;
  std::string line;               // JSON
  std::vector<std::string> rows;  // CSV
  std::string skipped;            // why it could not be read; empty: it was read
};

// A file that a run appends to: a header line, then one JSON line per entry. Every prefix of it can
// be used: an incomplete last line of a killed run is removed. One program at a time may use it
// (flock).
class Journal {
 public:
  // `resume` continues an existing file, if there is one. Throws InputError if its header differs,
  // and OutputError if it cannot be written or another program is writing it.
  Journal(std::string path, const std::string& header, bool resume);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  void add(const JournalEntry& entry);  // throws OutputError
  [[nodiscard]] std::set<std::int64_t> inputs() const;
  // Reads the entries in the order of the inputs. Throws InputError.
  void read(const std::function<void(const JournalEntry&)>& callback) const;
  void remove();

 private:
  struct Location {
    std::int64_t begin = 0;
    std::int64_t size = 0;
  };
  void read_entries(const std::string& header);
  [[nodiscard]] std::string text_at(const Location& location) const;

  std::string path_;
  int fd_ = -1;
  std::int64_t end_ = 0;                        // bytes
  std::map<std::int64_t, Location> locations_;  // location of each input's line
};

}  // namespace tarsier::cli
