// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/cell_index.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/linalg/gemm.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <fstream>
#include <set>
#include <stdexcept>

namespace tarsier::face::recognition {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::SizeIs;

constexpr int kDimension = 40;
constexpr int kImagesPerPerson = 3;

// People with `kImagesPerPerson` templates each, of length 1.
Rows random_templates(int people, std::uint64_t seed = 1) {
  Rows rows(people * kImagesPerPerson, kDimension);
  for (int p = 0; p < people; ++p) {
    Rng person(seed + static_cast<std::uint64_t>(p));
    Eigen::RowVectorXf middle(kDimension);
    for (int i = 0; i < kDimension; ++i) middle(i) = static_cast<float>(person.normal());
    for (int k = 0; k < kImagesPerPerson; ++k) {
      for (int i = 0; i < kDimension; ++i)
        rows(p * kImagesPerPerson + k, i) = middle(i) + 0.4F * static_cast<float>(person.normal());
      rows.row(p * kImagesPerPerson + k).normalize();
    }
  }
  return rows;
}

// Ids 10, 20, 30 .. in pieces of seven.
TemplateSource source_of(const Rows& rows) {
  return [&rows](std::int64_t step, const auto& take) {
    std::vector<std::int64_t> ids;
    std::vector<Eigen::Index> of;
    const auto flush = [&] {
      Rows piece(static_cast<Eigen::Index>(of.size()), rows.cols());
      for (std::size_t i = 0; i < of.size(); ++i)
        piece.row(static_cast<Eigen::Index>(i)) = rows.row(of[i]);
      take(ids, piece);
      ids.clear();
      of.clear();
    };
    for (Eigen::Index i = 0; i < rows.rows(); i += step) {
      ids.push_back(10 * (i + 1));
      of.push_back(i);
      if (ids.size() == 7) flush();
    }
    if (!ids.empty()) flush();
  };
}

class CellIndexTest : public FolderTest {
 protected:
  CellIndexReport write(const Rows& rows, const std::string& file,
                        const CellIndexOptions& options = {}) {
    return write_cell_index(file, static_cast<int>(rows.cols()), rows.rows(), source_of(rows),
                            {10 * rows.rows(), -7, 3}, options, progress_, {});
  }
  static std::vector<float> probe_of(const Rows& rows, Eigen::Index i) {
    return {rows.row(i).data(), rows.row(i).data() + rows.cols()};
  }
  NoProgress progress_;
};

TEST(ByteDots, AgreeForAllInstructionSets) {
  constexpr int kLength = 3 * linalg::kByteStep;
  Rng rng(5);
  std::vector<std::int8_t> a(kLength);
  std::vector<std::int8_t> b(4 * kLength);
  for (auto* numbers : {&a, &b})
    for (std::int8_t& number : *numbers) number = static_cast<std::int8_t>(rng.integer(-127, 127));
  std::fill(b.begin(), b.begin() + kLength, std::int8_t{-127});
  std::fill(b.begin() + kLength, b.begin() + 2 * kLength, std::int8_t{127});
  std::fill(a.begin(), a.begin() + kLength / 2, std::int8_t{127});
  for (const auto* kernels : {linalg::gemm_baseline(), &linalg::gemm_kernels()}) {
    std::vector<std::int32_t> out(4, -1);
    kernels->byte_dots(4, kLength, a.data(), b.data(), out.data());
    for (int n = 0; n < 4; ++n) {
      std::int32_t sum = 0;
      for (int i = 0; i < kLength; ++i)
        sum += a[static_cast<std::size_t>(i)] * b[static_cast<std::size_t>(n * kLength + i)];
      EXPECT_EQ(out[static_cast<std::size_t>(n)], sum) << n;
    }
  }
}

TEST_F(CellIndexTest, FindsIndexedTemplates) {
  const Rows rows = random_templates(500);
  const CellIndexReport report = write(rows, path("i"));
  EXPECT_EQ(report.templates, 1500);
  EXPECT_EQ(report.passes, 1);
  const CellIndex index(path("i"));
  EXPECT_EQ(index.sha256(), report.sha256);
  EXPECT_EQ(index.metadata().last_id, 15000);
  EXPECT_EQ(index.metadata().space, -7);
  EXPECT_EQ(index.metadata().model, 3);
  EXPECT_EQ(index.templates(), 1500);
  int found = 0;
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const auto near = index.search(probe_of(rows, i), 4, 5);
    ASSERT_EQ(near.size(), 5U);
    EXPECT_EQ(near.front().id, 10 * (i + 1));
    EXPECT_NEAR(near.front().score, 1, 0.02);
    // The other templates of the same person.
    for (std::size_t k = 1; k < kImagesPerPerson; ++k)
      found += (near[k].id / 10 - 1) / kImagesPerPerson == i / kImagesPerPerson;
  }
  EXPECT_GT(found, 2 * 1500 * 0.95);
}

TEST_F(CellIndexTest, SearchOfAllCellsEqualsAnExhaustiveSearch) {
  const Rows rows = random_templates(300);
  (void)write(rows, path("i"));
  const CellIndex index(path("i"));
  const Rows probes = random_templates(40, 900);
  for (Eigen::Index i = 0; i < probes.rows(); ++i) {
    Eigen::Index best = 0;
    (rows * probes.row(i).transpose()).maxCoeff(&best);
    const auto near = index.search(probe_of(probes, i), index.cells(), 8);
    EXPECT_TRUE(std::any_of(near.begin(), near.end(),
                            [&](const Candidate& c) { return c.id == 10 * (best + 1); }));
  }
}

