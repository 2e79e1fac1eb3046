// SPDX-License-Identifier: MIT
#include "tarsier/face/people/byte_search.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <deque>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sys/stat.h>
#include <system_error>
#include <utility>

namespace tarsier::face::people {
namespace {

// Files are searched in steps of 8 bytes. Every 32-byte piece contains a 24-byte part that starts
// at such a step, wherever the piece lies.
constexpr std::size_t kStep = 8;
constexpr std::size_t kPart = kPiece - kStep;
constexpr int kMinDifferent = 8;

std::uint64_t hash_of(const std::uint8_t* part) {
  std::array<std::uint64_t, 3> words{};
  static_assert(sizeof(words) == kPart);
  std::memcpy(words.data(), part, kPart);
  std::uint64_t hash = words[0] * 0x9E3779B97F4A7C15ULL;
  hash = (std::rotl(hash, 29) ^ words[1]) * 0xBF58476D1CE4E5B9ULL;
  hash = (std::rotl(hash, 31) ^ words[2]) * 0x94D049BB133111EBULL;
  return hash ^ (hash >> 32);
}

// For each offset: whether the 32-byte run there has enough different bytes.
std::vector<bool> telling_runs(std::span<const std::uint8_t> bytes) {
  std::vector<bool> out;
  if (bytes.size() < kPiece) return out;
  out.resize(bytes.size() - kPiece + 1);
  std::array<int, 256> seen{};
  int different = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (seen[bytes[i]]++ == 0) ++different;
    if (i >= kPiece && --seen[bytes[i - kPiece]] == 0) --different;
    if (i + 1 >= kPiece) out[i + 1 - kPiece] = different >= kMinDifferent;
  }
  return out;
}

}  // namespace

Pieces::Pieces(std::int64_t expected_bytes, std::size_t max_pieces) {
  TARSIER_REQUIRE(expected_bytes >= 0 && max_pieces >= 1, "{} bytes, {} pieces", expected_bytes,
                  max_pieces);
  const auto expected = static_cast<std::size_t>(expected_bytes);
  stride_ = std::max<std::size_t>(1, (expected + max_pieces - 1) / max_pieces);
}

void Pieces::add(std::span<const std::uint8_t> bytes) {
  TARSIER_REQUIRE(data_.size() + bytes.size() < std::numeric_limits<std::uint32_t>::max(),
                  "too much to look for: {} bytes", data_.size());
  built_ = false;
  Source source;
  source.begin = data_.size();
  const std::vector<bool> telling = telling_runs(bytes);
  total_ += std::count(telling.begin(), telling.end(), true);
  if (stride_ == 1) {
    data_.insert(data_.end(), bytes.begin(), bytes.end());
    active_.resize(data_.size(), false);
    for (std::size_t i = 0; i < telling.size(); ++i) {
      if (!telling[i]) continue;
      active_[source.begin + i] = true;
      ++source.pieces;
    }
  } else {
    for (std::size_t i = 0; i < telling.size(); i += stride_) {
      if (!telling[i]) continue;
      const auto run = bytes.subspan(i, kPiece);
      data_.insert(data_.end(), run.begin(), run.end());
      active_.resize(data_.size(), false);
      active_[data_.size() - kPiece] = true;
      ++source.pieces;
    }
  }
  count_ += source.pieces;
  source.end = data_.size();
  sources_.push_back(source);
}

void Pieces::build() const {
  if (built_) return;
  index_.clear();
  std::size_t last = std::numeric_limits<std::size_t>::max();  // start of the latest piece
  for (std::size_t i = 0; i < data_.size(); ++i) {
    if (active_[i]) last = i;
    if (last > i || i - last > kStep) continue;
    index_.push_back(
        {static_cast<std::uint32_t>(hash_of(data_.data() + i)), static_cast<std::uint32_t>(i)});
  }
  std::sort(index_.begin(), index_.end(), [](const Entry& a, const Entry& b) {
    return a.hash != b.hash ? a.hash < b.hash : a.place < b.place;
  });
  filter_bits_ = std::clamp(static_cast<int>(std::bit_width(16 * index_.size())), 12, 30);
  filter_.assign((std::size_t{1} << filter_bits_) / 64, 0);
  for (const Entry& entry : index_) {
    const std::uint32_t bit = entry.hash >> (32 - filter_bits_);
    filter_[bit / 64] |= std::uint64_t{1} << (bit % 64);
  }
  built_ = true;
}

template <typename Take>
bool Pieces::each_piece(std::span<const std::uint8_t> bytes, const Take& take) const {
  build();
  if (index_.empty()) return false;
  for (std::size_t at = 0; at + kPart <= bytes.size(); at += kStep) {
    const auto hash = static_cast<std::uint32_t>(hash_of(bytes.data() + at));
    const std::uint32_t bit = hash >> (32 - filter_bits_);
    if ((filter_[bit / 64] >> (bit % 64) & 1U) == 0) continue;
    auto entry = std::lower_bound(index_.begin(), index_.end(), hash,
                                  [](const Entry& a, std::uint32_t h) { return a.hash < h; });
    for (; entry != index_.end() && entry->hash == hash; ++entry) {
      const std::size_t place = entry->place;
      if (std::memcmp(data_.data() + place, bytes.data() + at, kPart) != 0) continue;
      std::size_t left = 0;
      while (left < kStep && left < at && left < place &&
             bytes[at - left - 1] == data_[place - left - 1])
        ++left;
      std::size_t right = 0;
      while (right < kStep && at + kPart + right < bytes.size() &&
             place + kPart + right < data_.size() &&
             bytes[at + kPart + right] == data_[place + kPart + right])
        ++right;
      if (left + kPart + right < kPiece) continue;
      for (std::size_t piece = place - left; piece + kPiece <= place + kPart + right; ++piece)
        if (active_[piece] && take(piece)) return true;
    }
  }
  return false;
}

