// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/cell_index.h"
#include "tarsier/linalg/gemm.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include "bench.h"
#include "bench_people.h"
#include "drawn_templates.h"
#include "verbs/people/engine.h"
#include <algorithm>
#include <chrono>
#include <limits>

namespace tarsier::cli {
namespace {

using face::recognition::Candidate;
using face::recognition::CellIndex;
using face::recognition::Rows;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

void line(const Context& context, const nlohmann::ordered_json& object) {
  if (context.json) return print_json(object);
  std::string text;
  for (const auto& [key, value] : object.items())
    if (key != "bench" && key != "case") text += fmt::format("  {} {}", key, value.dump());
  print_text(fmt::format("{:<46}{}\n", object["case"].get<std::string>(), text));
}

struct Best {
  std::int64_t id = 0;
  float score = -std::numeric_limits<float>::infinity();
};

// The nearest template of each probe among them all.
std::vector<Best> exact_search(const face::recognition::TemplateSource& source, const Rows& probes,
                               std::int64_t count, Context& context) {
  std::vector<Best> best(static_cast<std::size_t>(probes.rows()));
  context.progress->begin("exact search", count, "templates");
  source(1, [&](std::span<const std::int64_t> ids, const Rows& rows) {
    throw_if_stopped(context.stop);
    const Rows dots = face::recognition::products(probes, rows);
    for (Eigen::Index p = 0; p < dots.rows(); ++p)
      for (Eigen::Index i = 0; i < dots.cols(); ++i)
        if (Best& one = best[static_cast<std::size_t>(p)]; dots(p, i) > one.score)
          one = {ids[static_cast<std::size_t>(i)], dots(p, i)};
    context.progress->advance(rows.rows());
  });
  context.progress->end();
  return best;
}

}  // namespace

// The index by itself, of templates that are drawn as they are needed.
void bench_template_index(Context& context, const face::recognition::Background& background,
                          std::int64_t count, double spread, const std::string& folder) {
  constexpr int kProbes = 500;
  constexpr int kCandidates = 64;
  const DrawnTemplates drawn(background, spread, context.seed, context.stop);
  const auto source = drawn.source(count);
  const std::string name = fmt::format("{} templates, spread {}: ", count, spread);
  const std::string path = folder + "/people.db.index";
  auto start = Clock::now();
  const auto report =
      face::recognition::write_cell_index(path, drawn.recognizer().template_length(), count, source,
                                          {}, {}, *context.progress, context.stop);
  line(context, {{"bench", "people"},
                 {"case", name + "build"},
                 {"seconds", rounded(seconds_since(start), 4)},
                 {"numbers", drawn.recognizer().template_length()},
                 {"cells", report.cells},
                 {"passes", report.passes},
                 {"file_mb", rounded(static_cast<double>(report.bytes) / 1e6, 4)},
                 {"memory_mb", rounded(peak_memory(), 4)}});
  start = Clock::now();
  const CellIndex index(path);
  line(context, {{"bench", "people"},
                 {"case", name + "open"},
                 {"ms", rounded(1e3 * seconds_since(start), 4)}});
  for (const bool enrolled : {true, false}) {
    std::vector<DrawnTemplates::Image> images;
    for (int k = 0; k < kProbes; ++k)
      images.push_back(
          enrolled ? DrawnTemplates::Image{k * 7919LL % (count / kDrawnImages), kDrawnImages}
                   : DrawnTemplates::Image{(1LL << 41) + k, 0});
    const Rows probes = drawn.templates(images);
    const std::vector<Best> best = exact_search(source, probes, count, context);
    double mean = 0;
    int right = 0;
    for (int k = 0; k < kProbes; ++k) {
      mean += static_cast<double>(best[static_cast<std::size_t>(k)].score) / kProbes;
      if ((best[static_cast<std::size_t>(k)].id - 1) / kDrawnImages ==
          images[static_cast<std::size_t>(k)].person)
        ++right;
    }
    const std::string who = enrolled ? "enrolled people" : "strangers";
    line(context, {{"bench", "people"},
                   {"case", name + who + ", exact"},
                   {"probes", kProbes},
                   {"mean_score", rounded(mean, 4)},
                   {"nearest_right", right}});
    for (const int cells : {8, 16, 24, 32, 48, 64, 96, 128, 256}) {
      int found = 0;
      std::vector<double> ms;
      for (int k = 0; k < kProbes; ++k) {
        throw_if_stopped(context.stop);
        const auto row = probes.row(k);
        start = Clock::now();
        const auto near =
            index.search({row.data(), static_cast<std::size_t>(row.size())}, cells, kCandidates);
        ms.push_back(1e3 * seconds_since(start));
        if (std::any_of(near.begin(), near.end(), [&](const Candidate& one) {
              return one.id == best[static_cast<std::size_t>(k)].id;
            }))
          ++found;
      }
      std::sort(ms.begin(), ms.end());
      line(context, {{"bench", "people"},
                     {"case", fmt::format("{}{}, {} cells", name, who, cells)},
                     {"recall_at_1", rounded(static_cast<double>(found) / kProbes, 4)},
                     {"ms", rounded(ms[ms.size() / 2], 3)},
                     {"p95", rounded(ms[ms.size() * 95 / 100], 3)}});
    }
  }
  line(context,
       {{"bench", "people"}, {"case", name + "in all"}, {"memory_mb", rounded(peak_memory(), 4)}});
}

}  // namespace tarsier::cli
