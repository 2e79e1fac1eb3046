// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/dictionary.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/planar/markers/predefined.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <mutex>

namespace tarsier::planar::markers {
namespace {

constexpr std::array<std::string_view, 21> kNames{
    "aruco-original", "4x4_50",   "4x4_100",  "4x4_250", "4x4_1000", "5x5_50",   "5x5_100",
    "5x5_250",        "5x5_1000", "6x6_50",   "6x6_100", "6x6_250",  "6x6_1000", "7x7_50",
    "7x7_100",        "7x7_250",  "7x7_1000", "16h5",    "25h9",     "36h10",    "36h11"};

std::string full_name(std::string_view name) {
  if (name == "orig" || name == "original") return "aruco-original";
  if (name == "4x4" || name == "5x5" || name == "6x6" || name == "7x7")
    return std::string(name) + "_1000";
  if (name.starts_with("tag")) return std::string(name.substr(3));
  return std::string(name);
}

// Like std::popcount, which is a library call if the processor may lack the instruction; decoding
// needs it thousands of times.
int number_of_ones(Code code) {
  code -= (code >> 1U) & 0x5555555555555555U;
  code = (code & 0x3333333333333333U) + ((code >> 2U) & 0x3333333333333333U);
  code = (code + (code >> 4U)) & 0x0F0F0F0F0F0F0F0FU;
  return static_cast<int>((code * 0x0101010101010101U) >> 56U);
}

}  // namespace

Code rotated_clockwise(Code code, int cells) {
  Code result = 0;
  for (int y = 0; y < cells; ++y)
    for (int x = 0; x < cells; ++x) {
      // After a clockwise turn, cell (y, x) shows the former cell (cells - 1 - x, y).
      const int from = cells * cells - 1 - ((cells - 1 - x) * cells + y);
      result = result << 1U | (code >> static_cast<unsigned>(from) & 1U);
    }
  return result;
}

Dictionary::Dictionary(std::string name, int cells, std::vector<Code> codes)
    : name_(std::move(name)), cells_(cells), codes_(std::move(codes)) {
  TARSIER_REQUIRE(cells_ >= 3 && cells_ <= 8, "{} cells a side are not 3 to 8", cells_);
  TARSIER_REQUIRE(!codes_.empty() && codes_.size() <= 65536, "{} codes are not 1 to 65536",
                  codes_.size());
  for (const Code code : codes_)
    TARSIER_REQUIRE(cells_ == 8 || code >> static_cast<unsigned>(cells_ * cells_) == 0,
                    "a code has more than {} bits", cells_ * cells_);
  index();
}

void Dictionary::index() {
  rotated_codes_.reserve(codes_.size() * 4);
  for (std::size_t id = 0; id < codes_.size(); ++id) {
    Code code = codes_[id];
    for (std::uint32_t turn = 0; turn < 4; ++turn) {
      rotated_codes_.push_back({code, static_cast<std::uint32_t>(id) * 4 + turn});
      code = rotated_clockwise(code, cells_);
    }
  }
  // Only the other marker is turned: turning both changes nothing.
  distance_ = cells_ * cells_;
  for (std::size_t id = 0; id < codes_.size(); ++id)
    for (std::size_t other = id * 4 + 1; other < rotated_codes_.size(); ++other)
      distance_ = std::min(distance_, number_of_ones(codes_[id] ^ rotated_codes_[other].code));
  std::sort(rotated_codes_.begin(), rotated_codes_.end(),
            [](const RotatedCode& a, const RotatedCode& b) {
              return a.code != b.code ? a.code < b.code : a.id_and_rotation < b.id_and_rotation;
            });
}

Code Dictionary::code(int id) const {
  TARSIER_REQUIRE(id >= 0 && id < size(), "{} has no marker {}; its ids are 0 to {}", name_, id,
                  size() - 1);
  return codes_[static_cast<std::size_t>(id)];
}

std::optional<Match> Dictionary::match(Code read, int max_errors, Code unknown) const {
  const auto match_of = [](const RotatedCode& rotated, int errors) {
    return Match{static_cast<int>(rotated.id_and_rotation / 4),
                 static_cast<int>(rotated.id_and_rotation % 4), errors};
  };
  if (unknown == 0) {  // most are read without an error
    const auto [first, last] = std::ranges::equal_range(
        rotated_codes_, read, {}, [](const RotatedCode& t) { return t.code; });
    if (last - first == 1 && max_errors >= 0) return match_of(*first, 0);
  }
  int best = cells_ * cells_ + 1;
  const RotatedCode* found = nullptr;
  bool tie = false;
  const Code compared = ~unknown;
  for (const RotatedCode& rotated : rotated_codes_) {
    const int errors = number_of_ones((rotated.code ^ read) & compared);
    if (errors > best) continue;
    tie = errors == best;
    best = errors;
    found = &rotated;
  }
  if (found == nullptr || tie || best > max_errors) return std::nullopt;
  return match_of(*found, best);
}

std::vector<Match> Dictionary::nearest(std::span<const float> brightness, int count) const {
  TARSIER_REQUIRE(static_cast<int>(brightness.size()) == cells_ * cells_, "{} cells",
                  brightness.size());
  // Tabulates the sum for every value of each byte of a code: at most eight additions per code.
  std::array<std::array<float, 256>, 8> sums{};
  Code signs = 0;
  for (std::size_t cell = 0; cell < brightness.size(); ++cell) {
    const std::size_t bit = brightness.size() - 1 - cell;
    const float value = brightness[cell];
    if (value > 0) signs |= Code{1} << bit;
    auto& table = sums[bit / 8];
    for (std::size_t byte = 0; byte < 256; ++byte)
      table[byte] += ((byte >> (bit % 8)) & 1U) != 0 ? value : -value;
  }
  const std::size_t bytes = (brightness.size() + 7) / 8;
  std::vector<std::pair<float, const RotatedCode*>> best;
  const auto is_better = [](const auto& a, const auto& b) { return a.first > b.first; };
  for (const RotatedCode& rotated : rotated_codes_) {
    float sum = 0;
    for (std::size_t k = 0; k < bytes; ++k) sum += sums[k][(rotated.code >> (8 * k)) & 0xFFU];
    const std::pair<float, const RotatedCode*> entry(sum, &rotated);
    if (static_cast<int>(best.size()) == count && !is_better(entry, best.back())) continue;
    best.insert(std::upper_bound(best.begin(), best.end(), entry, is_better), entry);
    if (static_cast<int>(best.size()) > count) best.pop_back();
  }
  std::vector<Match> matches;
  matches.reserve(best.size());
  for (const auto& [sum, rotated] : best)
    matches.push_back({static_cast<int>(rotated->id_and_rotation / 4),
                       static_cast<int>(rotated->id_and_rotation % 4),
                       number_of_ones(rotated->code ^ signs)});
  return matches;
}

std::vector<std::string> dictionary_names() { return {kNames.begin(), kNames.end()}; }

const Dictionary& find_dictionary(std::string_view name) {
  static std::mutex mutex;
  static std::map<std::string, std::unique_ptr<Dictionary>> built;
  const std::string full = full_name(name);
  if (std::find(kNames.begin(), kNames.end(), full) == kNames.end())
    throw UsageError(
        fmt::format("unknown marker family {}; one of {}", name, fmt::join(kNames, ", ")));
  const std::scoped_lock lock(mutex);
  auto& entry = built[full];
  if (!entry) {
    PredefinedCodes table = predefined_codes(full);
    entry = std::make_unique<Dictionary>(full, table.cells, std::move(table.codes));
  }
  return *entry;
}

}  // namespace tarsier::planar::markers
