// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/cell_index.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/gemm.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <limits>
#include <mutex>
#include <string_view>
#include <sys/stat.h>
#include <unistd.h>
#include <utility>

namespace tarsier::face::recognition {
namespace {

static_assert(std::endian::native == std::endian::little, "files are little-endian");

// File layout: kMagic, 64 digits of the SHA-256 of the rest of the head, Head, centres (cells x
// dimension, float32), offset, count and checksum of each cell (64 bits each), ids of the templates
// from which the centres were learned (64 bits each). Then the cells in order: ids (64 bits each),
// scales (float32 each), numbers (8 bits, `stride` per template).
constexpr std::string_view kMagic = "TARSIDX1";
constexpr std::size_t kSha256Digits = 64;
constexpr std::size_t kBeforeHead = kMagic.size() + kSha256Digits;
constexpr int kMaxDimension = 8192;
constexpr int kMaxCells = 65536;
constexpr std::int64_t kMaxTemplates = 1'000'000'000;
constexpr std::size_t kRowBytes = sizeof(std::int64_t) + sizeof(float);  // besides the numbers

struct Head {
  std::int64_t last_id;
  std::int64_t space;
  std::int64_t model;
  std::int64_t templates;
  std::int64_t learned_from;
  std::int32_t dimension;
  std::int32_t cells;
};
static_assert(sizeof(Head) == 48);

std::size_t stride_of(int dimension) {
  constexpr auto kStep = static_cast<std::size_t>(linalg::kByteStep);
  return (static_cast<std::size_t>(dimension) + kStep - 1) / kStep * kStep;
}

std::size_t row_bytes(int dimension) { return kRowBytes + stride_of(dimension); }

// Four interleaved hashes of 8-byte words. Each step is bijective, so that any change of one word
// changes the sum.
std::uint64_t checksum_of(std::span<const std::uint8_t> bytes) {
  constexpr std::uint64_t kPrime = 0x9E3779B97F4A7C15ULL;
  std::array<std::uint64_t, 4> chain{1, 2, 3, 4};
  std::size_t i = 0;
  for (; i + 32 <= bytes.size(); i += 32) {
    std::array<std::uint64_t, 4> words{};
    std::memcpy(words.data(), bytes.data() + i, sizeof words);
    for (std::size_t k = 0; k < 4; ++k) chain[k] = std::rotl((chain[k] ^ words[k]) * kPrime, 29);
  }
  for (; i < bytes.size(); ++i) chain[i % 4] = std::rotl((chain[i % 4] ^ bytes[i]) * kPrime, 29);
  std::uint64_t sum = bytes.size();
  for (const std::uint64_t one : chain) sum = std::rotl((sum ^ one) * kPrime, 29);
  return sum;
}

// Codes in -127..127; returns the scale: numbers[i] is about scale * codes[i].
float encode(const float* numbers, int dimension, std::int8_t* codes, std::size_t stride) {
  float greatest = 0;
  for (int i = 0; i < dimension; ++i) greatest = std::max(greatest, std::abs(numbers[i]));
  const float scale = greatest / 127;
  const float factor = greatest > 0 ? 127 / greatest : 0;
  for (int i = 0; i < dimension; ++i)
    codes[i] = static_cast<std::int8_t>(std::lround(numbers[i] * factor));
  std::fill(codes + dimension, codes + stride, std::int8_t{0});
  return scale;
}

void normalise(Rows& rows) {
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const float length = rows.row(i).norm();
    if (length > 1e-12F) rows.row(i) /= length;
  }
}

// The most similar centre of each row; the first one of equals.
void nearest_centres(const Rows& rows, const Rows& centres, std::uint32_t* out) {
  constexpr Eigen::Index kChunk = 64;
  constexpr Eigen::Index kColumns = 256;
  const auto d = static_cast<std::ptrdiff_t>(rows.cols());
  const auto chunks = static_cast<int>((rows.rows() + kChunk - 1) / kChunk);
  const linalg::GemmKernels& kernels = linalg::gemm_kernels();
  cv::parallel_for_({0, chunks}, [&](const cv::Range& range) {
    Rows dots(kChunk, kColumns);
    std::array<float, kChunk> best{};
    for (Eigen::Index first = range.start * kChunk;
         first < std::min(range.end * kChunk, rows.rows()); first += kChunk) {
      const Eigen::Index count = std::min(kChunk, rows.rows() - first);
      best.fill(-std::numeric_limits<float>::infinity());
      std::fill(out + first, out + first + count, 0U);
      for (Eigen::Index c = 0; c < centres.rows(); c += kColumns) {
        const Eigen::Index columns = std::min(kColumns, centres.rows() - c);
        dots.setZero();
        kernels.dots(static_cast<int>(count), static_cast<int>(columns), static_cast<int>(d),
                     rows.data() + first * d, d, centres.data() + c * d, d, dots.data(), kColumns);
        for (Eigen::Index i = 0; i < count; ++i) {
          for (Eigen::Index j = 0; j < columns; ++j) {
            if (!(dots(i, j) > best[static_cast<std::size_t>(i)])) continue;
            best[static_cast<std::size_t>(i)] = dots(i, j);
            out[first + i] = static_cast<std::uint32_t>(c + j);
          }
        }
      }
    }
  });
}

// k-means on directions, initialised with evenly chosen samples. A centre of an empty cell is not
// moved.
Rows learn_centres(const Rows& samples, int cells, int rounds, Progress& progress,
                   const std::stop_token& stop) {
  Rows centres(cells, samples.cols());
  for (Eigen::Index c = 0; c < cells; ++c) centres.row(c) = samples.row(c * samples.rows() / cells);
  normalise(centres);
  std::vector<std::uint32_t> nearest(static_cast<std::size_t>(samples.rows()));
  progress.begin("learning cells", rounds, "rounds");
  constexpr Eigen::Index kPiece = 4096;
  for (int round = 0; round < rounds; ++round) {
    for (Eigen::Index first = 0; first < samples.rows(); first += kPiece) {
      throw_if_stopped(stop);
      nearest_centres(samples.middleRows(first, std::min(kPiece, samples.rows() - first)), centres,
                      nearest.data() + first);
    }
    Rows sums = Rows::Zero(cells, samples.cols());
    for (Eigen::Index i = 0; i < samples.rows(); ++i)
      sums.row(nearest[static_cast<std::size_t>(i)]) += samples.row(i);
    for (Eigen::Index c = 0; c < cells; ++c)
      if (const float length = sums.row(c).norm(); length > 1e-12F)
        centres.row(c) = sums.row(c) / length;
    progress.advance();
  }
  progress.end();
  return centres;
}

// A file that is written sequentially; the space of its head is filled at the end.
class Output {
 public:
  Output(std::string path, std::size_t head) : path_(std::move(path)) {
    fd_ = ::open(path_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0600);
    if (fd_ < 0) fail("cannot write");
    if (::lseek(fd_, static_cast<off_t>(head), SEEK_SET) < 0) fail("cannot write");
  }
  ~Output() {
    if (fd_ >= 0) ::close(fd_);
  }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  void write(std::span<const std::uint8_t> bytes) {
    write_all(fd_, {reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path_);
  }
  void finish(std::string_view head) {
    if (::fsync(fd_) != 0) fail("cannot write to the disk");
    if (::lseek(fd_, 0, SEEK_SET) < 0) fail("cannot write");
    write_all(fd_, head, path_);
    if (::fsync(fd_) != 0) fail("cannot write to the disk");
    if (::close(std::exchange(fd_, -1)) != 0) fail("cannot write");
  }

 private:
  [[noreturn]] void fail(const char* doing) const {
    throw OutputError(path_, fmt::format("{}: {}", doing, errno_text(errno)));
  }
  std::string path_;
  int fd_ = -1;
};

template <typename Value>
void append(std::string& bytes, const Value* values, std::size_t count) {
  bytes.append(reinterpret_cast<const char*>(values), count * sizeof(Value));
}

struct CellEntry {
  std::int64_t offset;
  std::int64_t count;
  std::uint64_t checksum;
};

std::string head_bytes(const Head& head, const Rows& centres, const std::vector<CellEntry>& cells,
                       const std::vector<std::int64_t>& learned_from, std::string& sha256) {
  std::string rest;
  append(rest, &head, 1);
  append(rest, centres.data(), static_cast<std::size_t>(centres.size()));
  append(rest, cells.data(), cells.size());
  append(rest, learned_from.data(), learned_from.size());
  Sha256 sha;
  sha.add(rest);
  sha256 = sha.hex();
  return std::string(kMagic) + sha256 + rest;
}

std::size_t head_size(std::size_t cells, int dimension, std::size_t learned_from) {
  return kBeforeHead + sizeof(Head) +
         cells * (static_cast<std::size_t>(dimension) * sizeof(float) + sizeof(CellEntry)) +
         learned_from * sizeof(std::int64_t);
}

[[noreturn]] void throw_inconsistent_source() {
  throw std::invalid_argument("the templates are others at each call");
}

}  // namespace

int cells_for(std::int64_t templates) {
  int cells = 16;
  while (cells < kMaxCells &&
         static_cast<double>(cells) * 2 <=
             4 * std::sqrt(static_cast<double>(std::max<std::int64_t>(0, templates))))
    cells *= 2;
  return cells;
}

CellIndexReport write_cell_index(const std::string& path, int dimension, std::int64_t count,
                                 const TemplateSource& source, const CellIndexMetadata& metadata,
                                 const CellIndexOptions& options, Progress& progress,
                                 const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(dimension > 0 && dimension <= kMaxDimension, "templates of {} numbers",
                  dimension);
  TARSIER_REQUIRE(count > 0 && count <= kMaxTemplates, "{} templates", count);
  const int cells = static_cast<int>(
      std::min<std::int64_t>(options.cells > 0 ? options.cells : cells_for(count), count));
  CellIndexReport report;
  report.cells = cells;

  // Learn the centres.
  const std::int64_t step =
      std::max<std::int64_t>(1, count / (static_cast<std::int64_t>(cells) * options.learn_from));
  std::vector<std::int64_t> learned_from;
  Rows samples((count + step - 1) / step, dimension);
  progress.begin("reading a sample", samples.rows(), "templates");
  source(step, [&](std::span<const std::int64_t> ids, const Rows& rows) {
    throw_if_stopped(stop);
    const auto at = static_cast<Eigen::Index>(learned_from.size());
    if (at + rows.rows() > samples.rows() || rows.cols() != dimension) throw_inconsistent_source();
    samples.middleRows(at, rows.rows()) = rows;
    learned_from.insert(learned_from.end(), ids.begin(), ids.end());
    progress.advance(rows.rows());
  });
  progress.end();
  if (static_cast<Eigen::Index>(learned_from.size()) != samples.rows()) throw_inconsistent_source();
  const Rows centres = learn_centres(samples, cells, options.rounds, progress, stop);
  samples.resize(0, 0);

  // Assign a cell to each template.
  std::vector<std::uint32_t> cell_of(static_cast<std::size_t>(count));
  std::vector<std::int64_t> sizes(static_cast<std::size_t>(cells), 0);
  std::int64_t at = 0;
  progress.begin("assigning", count, "templates");
  source(1, [&](std::span<const std::int64_t>, const Rows& rows) {
    throw_if_stopped(stop);
    if (at + rows.rows() > count || rows.cols() != dimension) throw_inconsistent_source();
    nearest_centres(rows, centres, cell_of.data() + at);
    at += rows.rows();
    progress.advance(rows.rows());
  });
  progress.end();
  if (at != count) throw_inconsistent_source();
  for (const std::uint32_t cell : cell_of) ++sizes[cell];

  // Write the cells, as many in each pass as fit into memory.
  const std::size_t stride = stride_of(dimension);
  const std::size_t bytes = row_bytes(dimension);
  const auto memory = static_cast<std::int64_t>(options.memory_gb * 1e9);
  const std::size_t head_end =
      head_size(static_cast<std::size_t>(cells), dimension, learned_from.size());
  Output file(path, head_end);
  std::vector<CellEntry> entries(static_cast<std::size_t>(cells));
  auto offset = static_cast<std::int64_t>(head_end);
  const std::int64_t passes_bytes = count * static_cast<std::int64_t>(bytes);
  progress.begin("writing", (passes_bytes + memory - 1) / memory * count, "templates");
  for (int first = 0; first < cells;) {
    int last = first;
    std::int64_t held = 0;
    while (last < cells && (last == first || (held + sizes[static_cast<std::size_t>(last)]) *
                                                     static_cast<std::int64_t>(bytes) <=
                                                 memory))
      held += sizes[static_cast<std::size_t>(last++)];
    // Ids, scales and numbers of each cell, as in the file.
    std::vector<std::uint8_t> block(static_cast<std::size_t>(held) * bytes);
    std::vector<std::size_t> begin(static_cast<std::size_t>(last - first) + 1, 0);
    for (int c = first; c < last; ++c)
      begin[static_cast<std::size_t>(c - first) + 1] =
          begin[static_cast<std::size_t>(c - first)] +
          static_cast<std::size_t>(sizes[static_cast<std::size_t>(c)]) * bytes;
    std::vector<std::int64_t> filled(static_cast<std::size_t>(last - first), 0);
    std::vector<std::pair<std::size_t, std::int64_t>>
        slots;  // row in this batch, position in its cell
    at = 0;
    source(1, [&](std::span<const std::int64_t> ids, const Rows& rows) {
      throw_if_stopped(stop);
      if (at + rows.rows() > count || rows.cols() != dimension) throw_inconsistent_source();
      slots.clear();
      for (Eigen::Index i = 0; i < rows.rows(); ++i) {
        const auto cell = static_cast<int>(cell_of[static_cast<std::size_t>(at + i)]);
        if (cell < first || cell >= last) continue;
        slots.emplace_back(static_cast<std::size_t>(i),
                           filled[static_cast<std::size_t>(cell - first)]++);
      }
      cv::parallel_for_({0, static_cast<int>(slots.size())}, [&](const cv::Range& range) {
        for (int k = range.start; k < range.end; ++k) {
          const auto [i, slot] = slots[static_cast<std::size_t>(k)];
          const std::size_t cell = cell_of[static_cast<std::size_t>(at) + i];
          const std::size_t own = cell - static_cast<std::size_t>(first);
          const auto size = static_cast<std::size_t>(sizes[cell]);
          const auto here = static_cast<std::size_t>(slot);
          std::uint8_t* const base = block.data() + begin[own];
          std::memcpy(base + here * sizeof(std::int64_t), &ids[i], sizeof(std::int64_t));
          const float scale = encode(
              rows.row(static_cast<Eigen::Index>(i)).data(), dimension,
              reinterpret_cast<std::int8_t*>(base + size * kRowBytes + here * stride), stride);
          std::memcpy(base + size * sizeof(std::int64_t) + here * sizeof(float), &scale,
                      sizeof scale);
        }
      });
      at += rows.rows();
      progress.advance(rows.rows());
    });
    if (at != count) throw_inconsistent_source();
    for (int c = first; c < last; ++c) {
      throw_if_stopped(stop);
      const auto own = static_cast<std::size_t>(c - first);
      const auto size = begin[own + 1] - begin[own];
      const std::span<const std::uint8_t> cell(block.data() + begin[own], size);
      entries[static_cast<std::size_t>(c)] = {offset, sizes[static_cast<std::size_t>(c)],
                                              checksum_of(cell)};
      file.write(cell);
      offset += static_cast<std::int64_t>(size);
    }
    ++report.passes;
    first = last;
  }
  const Head head{metadata.last_id,
                  metadata.space,
                  metadata.model,
                  count,
                  static_cast<std::int64_t>(learned_from.size()),
                  dimension,
                  cells};
  file.finish(head_bytes(head, centres, entries, learned_from, report.sha256));
  progress.end();
  report.templates = count;
  report.bytes = offset;
  return report;
}

CellIndex::CellIndex(std::string path) : path_(std::move(path)) {
  fd_ = ::open(path_.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd_ < 0) throw InputError(path_, "cannot be read: " + errno_text(errno));
  try {
    read_head();
  } catch (...) {
    ::close(std::exchange(fd_, -1));
    throw;
  }
}

CellIndex::~CellIndex() {
  if (fd_ >= 0) ::close(fd_);
}

CellIndex::CellIndex(CellIndex&& other) noexcept
    : path_(std::move(other.path_)),
      fd_(std::exchange(other.fd_, -1)),
      metadata_(other.metadata_),
      sha256_(std::move(other.sha256_)),
      templates_(other.templates_),
      dimension_(other.dimension_),
      centres_(std::move(other.centres_)),
      centre_scales_(std::move(other.centre_scales_)),
      exact_centres_(std::move(other.exact_centres_)),
      cells_(std::move(other.cells_)),
      learned_from_(std::move(other.learned_from_)),
      verified_(std::move(other.verified_)) {}

namespace {

// A short read means that the file was truncated.
bool read_at(int fd, void* to, std::size_t size, std::int64_t offset) {
  auto* out = static_cast<char*>(to);
  while (size > 0) {
    const ssize_t got = ::pread(fd, out, size, static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    out += got;
    offset += got;
    size -= static_cast<std::size_t>(got);
  }
  return true;
}

}  // namespace

void CellIndex::read_head() {
  const auto refuse = [&](const char* why) { throw InputError(path_, why); };
  struct ::stat info {};
  if (::fstat(fd_, &info) != 0 || !S_ISREG(info.st_mode)) refuse("is not an index of templates");
  const auto size = static_cast<std::int64_t>(info.st_size);
  std::array<char, kBeforeHead> before{};
  Head head{};
  if (size < static_cast<std::int64_t>(kBeforeHead + sizeof head) ||
      !read_at(fd_, before.data(), before.size(), 0) ||
      std::string_view(before.data(), kMagic.size()) != kMagic ||
      !read_at(fd_, &head, sizeof head, kBeforeHead))
    refuse("is not an index of templates");
  if (head.dimension <= 0 || head.dimension > kMaxDimension || head.cells <= 0 ||
      head.cells > kMaxCells || head.templates <= 0 || head.templates > kMaxTemplates ||
      head.learned_from < 0 || head.learned_from > head.templates)
    refuse("is damaged");
  const auto cells = static_cast<std::size_t>(head.cells);
  const std::size_t end =
      head_size(cells, head.dimension, static_cast<std::size_t>(head.learned_from));
  const auto bytes = static_cast<std::int64_t>(row_bytes(head.dimension));
  if (size != static_cast<std::int64_t>(end) + head.templates * bytes) refuse("is cut off");
  std::string rest(end - kBeforeHead, '\0');
  if (!read_at(fd_, rest.data(), rest.size(), kBeforeHead)) refuse("is cut off");
  Sha256 sha;
  sha.add(rest);
  sha256_ = sha.hex();
  if (std::string_view(before.data() + kMagic.size(), kSha256Digits) != sha256_ ||
      std::memcmp(rest.data(), &head, sizeof head) != 0)
    refuse("is damaged: its SHA-256 is another");
  metadata_ = {head.last_id, head.space, head.model};
  templates_ = head.templates;
  dimension_ = head.dimension;
  const char* at = rest.data() + sizeof head;
  exact_centres_.resize(head.cells, head.dimension);
  const auto numbers = static_cast<std::size_t>(exact_centres_.size());
  std::memcpy(exact_centres_.data(), at, numbers * sizeof(float));
  at += numbers * sizeof(float);
  if (!exact_centres_.allFinite() || !(exact_centres_.cwiseAbs().maxCoeff() < 2))
    refuse("is damaged");
  const std::size_t stride = stride_of(head.dimension);
  centres_.resize(cells * stride);
  for (std::size_t c = 0; c < cells; ++c)
    centre_scales_.push_back(encode(exact_centres_.row(static_cast<Eigen::Index>(c)).data(),
                                    head.dimension, centres_.data() + c * stride, stride));
  cells_.resize(cells);
  auto offset = static_cast<std::int64_t>(end);
  for (Cell& cell : cells_) {
    CellEntry entry{};
    std::memcpy(&entry, at, sizeof entry);
    at += sizeof entry;
    if (entry.offset != offset || entry.count < 0 || entry.count > head.templates)
      refuse("is damaged");
    cell = {entry.offset, entry.count, entry.checksum};
    offset += entry.count * bytes;
    if (offset > size) refuse("is damaged");
  }
  if (offset != size) refuse("is damaged");
  learned_from_.resize(static_cast<std::size_t>(head.learned_from));
  if (!learned_from_.empty())
    std::memcpy(learned_from_.data(), at, learned_from_.size() * sizeof(std::int64_t));
  verified_ = std::make_unique<std::atomic<bool>[]>(cells);
}

void CellIndex::read_cell(std::size_t cell, std::vector<std::uint8_t>& block) const {
  const Cell& entry = cells_[cell];
  block.resize(static_cast<std::size_t>(entry.count) * row_bytes(dimension_));
  if (!read_at(fd_, block.data(), block.size(), entry.offset))
    throw InputError(path_, "is cut off");
  if (verified_[cell].load(std::memory_order_relaxed)) return;
  if (checksum_of(block) != entry.checksum)
    throw InputError(path_, "is damaged: a cell's sum is another");
  verified_[cell].store(true, std::memory_order_relaxed);
}

std::vector<Candidate> CellIndex::search(std::span<const float> probe, int probes,
                                         int count) const {
  TARSIER_REQUIRE(static_cast<int>(probe.size()) == dimension_, "a template of {} numbers, not {}",
                  probe.size(), dimension_);
  TARSIER_REQUIRE(probes > 0 && count > 0, "{} cells, {} candidates", probes, count);
  const linalg::GemmKernels& kernels = linalg::gemm_kernels();
  const std::size_t stride = stride_of(dimension_);

  std::vector<std::int8_t> codes(stride);
  const float own_scale = encode(probe.data(), dimension_, codes.data(), stride);
  std::vector<std::int32_t> centre_dots(cells_.size());
  kernels.byte_dots(cells(), static_cast<int>(stride), codes.data(), centres_.data(),
                    centre_dots.data());
  std::vector<float> centre_scores(cells_.size());
  for (std::size_t i = 0; i < centre_scores.size(); ++i)
    centre_scores[i] = centre_scales_[i] * static_cast<float>(centre_dots[i]);
  std::vector<std::size_t> order(cells_.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto searched_cells = std::min(order.size(), static_cast<std::size_t>(probes));
  std::partial_sort(
      order.begin(), order.begin() + static_cast<std::ptrdiff_t>(searched_cells), order.end(),
      [&](std::size_t a, std::size_t b) {
        return centre_scores[a] != centre_scores[b] ? centre_scores[a] > centre_scores[b] : a < b;
      });

  const auto better = [](const Candidate& a, const Candidate& b) {
    return a.score != b.score ? a.score > b.score : a.id < b.id;
  };
  const auto max_candidates = static_cast<std::size_t>(count);
  std::vector<Candidate> out;
  std::mutex mutex;
  // Keeps the best candidates of a set. `min_score`: score that a candidate needs to be among them.
  const auto reduce = [&](std::vector<Candidate>& set, float& min_score) {
    if (set.size() <= max_candidates) return;
    std::nth_element(set.begin(), set.begin() + static_cast<std::ptrdiff_t>(max_candidates) - 1,
                     set.end(), better);
    set.resize(max_candidates);
    min_score = set.back().score;
  };
  const auto search_cells = [&](const cv::Range& range) {
    std::vector<std::uint8_t> block;
    std::vector<std::int32_t> dots;
    std::vector<Candidate> own;
    float min_score = std::numeric_limits<float>::lowest();
    for (int k = range.start; k < range.end; ++k) {
      const std::size_t cell = order[static_cast<std::size_t>(k)];
      const auto rows = static_cast<std::size_t>(cells_[cell].count);
      if (rows == 0) continue;
      read_cell(cell, block);
      dots.resize(rows);
      kernels.byte_dots(static_cast<int>(rows), static_cast<int>(stride), codes.data(),
                        reinterpret_cast<const std::int8_t*>(block.data() + rows * kRowBytes),
                        dots.data());
      const std::uint8_t* const scales = block.data() + rows * sizeof(std::int64_t);
      for (std::size_t i = 0; i < rows; ++i) {
        float scale = 0;
        std::memcpy(&scale, scales + i * sizeof(float), sizeof scale);
        const float score = own_scale * scale * static_cast<float>(dots[i]);
        if (!(score >= min_score)) continue;  // also skips NaN from damaged files
        Candidate one;
        std::memcpy(&one.id, block.data() + i * sizeof(std::int64_t), sizeof(std::int64_t));
        one.score = score;
        own.push_back(one);
      }
      reduce(own, min_score);
    }
    const std::lock_guard lock(mutex);
    out.insert(out.end(), own.begin(), own.end());
  };
  // Below this number of rows, starting threads takes longer than the search.
  constexpr std::int64_t kMinParallelRows = 16'384;
  std::int64_t rows = 0;
  for (std::size_t k = 0; k < searched_cells; ++k) rows += cells_[order[k]].count;
  const cv::Range all(0, static_cast<int>(searched_cells));
  if (rows <= kMinParallelRows)
    search_cells(all);
  else
    cv::parallel_for_(all, search_cells);
  float min_score = 0;
  reduce(out, min_score);
  std::sort(out.begin(), out.end(), better);
  return out;
}

void CellIndex::each_cell(const std::function<void(std::span<const std::int64_t> ids)>& take,
                          Progress& progress, const std::stop_token& stop) const {
  std::vector<std::uint8_t> block;
  std::vector<std::int64_t> ids;
  progress.begin("reading", templates_, "templates");
  for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
    throw_if_stopped(stop);
    verified_[cell].store(false, std::memory_order_relaxed);
    read_cell(cell, block);
    ids.resize(static_cast<std::size_t>(cells_[cell].count));
    if (!ids.empty()) std::memcpy(ids.data(), block.data(), ids.size() * sizeof(std::int64_t));
    take(ids);
    progress.advance(cells_[cell].count);
  }
  progress.end();
}

CellIndexReport CellIndex::write_without(const std::string& path,
                                         const std::function<bool(std::int64_t id)>& is_kept,
                                         const std::stop_token& stop) const {
  TARSIER_REQUIRE(std::all_of(learned_from_.begin(), learned_from_.end(), is_kept),
                  "the centres were learned from one that goes");
  const std::size_t end = head_size(cells_.size(), dimension_, learned_from_.size());
  const std::size_t stride = stride_of(dimension_);
  Output file(path, end);
  CellIndexReport report;
  report.cells = cells();
  report.passes = 1;
  std::vector<CellEntry> entries(cells_.size());
  auto offset = static_cast<std::int64_t>(end);
  std::vector<std::uint8_t> block;
  std::vector<std::uint8_t> kept;
  std::vector<std::size_t> rows;
  for (std::size_t cell = 0; cell < cells_.size(); ++cell) {
    throw_if_stopped(stop);
    read_cell(cell, block);
    const auto count = static_cast<std::size_t>(cells_[cell].count);
    rows.clear();
    for (std::size_t i = 0; i < count; ++i) {
      std::int64_t id = 0;
      std::memcpy(&id, block.data() + i * sizeof id, sizeof id);
      if (is_kept(id)) rows.push_back(i);
    }
    kept.resize(rows.size() * row_bytes(dimension_));
    std::uint8_t* to = kept.data();
    const std::uint8_t* from = block.data();
    for (const std::size_t bytes : {sizeof(std::int64_t), sizeof(float), stride}) {
      for (const std::size_t i : rows) {
        std::memcpy(to, from + i * bytes, bytes);
        to += bytes;
      }
      from += count * bytes;
    }
    entries[cell] = {offset, static_cast<std::int64_t>(rows.size()), checksum_of(kept)};
    file.write(kept);
    offset += static_cast<std::int64_t>(kept.size());
    report.templates += static_cast<std::int64_t>(rows.size());
  }
  const Head head{metadata_.last_id,
                  metadata_.space,
                  metadata_.model,
                  report.templates,
                  static_cast<std::int64_t>(learned_from_.size()),
                  dimension_,
                  cells()};
  file.finish(head_bytes(head, exact_centres_, entries, learned_from_, report.sha256));
  report.bytes = offset;
  return report;
}

}  // namespace tarsier::face::recognition