std::size_t Pieces::keep(std::span<const std::uint8_t> bytes) {
  std::size_t before = count_;
  each_piece(bytes, [&](std::size_t piece) {
    active_[piece] = false;
    --count_;
    return false;
  });
  kept_ += before - count_;
  return before - count_;
}

std::size_t Pieces::unproven_sources() const {
  std::size_t out = 0;
  for (const Source& source : sources_) {
    const auto left = static_cast<std::size_t>(
        std::count(active_.begin() + static_cast<std::ptrdiff_t>(source.begin),
                   active_.begin() + static_cast<std::ptrdiff_t>(source.end), true));
    if (left == 0 || 2 * left < source.pieces) ++out;
  }
  return out;
}

bool Pieces::in(std::span<const std::uint8_t> bytes) const {
  return each_piece(bytes, [](std::size_t) { return true; });
}

std::vector<std::string> search_files(const Pieces& pieces, const std::vector<std::string>& files,
                                      std::vector<std::string>& unread, std::int64_t& bytes,
                                      const std::stop_token& stop) {
  constexpr std::size_t kChunk = std::size_t{1} << 20;
  std::vector<std::string> found;
  std::vector<std::uint8_t> buffer;
  for (const std::string& path : files) {
    throw_if_stopped(stop);
    std::ifstream file(path, std::ios::binary);
    if (!file) {
      unread.push_back(path);
      continue;
    }
    buffer.clear();
    while (file) {
      throw_if_stopped(stop);
      // Prepend the end of the last chunk, because pieces may cross the boundary.
      const std::size_t carried = std::min(buffer.size(), kPiece - 1);
      std::copy(buffer.end() - static_cast<std::ptrdiff_t>(carried), buffer.end(), buffer.begin());
      buffer.resize(carried + kChunk);
      file.read(reinterpret_cast<char*>(buffer.data() + carried),
                static_cast<std::streamsize>(kChunk));
      buffer.resize(carried + static_cast<std::size_t>(file.gcount()));
      bytes += file.gcount();
      if (pieces.in(buffer)) {
        found.push_back(path);
        break;
      }
    }
    if (file.bad()) unread.push_back(path);
  }
  return found;
}

SearchReport search_below(const Pieces& pieces, const std::string& folder,
                          const std::stop_token& stop, const SearchLimits& limits) {
  namespace fs = std::filesystem;
  SearchReport report;
  const std::string top = folder.empty() ? "." : folder;
  struct stat status {};
  if (::stat(top.c_str(), &status) != 0)
    throw InputError(top, std::generic_category().message(errno));
  const dev_t device = status.st_dev;
  std::int64_t size = 0;
  std::deque<std::pair<std::string, int>> waiting{{top, 0}};
  while (!waiting.empty()) {
    throw_if_stopped(stop);
    const auto [path, depth] = waiting.front();
    waiting.pop_front();
    std::vector<std::string> files;
    std::vector<std::string> folders;
    std::error_code error;
    for (fs::directory_iterator entry(path, error), end; !error && entry != end;
         entry.increment(error)) {
      const std::string name = entry->path().string();
      struct stat found {};
      if (::lstat(name.c_str(), &found) != 0) {
        if (errno != ENOENT) report.unread.push_back(name);  // deleted meanwhile: nothing to read
        continue;
      }
      if (S_ISLNK(found.st_mode)) {
        ++report.links;
      } else if (S_ISDIR(found.st_mode)) {
        if (found.st_dev != device) {
          report.skipped.push_back(name + ": another file system");
        } else if (depth >= limits.max_depth) {
          report.skipped.push_back(name + ": too many folders deep");
        } else {
          folders.push_back(name);
        }
      } else if (S_ISREG(found.st_mode)) {
        size += found.st_size;
        files.push_back(name);
      }
    }
    if (error) {
      if (depth == 0) throw InputError(top, error.message());
      report.unread.push_back(path);
      continue;
    }
    ++report.folders;
    // The folder's own files are always searched.
    if (depth > 0 &&
        (static_cast<std::int64_t>(report.files.size() + files.size()) > limits.max_files ||
         size > limits.max_bytes)) {
      report.skipped.push_back(path + ": more than can be searched is in and beside it");
      for (const auto& rest : waiting) report.skipped.push_back(rest.first + ": the same");
      break;
    }
    std::sort(files.begin(), files.end());
    std::sort(folders.begin(), folders.end());
    for (std::string& file : files) report.files.push_back(std::move(file));
    for (std::string& below : folders) waiting.emplace_back(std::move(below), depth + 1);
  }
  report.found = search_files(pieces, report.files, report.unread, report.bytes, stop);
  return report;
}

}  // namespace tarsier::face::people
