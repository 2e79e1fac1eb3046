// SPDX-License-Identifier: MIT
#include "framework/part_info.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/json_integer.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "framework/output.h"
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <queue>
#include <system_error>

namespace tarsier::cli {
namespace {

constexpr int kMaxShards = 100'000;
constexpr std::int64_t kMaxInfoBytes = 1'000'000'000;

int whole_number(std::string_view text) {
  int number = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
  return error == std::errc() && end == text.data() + text.size() ? number : -1;
}

// Throws nlohmann::json::exception if the JSON is not such an object.
PartInfo info_of(const nlohmann::json& json) {
  PartInfo info;
  info.shard = {json_integer<int>(json.at("shard").at(0)),
                json_integer<int>(json.at("shard").at(1))};
  info.inputs = json_integer<std::int64_t>(json.at("inputs"));
  info.list = json.at("list");
  info.settings = json.at("settings");
  info.header_lines = json_integer<int>(json.at("header_lines"));
  for (const nlohmann::json& line : json.at("lines"))
    info.lines.push_back(json_integer<std::int64_t>(line));
  for (const nlohmann::json& entry : json.at("skipped")) {
    info.skipped.emplace_back(json_integer<std::int64_t>(entry.at(0)), entry.at(1));
  }
  info.sha256 = json.at("sha256");
  return info;
}

bool is_valid(const PartInfo& info) {
  const auto is_input = [&](std::int64_t input) { return input >= 0 && input < info.inputs; };
  return info.shard.count >= 1 && info.shard.count <= kMaxShards && info.shard.number >= 1 &&
         info.shard.number <= info.shard.count && info.header_lines >= 0 &&
         info.header_lines <= 1 && std::is_sorted(info.lines.begin(), info.lines.end()) &&
         std::all_of(info.lines.begin(), info.lines.end(), is_input) &&
         std::all_of(info.skipped.begin(), info.skipped.end(),
                     [&](const auto& entry) { return is_input(entry.first); });
}

struct Part {
  std::string path;
  PartInfo info;
};

// The parts, sorted by their shards.
std::vector<Part> checked_parts(const std::vector<std::string>& paths) {
  std::map<int, Part> parts;
  for (const std::string& path : paths) {
    if (path.ends_with(".done")) continue;  // the pattern matched both files
    Part part{path, read_part_info(path)};
    if (sha256_of_file(path) != part.info.sha256) {
      throw InputError(path, "was changed after its run had ended: run its command again");
    }
    if (!parts.empty()) {
      const Part& first = parts.begin()->second;
      const char* other = part.info.shard.count != first.info.shard.count     ? "number of shards"
                          : part.info.list != first.info.list                 ? "inputs"
                          : part.info.settings != first.info.settings         ? "flags"
                          : part.info.header_lines != first.info.header_lines ? "kind of file"
                                                                              : nullptr;
      if (other != nullptr) {
        throw InputError(
            path, fmt::format("belongs to another batch than {}: different {}", first.path, other));
      }
    }
    const int number = part.info.shard.number;
    const auto [place, is_new] = parts.emplace(number, std::move(part));
    if (!is_new) {
      throw InputError(path, fmt::format("is shard {}/{}, and so is {}: name one of them", number,
                                         place->second.info.shard.count, place->second.path));
    }
  }
  if (parts.empty()) throw UsageError("no part is given");
  const int count = parts.begin()->second.info.shard.count;
  std::vector<int> missing;
  for (int number = 1; number <= count && missing.size() < 20; ++number) {
    if (!parts.contains(number)) missing.push_back(number);
  }
  if (!missing.empty()) {
    const bool more = static_cast<std::size_t>(count) - parts.size() > missing.size();
    throw InputError(parts.begin()->second.path,
                     fmt::format("is one of {} shards, of which {} {} missing: {}{}", count,
                                 static_cast<std::size_t>(count) - parts.size(),
                                 static_cast<std::size_t>(count) - parts.size() == 1 ? "is" : "are",
                                 fmt::join(missing, ", "), more ? " .." : ""));
  }
  std::vector<Part> sorted;
  for (auto& [number, part] : parts) sorted.push_back(std::move(part));
  return sorted;
}

}  // namespace

Shard parse_shard(std::string_view text, std::string_view flag) {
  const std::size_t slash = text.find('/');
  Shard shard{-1, -1};
  if (slash != std::string_view::npos) {
    shard = {whole_number(text.substr(0, slash)), whole_number(text.substr(slash + 1))};
  }
  if (shard.count < 1 || shard.count > kMaxShards || shard.number < 1 ||
      shard.number > shard.count) {
    throw UsageError(fmt::format("{} {}: expected i/N with 1 <= i <= N, for example 3/20", flag,
                                 printable(text)));
  }
  return shard;
}

int shard_of(std::string_view input, int count) {
  Sha256 sum;
  sum.add(input);
  std::uint64_t number = 0;
  const std::string hex = sum.hex();
  std::from_chars(hex.data(), hex.data() + 16, number, 16);
  return static_cast<int>(number % static_cast<std::uint64_t>(count)) + 1;
}

std::string info_path(const std::string& part) { return part + ".done"; }

PartInfo read_part_info(const std::string& part) {
  const std::string path = info_path(part);
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) {
    throw InputError(part, std::filesystem::exists(part, ignored)
                               ? "is not finished (there is no .done beside it): run its command "
                                 "again with --resume"
                               : "no such part");
  }
  PartInfo info;
  try {
    info = info_of(nlohmann::json::parse(read_file(path, kMaxInfoBytes)));
  } catch (const nlohmann::json::exception& error) {
    throw InputError(path, fmt::format("does not describe a part: {}", error.what()));
  }
  if (!is_valid(info)) throw InputError(path, "does not describe a part: values out of range");
  return info;
}

