// SPDX-License-Identifier: MIT
#include "framework/batch.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/image_inputs.h"
#include "tarsier/media/sha256.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include "framework/journal.h"
#include "framework/output.h"
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

// The words of a command without those that may differ between runs of one batch: outputs and
// reporting.
std::string settings_of(const std::vector<std::string>& words) {
  static const std::set<std::string> kSwitches = {"--resume", "--json", "--quiet"};
  static const std::set<std::string> kValues = {
      "--shard",     "--jsonl",   "--csv",       "--output", "-o",       "--progress",
      "--log-level", "--threads", "--debug-dir", "--log",    "--outbox", "--config"};
  Sha256 sum;
  for (std::size_t i = 0; i < words.size(); ++i) {
    const std::string name = words[i].substr(0, words[i].find('='));
    if (kSwitches.contains(words[i])) continue;
    if (kValues.contains(name)) {
      const bool separate = name.size() == words[i].size() && i + 1 < words.size();
      const std::string value = separate ? words[++i] : words[i].substr(name.size() + 1);
      if (name == "--config") sum.add(read_file(value, 1'000'000));
      continue;
    }
    if (words[i].starts_with("-o") && words[i].size() > 2) continue;
    sum.add(words[i]);
    sum.add(std::string_view("\n"));
  }
  return sum.hex();
}

std::string list_of(const std::vector<std::string>& names) {
  Sha256 sum;
  for (const std::string& name : names) {
    sum.add(name);
    sum.add(std::string_view("\n"));
  }
  return sum.hex();
}

// The header line of a journal.
nlohmann::ordered_json header_of(const PartInfo& info) {
  return {{"shard", {info.shard.number, info.shard.count}},
          {"list", info.list},
          {"settings", info.settings}};
}

// Whether the file is as its run has written it.
bool is_complete(const std::string& path) {
  std::error_code ignored;
  return fs::exists(info_path(path), ignored) && fs::is_regular_file(path, ignored) &&
         sha256_of_file(path) == read_part_info(path).sha256;
}

}  // namespace

void add_batch_flags(Command& verb, BatchFlags& flags) {
  const auto group = [](Flag& flag) -> Flag& { return flag.group("Batches of images"); };
  group(verb.add_option("--shard", flags.shard,
                        "process shard i of N of the inputs (by a hash of their names): 3/20"));
  Flag& results = group(verb.add_option(
      "--jsonl", flags.jsonl,
      "file of JSON lines without times, complete once the run has ended (`tarsier merge`)"));
  group(verb.add_flag("--resume", flags.resume,
                      "resume an interrupted run with the same --jsonl file"))
      .needs(results);
}

Batch::Batch(const BatchFlags& flags, BatchTable table, const std::vector<std::string>& inputs,
             const std::vector<Scheme>& schemes, const Context& context)
    : flags_(flags), table_(std::move(table)) {
  if (!flags.shard.empty()) info_.shard = parse_shard(flags.shard);
  names_ = images_of_inputs(inputs, schemes);
  info_.inputs = static_cast<std::int64_t>(names_.size());
  info_.list = list_of(names_);
  info_.settings = settings_of(context.words);

  std::set<std::int64_t> done;
  bool is_finished = false;
  if (stores_results()) {
    std::error_code ignored;
    is_finished = flags.resume && fs::exists(info_path(flags.jsonl), ignored);
    if (is_finished) {
      const PartInfo before = read_part_info(flags.jsonl);
      if (before.list != info_.list || before.settings != info_.settings ||
          before.shard.number != info_.shard.number || before.shard.count != info_.shard.count) {
        throw InputError(
            flags.jsonl,
            "was written with other inputs, flags or another shard: --resume needs the same ones");
      }
      for (const std::string& path : {flags.jsonl, table_.path}) {
        if (path.empty() || is_complete(path)) continue;
        log_warning("{}: is missing or was changed; all images are processed again", path);
        is_finished = false;
      }
    }
    if (is_finished) {
      // of a run that was killed after it had finished
      fs::remove(flags.jsonl + ".journal", ignored);
    } else {
      for (const std::string& path : {flags.jsonl, table_.path})
        if (!path.empty()) fs::remove(info_path(path), ignored);  // of an older run
      const AtomicFile probe(flags.jsonl);  // detects an error now, not after the work
      journal_ = std::make_unique<Journal>(flags.jsonl + ".journal", json_text(header_of(info_)),
                                           flags.resume);
      done = journal_->inputs();
    }
  }
  for (std::int64_t input = 0; input < info_.inputs; ++input) {
    if (shard_of(names_[static_cast<std::size_t>(input)], info_.shard.count) != info_.shard.number)
      continue;
    ++share_;
    if (!is_finished && !done.contains(input)) remaining_.push_back(input);
  }
}

Batch::~Batch() = default;

std::unique_ptr<FrameSource> Batch::open() {
  log_info("shard {}/{}: {} of {} images, {} of them done before", info_.shard.number,
           info_.shard.count, share_, info_.inputs,
           share_ - static_cast<std::int64_t>(remaining_.size()));
  std::vector<BatchImage> images;
  for (const std::int64_t input : remaining_)
    images.push_back({input, names_[static_cast<std::size_t>(input)]});
  return make_batch_source(
      images, [this](std::int64_t input, const std::string& reason) { skip(input, reason); });
}

void Batch::record(std::int64_t input, const nlohmann::ordered_json& line,
                   const std::vector<std::string>& rows) {
  if (!journal_) return;
  nlohmann::ordered_json untimed = line;
  untimed.erase("ms");
  const std::lock_guard lock(mutex_);
  journal_->add({input, json_text(untimed), rows, {}});
}

void Batch::skip(std::int64_t input, const std::string& reason) {
  if (!journal_) return;
  const std::lock_guard lock(mutex_);
  journal_->add({input, {}, {}, reason});
}

void Batch::finish() {
  if (!journal_) return;
  if (!table_.path.empty()) write_part(table_.path, true);
  write_part(flags_.jsonl, false);  // last: its .done says that everything is done
  journal_->remove();
  journal_.reset();
}

void Batch::write_part(const std::string& path, bool is_table) {
  PartInfo info = info_;
  AtomicFile target(path);
  Sha256 sum;
  std::ofstream out(target.path(), std::ios::binary);
  const auto put = [&](const std::string& line) {
    out << line << '\n';
    sum.add(line);
    sum.add(std::string_view("\n"));
  };
  if (is_table) {
    put(table_.columns);
    info.header_lines = 1;
  }
  journal_->read([&](const JournalEntry& entry) {
    if (!entry.skipped.empty()) {
      info.skipped.emplace_back(entry.input, entry.skipped);
      return;
    }
    const std::vector<std::string> lines =
        is_table ? entry.rows : std::vector<std::string>{entry.line};
    for (const std::string& line : lines) {
      put(line);
      info.lines.push_back(entry.input);
    }
  });
  out.close();
  if (!out) throw OutputError(path, "cannot be written");
  info.sha256 = sum.hex();
  target.commit();
  write_part_info(path, info);
}

}  // namespace tarsier::cli
