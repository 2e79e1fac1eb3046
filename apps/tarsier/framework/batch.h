// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include "framework/cli.h"
#include "framework/part_info.h"
#include <cstdint>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

// Many images, shared among several runs that may be killed: --shard, --jsonl and --resume.
namespace tarsier::cli {

class Journal;

struct BatchFlags {
  std::string shard;  // "3/20"
  std::string jsonl;  // file of results
  bool resume = false;
  [[nodiscard]] bool wanted() const { return !shard.empty() || !jsonl.empty() || resume; }
};

void add_batch_flags(Command& verb, BatchFlags& flags);

// A table beside the results; empty: none.
struct BatchTable {
  std::string path;
  std::string columns;
};

// The share of one run. What is done is kept in a journal, FILE.journal: a line an input, so that a
// killed run loses at most the one that it was at. finish() makes of it the results and the table, whole
// and in the order of the inputs, each with its .done, and removes it. The results have no measured
// times ("ms"): the same images give the same bytes, wherever and whenever.
//
// Without --jsonl nothing is kept: only the inputs are shared out.
class Batch {
 public:
  // Throws UsageError, InputError of the inputs and the journal, OutputError.
  Batch(const BatchFlags& flags, BatchTable table, const std::vector<std::string>& inputs,
        const std::vector<Scheme>& schemes, const Context& context);
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  // The images of this share that are not done; Frame::index is their place among all inputs. What
  // cannot be read is warned of, noted and passed over. The batch must live longer.
  [[nodiscard]] std::unique_ptr<FrameSource> open();

  // What is known of an input: its line and its rows of the table. From any thread.
  void record(std::int64_t input, const nlohmann::ordered_json& line,
              const std::vector<std::string>& rows);
  void skip(std::int64_t input, const std::string& reason);

  // When all are done.
  void finish();

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }  // of all inputs
  [[nodiscard]] bool is_kept() const { return !flags_.jsonl.empty(); }

 private:
  void write_part(const std::string& path, bool is_table);

  BatchFlags flags_;
  BatchTable table_;
  std::vector<std::string> names_;
  PartInfo info_;
  std::int64_t share_ = 0;            // how many inputs are of this share
  std::vector<std::int64_t> left_;    // inputs of this share that are not done
  std::unique_ptr<Journal> journal_;  // null: nothing is kept
  std::mutex mutex_;
};

}  // namespace tarsier::cli
