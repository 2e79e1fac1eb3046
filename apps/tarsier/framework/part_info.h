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

// "3/20". Throws UsageError naming the flag.
[[nodiscard]] Shard parse_shard(std::string_view text, std::string_view flag = "--shard");

// Which of `count` shards an input belongs to, 1..count: the first 8 bytes of the SHA-256 of its name
// as a big-endian number, modulo count, plus 1. It depends on nothing else: other inputs that come or
// go leave it where it is.
[[nodiscard]] int shard_of(std::string_view input, int count);

// What stands beside a finished part (part-3.jsonl) in part-3.jsonl.done: which share it is, and which
// input each of its lines belongs to.
struct PartInfo {
  Shard shard;
  std::int64_t inputs = 0;  // of the whole batch
  std::string list;         // SHA-256 of the names of all inputs
  std::string settings;     // SHA-256 of the words of the command that decide what the lines say
  int header_lines = 0;     // 1 for CSV
  std::vector<std::int64_t> lines;  // the input, 0.., of each line behind the header; ascending
  std::vector<std::pair<std::int64_t, std::string>>
      skipped;         // inputs that could not be read, and why
  std::string sha256;  // of the part
};

[[nodiscard]] std::string info_path(const std::string& part);  // "part-3.jsonl.done"

// Both throw InputError or OutputError with the path. What is read is checked: ranges, order.
[[nodiscard]] PartInfo read_part_info(const std::string& part);
void write_part_info(const std::string& part, const PartInfo& info);

struct MergeReport {
  int shards = 0;
  std::int64_t inputs = 0;
  std::int64_t lines = 0;
  std::int64_t skipped = 0;
};

// Writes the lines of all parts in the order of the inputs, and its .done: both as one run of shard
// 1/1 would have written them. Throws InputError for a part that is not finished, was changed, is of
// another batch or there twice, and where a shard is missing; UsageError where `output` is a part.
MergeReport merge_parts(const std::vector<std::string>& parts, const std::string& output);

}  // namespace tarsier::cli
