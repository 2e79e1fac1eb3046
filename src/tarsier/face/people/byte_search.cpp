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
constexpr std::size_t kPartBytes = kPieceBytes - kStep;
constexpr int kMinDistinctBytes = 8;

std::uint64_t hash_of(const std::uint8_t* part) {
  std::array<std::uint64_t, 3> words{};
  static_assert(sizeof(words) == kPartBytes);
  std::memcpy(words.data(), part, kPartBytes);
  std::uint64_t hash = words[0] * 0x9E3779B97F4A7C15ULL;
  hash = (std::rotl(hash, 29) ^ words[1]) * 0xBF58476D1CE4E5B9ULL;
  hash = (std::rotl(hash, 31) ^ words[2]) * 0x94D049BB133111EBULL;
  return hash ^ (hash >> 32);
}

// For each offset: whether the 32-byte run there has enough different bytes.
std::vector<bool> distinctive_runs(std::span<const std::uint8_t> bytes) {
  std::vector<bool> out;
  if (bytes.size() < kPieceBytes) return out;
  out.resize(bytes.size() - kPieceBytes + 1);
  std::array<int, 256> seen{};
  int different = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    if (seen[bytes[i]]++ == 0) ++different;
    if (i >= kPieceBytes && --seen[bytes[i - kPieceBytes]] == 0) --different;
    if (i + 1 >= kPieceBytes) out[i + 1 - kPieceBytes] = different >= kMinDistinctBytes;
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
  const std::vector<bool> distinctive = distinctive_runs(bytes);
  total_ += std::count(distinctive.begin(), distinctive.end(), true);
  if (stride_ == 1) {
    data_.insert(data_.end(), bytes.begin(), bytes.end());
    active_.resize(data_.size(), false);
    for (std::size_t i = 0; i < distinctive.size(); ++i) {
      if (!distinctive[i]) continue;
      active_[source.begin + i] = true;
      ++source.pieces;
    }
  } else {
    for (std::size_t i = 0; i < distinctive.size(); i += stride_) {
      if (!distinctive[i]) continue;
      const auto run = bytes.subspan(i, kPieceBytes);
      data_.insert(data_.end(), run.begin(), run.end());
      active_.resize(data_.size(), false);
      active_[data_.size() - kPieceBytes] = true;
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
    return a.hash != b.hash ? a.hash < b.hash : a.offset < b.offset;
  });
  filter_bits_ = std::clamp(static_cast<int>(std::bit_width(16 * index_.size())), 12, 30);
  filter_.assign((std::size_t{1} << filter_bits_) / 64, 0);
  for (const Entry& entry : index_) {
    const std::uint32_t bit = entry.hash >> (32 - filter_bits_);
    filter_[bit / 64] |= std::uint64_t{1} << (bit % 64);
  }
  built_ = true;
}

template <typename Visit>
bool Pieces::each_piece(std::span<const std::uint8_t> bytes, const Visit& visit) const {
  build();
  if (index_.empty()) return false;
  for (std::size_t at = 0; at + kPartBytes <= bytes.size(); at += kStep) {
    const auto hash = static_cast<std::uint32_t>(hash_of(bytes.data() + at));
    const std::uint32_t bit = hash >> (32 - filter_bits_);
    if ((filter_[bit / 64] >> (bit % 64) & 1U) == 0) continue;
    auto entry = std::lower_bound(index_.begin(), index_.end(), hash,
                                  [](const Entry& a, std::uint32_t h) { return a.hash < h; });
    for (; entry != index_.end() && entry->hash == hash; ++entry) {
      const std::size_t offset = entry->offset;
      if (std::memcmp(data_.data() + offset, bytes.data() + at, kPartBytes) != 0) continue;
      std::size_t left = 0;
      while (left < kStep && left < at && left < offset &&
             bytes[at - left - 1] == data_[offset - left - 1])
        ++left;
      std::size_t right = 0;
      while (right < kStep && at + kPartBytes + right < bytes.size() &&
             offset + kPartBytes + right < data_.size() &&
             bytes[at + kPartBytes + right] == data_[offset + kPartBytes + right])
        ++right;
      if (left + kPartBytes + right < kPieceBytes) continue;
      for (std::size_t piece = offset - left; piece + kPieceBytes <= offset + kPartBytes + right;
           ++piece)
        if (active_[piece] && visit(piece)) return true;
    }
  }
  return false;
}

