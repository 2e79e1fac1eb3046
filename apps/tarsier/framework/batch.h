// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include "framework/cli.h"
#include "framework/part_info.h"
#include <cstdint>
#include <memory>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// Batches of many images, divided among several runs that may be killed: --shard, --jsonl and
// --resume.
namespace tarsier::cli {

class Journal;

struct BatchFlags {
  std::string shard;  // "3/20"
  std::string jsonl;  // file of the results
  bool resume = false;
  [[nodiscard]] bool is_requested() const { return !shard.empty() || !jsonl.empty() || resume; }
};

void add_batch_flags(Command& verb, BatchFlags& flags);

// A table beside the results; none if `path` is empty.
struct BatchTable {
  std::string path;
  std::string columns;
};

// The share of one run. A journal, FILE.journal, has a line for each finished input, so a killed
// run loses at most the input in progress. finish() converts the journal to the complete results
// and the table, in the order of the inputs, each with its .done file, and removes the journal. The
// results contain no measured times ("ms"): the same images give the same bytes.
//
// Without --jsonl nothing is stored: the inputs are only divided.
class Batch {
 public:
  // Throws UsageError, InputError for the inputs and the journal, and OutputError.
  Batch(const BatchFlags& flags, BatchTable table, const std::vector<std::string>& inputs,
        const std::vector<Scheme>& schemes, const Context& context);
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  // The images of this share that are not finished. Frame::index is the position among all inputs.
  // An image that cannot be read is recorded and skipped with a warning. The batch must outlive the
  // source.
  [[nodiscard]] std::unique_ptr<FrameSource> open();

  // Records the result of an input: its line and its rows of the table. Thread-safe.
  void record(std::int64_t input, const nlohmann::ordered_json& line,
              const std::vector<std::string>& rows);
  void skip(std::int64_t input, const std::string& reason);

  // Call this when all inputs are finished.
  void finish();

  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }  // of all inputs
  [[nodiscard]] bool stores_results() const { return !flags_.jsonl.empty(); }

 private:
  void write_part(const std::string& path, bool is_table);

  BatchFlags flags_;
  BatchTable table_;
  std::vector<std::string> names_;
  PartInfo info_;
  std::int64_t share_ = 0;               // number of inputs in this share
  std::vector<std::int64_t> remaining_;  // inputs of this share that are not finished
  std::unique_ptr<Journal> journal_;     // null: nothing is stored
  std::mutex mutex_;
};

}  // namespace tarsier::cli
