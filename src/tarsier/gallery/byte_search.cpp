// SPDX-License-Identifier: MIT
#include "tarsier/gallery/byte_search.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

namespace tarsier::people {
namespace {

constexpr std::uint64_t kBase = 0x9E3779B97F4A7C15ULL | 1;
constexpr std::size_t kFilterBits = std::size_t{1} << 22;
constexpr int kLeastDifferent = 8;

constexpr std::uint64_t top_power() {
  std::uint64_t power = 1;
  for (std::size_t i = 1; i < kPiece; ++i) power *= kBase;
  return power;
}

std::uint64_t mixed(std::uint64_t hash) {
  hash ^= hash >> 31;
  hash *= 0xBF58476D1CE4E5B9ULL;
  return hash ^ (hash >> 29);
}

// Calls take(hash, offset) for each run; stops where it returns true.
template <typename Take>
bool each_run(std::span<const std::uint8_t> bytes, const Take& take) {
  if (bytes.size() < kPiece) return false;
  std::uint64_t hash = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (i >= kPiece) hash -= top_power() * (bytes[i - kPiece] + 1ULL);
    hash = hash * kBase + bytes[i] + 1ULL;
    if (i + 1 >= kPiece && take(mixed(hash), i + 1 - kPiece)) return true;
  }
  return false;
}

bool says_something(const std::uint8_t* run) {
  std::array<bool, 256> seen{};
  int different = 0;
  for (std::size_t i = 0; i < kPiece; ++i) {
    if (!seen[run[i]]) ++different;
    seen[run[i]] = true;
  }
  return different >= kLeastDifferent;
}

}  // namespace

void Pieces::add(std::span<const std::uint8_t> bytes) {
  const auto source = static_cast<std::uint32_t>(sources_.size());
  sources_.emplace_back(bytes.begin(), bytes.end());
  each_run(bytes, [&](std::uint64_t hash, std::size_t offset) {
    if (says_something(bytes.data() + offset))
      places_.push_back({hash, source, static_cast<std::uint32_t>(offset)});
    return false;
  });
  sorted_ = false;
}

void Pieces::sort() const {
  if (sorted_) return;
  std::sort(places_.begin(), places_.end(),
            [](const Place& a, const Place& b) { return a.hash < b.hash; });
  filter_.assign(kFilterBits, false);
  for (const Place& place : places_) filter_[place.hash % kFilterBits] = true;
  sorted_ = true;
}

void Pieces::keep(std::span<const std::uint8_t> bytes) {
  sort();
  std::vector<std::uint64_t> common;
  each_run(bytes, [&](std::uint64_t hash, std::size_t) {
    if (filter_[hash % kFilterBits]) common.push_back(hash);
    return false;
  });
  if (common.empty()) return;
  std::sort(common.begin(), common.end());
  std::erase_if(places_, [&](const Place& place) {
    return std::binary_search(common.begin(), common.end(), place.hash);
  });
  sorted_ = false;
}

std::size_t Pieces::count() const { return places_.size(); }

bool Pieces::in(std::span<const std::uint8_t> bytes) const {
  if (places_.empty()) return false;
  sort();
  return each_run(bytes, [&](std::uint64_t hash, std::size_t offset) {
    if (!filter_[hash % kFilterBits]) return false;
    auto place = std::lower_bound(places_.begin(), places_.end(), hash,
                                  [](const Place& a, std::uint64_t h) { return a.hash < h; });
    for (; place != places_.end() && place->hash == hash; ++place) {
      if (std::memcmp(sources_[place->source].data() + place->offset, bytes.data() + offset,
                      kPiece) == 0)
        return true;
    }
    return false;
  });
}

SearchReport search_folder(const Pieces& pieces, const std::string& folder,
                           const std::stop_token& stop) {
  namespace fs = std::filesystem;
  SearchReport report;
  report.pieces = pieces.count();
  std::error_code error;
  for (fs::directory_iterator entry(folder.empty() ? "." : folder, error), end;
       !error && entry != end; entry.increment(error)) {
    std::error_code ignored;
    if (entry->symlink_status(ignored).type() == fs::file_type::regular)
      report.files.push_back(entry->path().string());
  }
  if (error) throw InputError(folder, error.message());
  std::sort(report.files.begin(), report.files.end());
  constexpr std::size_t kChunk = std::size_t{1} << 20;
  std::vector<std::uint8_t> buffer;
  for (const std::string& path : report.files) {
    std::ifstream file(path, std::ios::binary);
    if (!file) {
      report.unread.push_back(path);
      continue;
    }
    buffer.clear();
    while (file) {
      throw_if_stopped(stop);
      // The end of the last chunk goes before the next: runs lie across.
      const std::size_t carried = std::min(buffer.size(), kPiece - 1);
      std::copy(buffer.end() - static_cast<std::ptrdiff_t>(carried), buffer.end(), buffer.begin());
      buffer.resize(carried + kChunk);
      file.read(reinterpret_cast<char*>(buffer.data() + carried),
                static_cast<std::streamsize>(kChunk));
      buffer.resize(carried + static_cast<std::size_t>(file.gcount()));
      report.bytes += file.gcount();
      if (pieces.in(buffer)) {
        report.found.push_back(path);
        break;
      }
    }
    if (file.bad()) report.unread.push_back(path);
  }
  return report;
}

}  // namespace tarsier::people