std::size_t Pieces::exclude(std::span<const std::uint8_t> bytes) {
  const std::size_t before = count_;
  each_piece(bytes, [&](std::size_t piece) {
    active_[piece] = false;
    --count_;
    return false;
  });
  excluded_ += before - count_;
  return before - count_;
}

std::size_t Pieces::unproven_source_count() const {
  std::size_t out = 0;
  for (const Source& source : sources_) {
    const auto left = static_cast<std::size_t>(
        std::count(active_.begin() + static_cast<std::ptrdiff_t>(source.begin),
                   active_.begin() + static_cast<std::ptrdiff_t>(source.end), true));
    if (left == 0 || 2 * left < source.pieces) ++out;
  }
  return out;
}

bool Pieces::found_in(std::span<const std::uint8_t> bytes) const {
  return each_piece(bytes, [](std::size_t) { return true; });
}

std::vector<std::string> search_files(const Pieces& pieces, const std::vector<std::string>& files,
                                      std::vector<std::string>& unreadable, std::int64_t& bytes,
                                      const std::stop_token& stop) {
  constexpr std::size_t kChunk = std::size_t{1} << 20;
  std::vector<std::string> found;
  std::vector<std::uint8_t> buffer;
  for (const std::string& path : files) {
    throw_if_stopped(stop);
    std::ifstream file(path, std::ios::binary);
    if (!file) {
      unreadable.push_back(path);
      continue;
    }
    buffer.clear();
    while (file) {
      throw_if_stopped(stop);
      // Prepend the end of the last chunk, because pieces may cross the boundary.
      const std::size_t carried = std::min(buffer.size(), kPieceBytes - 1);
      std::copy(buffer.end() - static_cast<std::ptrdiff_t>(carried), buffer.end(), buffer.begin());
      buffer.resize(carried + kChunk);
      file.read(reinterpret_cast<char*>(buffer.data() + carried),
                static_cast<std::streamsize>(kChunk));
      buffer.resize(carried + static_cast<std::size_t>(file.gcount()));
      bytes += file.gcount();
      if (pieces.found_in(buffer)) {
        found.push_back(path);
        break;
      }
    }
    if (file.bad()) unreadable.push_back(path);
  }
  return found;
}

SearchReport search_below(const Pieces& pieces, const std::string& folder,
                          const std::stop_token& stop, const SearchLimits& limits) {
  namespace fs = std::filesystem;
  SearchReport report;
  const std::string top = folder.empty() ? "." : folder;
  struct stat status {};
  if (::stat(top.c_str(), &status) != 0) throw InputError(top, errno_text(errno));
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
      struct stat info {};
      if (::lstat(name.c_str(), &info) != 0) {
        if (errno != ENOENT)
          report.unreadable.push_back(name);  // deleted meanwhile: nothing to read
        continue;
      }
      if (S_ISLNK(info.st_mode)) {
        ++report.links;
      } else if (S_ISDIR(info.st_mode)) {
        if (info.st_dev != device) {
          report.skipped.push_back(name + ": another file system");
        } else if (depth >= limits.max_depth) {
          report.skipped.push_back(name + ": too many folders deep");
        } else {
          folders.push_back(name);
        }
      } else if (S_ISREG(info.st_mode)) {
        size += info.st_size;
        files.push_back(name);
      }
    }
    if (error) {
      if (depth == 0) throw InputError(top, error.message());
      report.unreadable.push_back(path);
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
  report.files_with_pieces =
      search_files(pieces, report.files, report.unreadable, report.bytes, stop);
  return report;
}

}  // namespace tarsier::face::people
