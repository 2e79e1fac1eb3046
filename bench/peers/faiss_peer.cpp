// SPDX-License-Identifier: MIT
// faiss_peer BACKGROUND.json TEMPLATES [SPREAD]: runs faiss's inverted file with 8 bits per number
// (IVF, SQ8) on the random templates of `tarsier bench people --size templates:N`, one thread,
// processor time. Prints JSON lines: seconds to train and to add; then for several numbers of cells
// the recall of the exact nearest template among 64 candidates, and ms per probe.
#include "tarsier/face/recognition/background.h"
#include "tarsier/face/recognition/cell_index.h"

#include "../drawn_templates.h"
#include <algorithm>
#include <cstdlib>
#include <ctime>
#include <faiss/IndexIVF.h>
#include <faiss/index_factory.h>
#include <iostream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <omp.h>
#include <string>
#include <vector>

using tarsier::cli::DrawnTemplates;
using tarsier::cli::kDrawnImages;
using tarsier::face::recognition::Rows;
using Id = faiss::Index::idx_t;

namespace {

// Processor time, which other work on the machine hardly affects.
double seconds_since(std::clock_t start) {
  return static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  omp_set_num_threads(1);
  const auto background = tarsier::face::recognition::read_background(argv[1]);
  const std::int64_t count = std::atoll(argv[2]);
  const DrawnTemplates drawn(background, argc > 3 ? std::atof(argv[3]) : 1, 1, {});
  const auto source = drawn.source(count);
  const int length = drawn.recognizer().template_length();
  const int cells = tarsier::face::recognition::cells_for(count);
  const std::unique_ptr<faiss::Index> index(faiss::index_factory(
      length, ("IVF" + std::to_string(cells) + ",SQ8").c_str(), faiss::METRIC_INNER_PRODUCT));

  std::vector<float> sample;
  source(std::max<std::int64_t>(1, count / (cells * 32LL)), [&](auto, const Rows& rows) {
    sample.insert(sample.end(), rows.data(), rows.data() + rows.size());
  });
  auto start = std::clock();
  index->train(static_cast<Id>(sample.size()) / length, sample.data());
  const double learn = seconds_since(start);
  constexpr int kProbes = 500;
  std::vector<DrawnTemplates::Image> images;
  for (int k = 0; k < kProbes; ++k)
    images.push_back({k * 7919LL % (count / kDrawnImages), kDrawnImages});
  const Rows probes = drawn.templates(images);
  std::vector<float> best(kProbes, -std::numeric_limits<float>::infinity());
  std::vector<Id> nearest(kProbes, -1);
  double add = 0;
  source(1, [&](auto ids, const Rows& rows) {
    start = std::clock();
    index->add(static_cast<Id>(rows.rows()), rows.data());
    add += seconds_since(start);
    const Rows dots = tarsier::face::recognition::products(probes, rows);
    for (Eigen::Index p = 0; p < dots.rows(); ++p)
      for (Eigen::Index i = 0; i < dots.cols(); ++i)
        if (dots(p, i) > best[static_cast<std::size_t>(p)]) {
          best[static_cast<std::size_t>(p)] = dots(p, i);
          nearest[static_cast<std::size_t>(p)] = ids[static_cast<std::size_t>(i)] - 1;
        }
  });
  std::cout << nlohmann::ordered_json(
                   {{"templates", count}, {"cells", cells}, {"learn_s", learn}, {"add_s", add}})
            << "\n";
  constexpr Id kCandidates = 64;
  for (const std::size_t looked : {16, 32, 64, 128}) {
    dynamic_cast<faiss::IndexIVF&>(*index).nprobe = looked;
    int found = 0;
    std::vector<double> ms;
    std::vector<float> scores(kCandidates);
    std::vector<Id> ids(kCandidates);
    for (int k = 0; k < kProbes; ++k) {
      start = std::clock();
      index->search(1, probes.row(k).data(), kCandidates, scores.data(), ids.data());
      ms.push_back(1e3 * seconds_since(start));
      found += std::count(ids.begin(), ids.end(), nearest[static_cast<std::size_t>(k)]) > 0 ? 1 : 0;
    }
    std::sort(ms.begin(), ms.end());
    std::cout << nlohmann::ordered_json({{"cells_looked_into", looked},
                                         {"recall_at_1", found / static_cast<double>(kProbes)},
                                         {"ms", ms[kProbes / 2]}})
              << std::endl;
  }
  return 0;
}
