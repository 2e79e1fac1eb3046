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

// What one input of a batch gave.
struct JournalEntry {
  std::int64_t input = 0;
  std::string line;               // JSON
  std::vector<std::string> rows;  // CSV
  std::string skipped;            // why it could not be read; empty: it was
};

// A file that a run adds to, a JSON line an entry, behind a header line. Every beginning of it can be
// used: the half line at the end of a killed run's is cut off. One program at a time (flock).
class Journal {
 public:
  // `resume`: goes on with the file that is there, if one is. Throws InputError where its header is
  // another one, OutputError where it cannot be written or another program writes it.
  Journal(std::string path, const std::string& header, bool resume);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  void add(const JournalEntry& entry);  // throws OutputError
  [[nodiscard]] std::set<std::int64_t> inputs() const;
  // In the order of the inputs. Throws InputError.
  void read(const std::function<void(const JournalEntry&)>& take) const;
  void remove();

 private:
  struct Place {
    std::int64_t begin = 0;
    std::int64_t size = 0;
  };
  void read_entries(const std::string& header);
  [[nodiscard]] std::string text_at(const Place& place) const;

  std::string path_;
  int fd_ = -1;
  std::int64_t end_ = 0;                  // bytes
  std::map<std::int64_t, Place> places_;  // of each input
};

}  // namespace tarsier::cli