TEST_F(CellIndexTest, FileDoesNotDependOnThreadsAndPasses) {
  const Rows rows = random_templates(400);
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const CellIndexReport one = write(rows, path("one"));
  cv::setNumThreads(4);
  (void)write(rows, path("four"));
  CellIndexOptions small_memory;
  small_memory.memory_gb = 0.01;
  Rows many(0, 0);
  EXPECT_EQ(contents(path("one")), contents(path("four")));
  // 120 000 templates of 76 bytes are more than 10 MB in two passes.
  const Rows large = random_templates(60'000);
  const CellIndexReport whole = write(large, path("whole"), {.cells = 64, .rounds = 1});
  small_memory.cells = 64;
  small_memory.rounds = 1;
  const CellIndexReport pieces = write(large, path("pieces"), small_memory);
  cv::setNumThreads(threads);
  EXPECT_EQ(whole.passes, 1);
  EXPECT_GT(pieces.passes, 1);
  EXPECT_EQ(contents(path("whole")), contents(path("pieces")));
  EXPECT_THAT(one.sha256, SizeIs(64));
}

TEST_F(CellIndexTest, WriteWithoutRemovesTemplates) {
  const Rows rows = random_templates(500);
  const CellIndexReport whole = write(rows, path("i"), {.learn_from = 1});
  const CellIndex index(path("i"));
  const std::vector<std::int64_t>& learned = index.learned_from();
  std::int64_t gone = 20;
  while (std::binary_search(learned.begin(), learned.end(), gone)) gone += 10;
  const auto is_kept = [&](std::int64_t id) { return id != gone; };
  const CellIndexReport less = index.write_without(path("less"), is_kept, {});
  EXPECT_EQ(less.templates, whole.templates - 1);
  EXPECT_NE(less.sha256, whole.sha256);
  const CellIndex other(path("less"));
  std::set<std::int64_t> ids;
  other.each_cell([&](std::span<const std::int64_t> cell) { ids.insert(cell.begin(), cell.end()); },
                  progress_, {});
  EXPECT_EQ(ids.size(), 1499U);
  EXPECT_FALSE(ids.contains(gone));
  EXPECT_EQ(other.search(probe_of(rows, 100), 4, 1).front().id, 1010);
  EXPECT_THROW(
      (void)index.write_without(path("x"), [&](std::int64_t id) { return id != learned[0]; }, {}),
      std::invalid_argument);
}

TEST_F(CellIndexTest, RejectsDamagedFiles) {
  const Rows rows = random_templates(60);
  (void)write(rows, path("i"));
  const std::string whole = contents(path("i"));
  const auto put = [&](const std::string& bytes) {
    std::ofstream(path("d"), std::ios::binary) << bytes;
  };
  for (const std::size_t size :
       {std::size_t{0}, std::size_t{7}, std::size_t{100}, whole.size() / 2, whole.size() - 1}) {
    put(whole.substr(0, size));
    EXPECT_THROW(CellIndex{path("d")}, InputError) << size;
  }
  put(whole + "x");
  EXPECT_THROW(CellIndex{path("d")}, InputError);
  EXPECT_THROW(CellIndex{path("missing")}, InputError);
  // One flipped bit anywhere. In the head it is refused at once, in a cell when the cell is read.
  Rng rng(3);
  for (int k = 0; k < 300; ++k) {
    std::string bytes = whole;
    const auto at = static_cast<std::size_t>(rng.integer(0, static_cast<int>(bytes.size()) - 1));
    bytes[at] = static_cast<char>(bytes[at] ^ (1 << rng.integer(0, 7)));
    put(bytes);
    EXPECT_THROW(
        {
          const CellIndex index(path("d"));
          index.each_cell([](std::span<const std::int64_t>) {}, progress_, {});
        },
        InputError)
        << at;
    EXPECT_THROW(
        {
          const CellIndex index(path("d"));
          (void)index.search(probe_of(rows, 0), index.cells(), 3);
        },
        InputError)
        << at;
  }
}

TEST_F(CellIndexTest, RejectsAnInconsistentSource) {
  const Rows rows = random_templates(60);
  int calls = 0;
  const TemplateSource changing = [&](std::int64_t step, const auto& take) {
    ++calls;
    const Rows fewer = rows.topRows(rows.rows() - (calls > 2 ? 1 : 0));
    source_of(fewer)(step, take);
  };
  EXPECT_THROW(
      (void)write_cell_index(path("i"), kDimension, rows.rows(), changing, {}, {}, progress_, {}),
      std::invalid_argument);
  EXPECT_THROW(CellIndex{path("i")}, InputError) << "no head was written";
}

TEST_F(CellIndexTest, CanBeInterrupted) {
  const Rows rows = random_templates(60);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)write_cell_index(path("i"), kDimension, rows.rows(), source_of(rows), {}, {},
                                      progress_, stop.get_token()),
               Interrupted);
}

TEST(CellIndexOptionsTest, CellCountGrowsWithTemplates) {
  EXPECT_EQ(cells_for(0), 16);
  EXPECT_EQ(cells_for(10'000'000), 8192);
  EXPECT_EQ(cells_for(1'000'000'000'000), 65536);
}

}  // namespace
}  // namespace tarsier::face::recognition
