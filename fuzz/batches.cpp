// SPDX-License-Identifier: MIT
// Files that a command reads and earlier runs wrote: settings, the journal of a batch, the .done
// files of its parts.
#include "tarsier/core/errors.h"

#include "framework/command.h"
#include "framework/journal.h"
#include "framework/parse.h"
#include "framework/part_info.h"
#include "fuzz.h"
#include <optional>

namespace tarsier::fuzz {

using namespace tarsier::cli;

// The flags of a verb from a file, some of them from a section.
TARSIER_FUZZ_TARGET(config_file, kBytes) {
  Command root{"tarsier", "a program"};
  Command& area = root.add_subcommand("plate", "verbs of a kind");
  Command& verb = area.add_subcommand("read", "does it");
  int threads = 1;
  double rate = 1;
  bool on = false;
  std::optional<std::string> text;
  std::vector<std::string> names;
  verb.add_option("--threads", threads, "a count").check(range(1, 64));
  verb.add_option("--rate", rate, "a share").check(range(0.0, 1.0));
  verb.add_flag("--on", on, "a switch");
  verb.add_option("--text", text, "a name");
  verb.add_option("--names", names, "names").one_value_each();
  verb.add_unbound_option("--config", "a file").type_name("FILE");
  (void)parse_command_line(root, {"plate", "read", "--config", file_of(input, "settings.toml")});
  expect(threads >= 1 && threads <= 64 && rate >= 0 && rate <= 1, "a value that was not checked");
}

TARSIER_FUZZ_TARGET(batch_journal, kBytes) {
  const std::string header = R"({"shard":[1,2]})";
  Journal journal(file_of(header + "\n" + std::string(text_of(input)), "part.jsonl.journal"),
                  header, true);
  const std::size_t before = journal.inputs().size();
  journal.add({1'000'000, R"({"file":"a.png"})", {"a.png,1"}, {}});
  std::size_t count = 0;
  journal.read([&](const JournalEntry&) { ++count; });
  expect(count == journal.inputs().size() && count >= before, "entries are lost");
}

TARSIER_FUZZ_TARGET(part_info, kJson) {
  (void)file_of(std::string_view("{}\n{}\n"), "part.jsonl");
  (void)file_of(input, "part.jsonl.done");
  const std::string part = scratch_folder() + "/part.jsonl";
  const PartInfo info = read_part_info(part);
  expect(info.shard.number >= 1 && info.shard.number <= info.shard.count, "a shard out of range");
  for (const std::int64_t line : info.lines)
    expect(line >= 0 && line < info.inputs, "a line of no input");
  (void)merge_parts({part}, scratch_folder() + "/merged.jsonl");
}

}  // namespace tarsier::fuzz