void write_part_info(const std::string& part, const PartInfo& info) {
  nlohmann::ordered_json json{{"shard", {info.shard.number, info.shard.count}},
                              {"inputs", info.inputs},
                              {"list", info.list},
                              {"settings", info.settings},
                              {"header_lines", info.header_lines},
                              {"lines", info.lines},
                              {"skipped", nlohmann::ordered_json::array()},
                              {"sha256", info.sha256}};
  for (const auto& [input, reason] : info.skipped) json["skipped"].push_back({input, reason});
  write_file_atomically(info_path(part), json_text(json) + '\n');
}

MergeReport merge_parts(const std::vector<std::string>& paths, const std::string& output) {
  std::error_code ignored;
  for (const std::string& path : paths) {
    if (path == output || std::filesystem::equivalent(path, output, ignored)) {
      throw UsageError(fmt::format("{}: is also a part; name another output", output));
    }
  }
  std::vector<Part> parts = checked_parts(paths);
  PartInfo merged = parts.front().info;
  merged.shard = {1, 1};
  merged.lines.clear();
  merged.skipped.clear();

  std::vector<std::ifstream> files;
  std::string line;
  std::string header;
  for (const Part& part : parts) {
    files.emplace_back(part.path, std::ios::binary);
    if (!files.back()) {
      throw InputError(part.path, "cannot be opened: " + errno_text(errno));
    }
    if (part.info.header_lines > 0 && std::getline(files.back(), line)) header = line + '\n';
    merged.skipped.insert(merged.skipped.end(), part.info.skipped.begin(), part.info.skipped.end());
  }
  std::sort(merged.skipped.begin(), merged.skipped.end());

  AtomicFile target(output);
  Sha256 sum;
  std::ofstream out(target.path(), std::ios::binary);
  const auto put = [&](const std::string& text) {
    out << text;
    sum.add(std::string_view(text));
  };
  put(header);
  // The next line of each part; the lowest input comes first.
  using Next = std::pair<std::int64_t, std::size_t>;
  std::priority_queue<Next, std::vector<Next>, std::greater<>> queue;
  std::vector<std::size_t> next_line(parts.size());
  const auto enqueue = [&](std::size_t part) {
    const std::vector<std::int64_t>& inputs = parts[part].info.lines;
    if (next_line[part] < inputs.size()) queue.emplace(inputs[next_line[part]++], part);
  };
  for (std::size_t part = 0; part < parts.size(); ++part) enqueue(part);
  while (!queue.empty()) {
    const auto [input, part] = queue.top();
    queue.pop();
    if (!std::getline(files[part], line)) {
      throw InputError(parts[part].path, "has fewer lines than its .done says");
    }
    put(line + '\n');
    merged.lines.push_back(input);
    enqueue(part);
  }
  out.close();
  if (!out) throw OutputError(output, "cannot be written");
  merged.sha256 = sum.hex();
  target.commit();
  write_part_info(output, merged);
  return {static_cast<int>(parts.size()), merged.inputs,
          static_cast<std::int64_t>(merged.lines.size()),
          static_cast<std::int64_t>(merged.skipped.size())};
}

}  // namespace tarsier::cli
