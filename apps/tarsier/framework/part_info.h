// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::cli {

// One of N runs that share the inputs of a batch: the first is 1/N.
struct Shard {
  int number = 1;
  int count = 1;
};

// Parses "3/20". Throws UsageError that names the flag.
[[nodiscard]] Shard parse_shard(std::string_view text, std::string_view flag = "--shard");

// The shard of an input, 1..count: the first 8 bytes of the SHA-256 of its name as a big-endian
// number, modulo count, plus 1. It depends only on the name, so adding or removing other inputs
// does not change it.
[[nodiscard]] int shard_of(std::string_view input, int count);

// The contents of part-3.jsonl.done beside a finished part (part-3.jsonl): the shard, and the input
// of each line.
struct PartInfo {
  Shard shard;
  std::int64_t inputs = 0;  // of the whole batch
  std::string list;         // SHA-256 of all input names
  // SHA-256 of those words of the command that determine the results.
  std::string settings;
  int header_lines = 0;             // 1 for CSV
  std::vector<std::int64_t> lines;  // for each line after the header its input, 0..; ascending
  // Inputs that could not be read, and the reasons.
  std::vector<std::pair<std::int64_t, std::string>> skipped;
  std::string sha256;  // of the part
};

[[nodiscard]] std::string info_path(const std::string& part);  // "part-3.jsonl.done"

// Both throw InputError or OutputError with the path. Ranges and order are checked when reading.
[[nodiscard]] PartInfo read_part_info(const std::string& part);
void write_part_info(const std::string& part, const PartInfo& info);

struct MergeReport {
  int shards = 0;
  std::int64_t inputs = 0;
  std::int64_t lines = 0;
  std::int64_t skipped = 0;
};

// Writes the lines of all parts in the order of the inputs, and the .done file, as one run of shard
// 1/1 would have written them. Throws InputError for a part that is not finished, was changed,
// belongs to another batch or is given twice, and for a missing shard; UsageError if `output` is a
// part.
MergeReport merge_parts(const std::vector<std::string>& parts, const std::string& output);

}  // namespace tarsier::cli
