// SPDX-License-Identifier: MIT
#include "tarsier/core/elapsed.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/gallery_index.h"
#include "tarsier/face/people/model.h"
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
#include <cmath>
#include <ctime>
#include <limits>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using face::recognition::Candidate;
using face::recognition::CellIndex;
using face::recognition::Rows;
using Clock = std::chrono::steady_clock;

double cpu_since(std::clock_t start, std::size_t runs) {
  return 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC /
         static_cast<double>(runs);
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

// The nearest template of each probe by exhaustive search.
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

// Measures the index alone, with templates that are generated on demand.
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
                 {"memory_mb", std::round(peak_memory())}});
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
      const std::clock_t cpu = std::clock();
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
                     {"p95", rounded(ms[ms.size() * 95 / 100], 3)},
                     {"mean_cpu_ms", rounded(cpu_since(cpu, ms.size()), 3)}});
    }
  }
  line(context,
       {{"bench", "people"}, {"case", name + "in all"}, {"memory_mb", std::round(peak_memory())}});
}

namespace {

// Fills a gallery with `count` faces, whose crops are identical.
void fill_gallery(face::people::Gallery& gallery, const DrawnTemplates& drawn, std::int64_t space,
                  std::int64_t count, Context& context) {
  constexpr std::int64_t kBatch = 2000LL * kDrawnImages;
  cv::Mat crop(160, 128, CV_8UC1, cv::Scalar(100));
  context.progress->begin("enrolling", count, "faces");
  for (std::int64_t first = 0; first < count; first += kBatch) {
    throw_if_stopped(context.stop);
    const std::int64_t last = std::min(count, first + kBatch);
    std::vector<DrawnTemplates::Image> images;
    for (std::int64_t i = first; i < last; ++i)
      images.push_back({i / kDrawnImages, static_cast<int>(i % kDrawnImages)});
    const Rows coordinates = drawn.coordinates(images);
    std::vector<face::people::NewFace> batch(images.size());
    for (std::size_t i = 0; i < images.size(); ++i) {
      face::people::NewFace& entry = batch[i];
      entry.name = fmt::format("p{}", images[i].person);
      entry.face.crop = crop;
      entry.face.quality = 0.5;
      entry.face.measures = "{}";
      entry.face.source = "drawn";
      const auto row = coordinates.row(static_cast<Eigen::Index>(i));
      entry.face.features.assign(row.data(), row.data() + row.size());
      entry.face.space = space;
    }
    gallery.enroll(batch);
    context.progress->advance(last - first);
  }
  context.progress->end();
}

}  // namespace

void bench_indexed_gallery(Context& context, const face::recognition::Background& background,
                           std::int64_t count, double spread, const std::string& folder) {
  using face::people::SearchMode;
  constexpr int kProbes = 500;
  const std::string name = fmt::format("{} faces, spread {}: ", count, spread);
  const auto tell = [&](const std::string& what, nlohmann::ordered_json figures) {
    nlohmann::ordered_json object = {{"bench", "people"}, {"case", name + what}};
    object.update(figures);
    line(context, object);
  };
  const DrawnTemplates drawn(background, spread, context.seed, context.stop);
  face::people::Gallery gallery(folder + "/people.db");
  const std::int64_t space = -face::recognition::fingerprint(background);
  auto start = Clock::now();
  fill_gallery(gallery, drawn, space, count, context);
  tell("enrol", {{"seconds", rounded(seconds_since(start), 4)}});
  start = Clock::now();
  (void)face::people::load_gallery_model(gallery, &background, true,
                                         face::people::TrainingPolicy::kIfNeeded, *context.progress,
                                         context.stop, SearchMode::kNone);
  tell("learn", {{"seconds", rounded(seconds_since(start), 4)}});
  start = Clock::now();
  const auto report =
      face::people::build_gallery_index(gallery, background, {}, *context.progress, context.stop);
  tell("build the index", {{"seconds", rounded(seconds_since(start), 4)},
                           {"cells", report.index.cells},
                           {"file_mb", rounded(static_cast<double>(report.index.bytes) / 1e6, 4)},
                           {"memory_mb", std::round(peak_memory())}});
  const auto open = [&](SearchMode search_mode) {
    start = Clock::now();
    auto model = face::people::load_gallery_model(gallery, &background, true,
                                                  face::people::TrainingPolicy::kIfNeeded,
                                                  *context.progress, context.stop, search_mode);
    tell(search_mode == SearchMode::kExhaustive ? "open, exact" : "open, by the index",
         {{"seconds", rounded(seconds_since(start), 4)}});
    return face::people::GalleryFollower(gallery, &background, std::move(model), search_mode);
  };
  std::vector<DrawnTemplates::Image> images;
  for (int k = 0; k < kProbes; ++k) {
    images.push_back({k * 7919LL % (count / kDrawnImages), kDrawnImages});
    images.push_back({(1LL << 41) + k, 0});
  }
  std::vector<face::people::Recognition> answers[2];
  for (const SearchMode search_mode : {SearchMode::kIndexed, SearchMode::kExhaustive}) {
    const bool by_index = search_mode == SearchMode::kIndexed;
    face::people::GalleryFollower follower = open(search_mode);
    const face::recognition::CoordinateProjection projection(*follower.recognizer(), background);
    const Rows probes = projection(drawn.coordinates(images));
    std::vector<double> ms;
    const std::clock_t cpu = std::clock();
    for (Eigen::Index k = 0; k < probes.rows(); ++k) {
      throw_if_stopped(context.stop);
      const std::vector<float> probe(probes.row(k).data(), probes.row(k).data() + probes.cols());
      start = Clock::now();
      answers[by_index ? 0 : 1].push_back(follower.recognize(probe, 0.01));
      ms.push_back(1e3 * seconds_since(start));
    }
    std::sort(ms.begin(), ms.end());
    tell(by_index ? "name, by the index" : "name, exact",
         {{"ms", rounded(ms[ms.size() / 2], 4)},
          {"p95", rounded(ms[ms.size() * 95 / 100], 4)},
          {"mean_cpu_ms", rounded(cpu_since(cpu, ms.size()), 3)},
          {"memory_mb", std::round(peak_memory())}});
  }
  int same[2] = {0, 0};
  int known[2] = {0, 0};
  int known_elsewhere = 0;
  for (std::size_t k = 0; k < answers[0].size(); ++k) {
    const face::people::Recognition& index = answers[0][k];
    const face::people::Recognition& exact = answers[1][k];
    if (index.label == exact.label && index.score == exact.score &&
        index.threshold == exact.threshold && index.confidence == exact.confidence)
      ++same[k % 2];
    if (exact.known) ++known[k % 2];
    if (exact.known != index.known) ++known_elsewhere;
  }
  tell("of 500 enrolled people and 500 strangers", {{"same_answer", same[0]},
                                                    {"same_of_strangers", same[1]},
                                                    {"known", known[0]},
                                                    {"strangers_accepted", known[1]},
                                                    {"known_differs", known_elsewhere}});
  start = Clock::now();
  const auto forgotten = gallery.forget("p7", context.stop);
  tell("forget a person, with index and proof",
       {{"seconds", rounded(seconds_since(start), 4)},
        {"index", static_cast<int>(forgotten->index)},
        {"current", face::people::gallery_index_state(gallery).current}});
}

}  // namespace tarsier::cli
