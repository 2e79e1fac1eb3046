// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/plot.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/classic/study.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/plate/plate.h"
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct SweepFlags {
  std::string input;
  std::string output;
  std::string csv;
  std::string reader = "mlp";
  plate::StudyOptions options;
};

image::draw::Plot plot_of(const std::vector<plate::StudyCell>& cells) {
  image::draw::Plot plot;
  plot.title = "Error of the reader";
  plot.x.label = "hidden neurons";
  plot.y.label = "error of unseen characters (%)";
  for (const plate::StudyCell& cell : cells) {
    const std::string name = fmt::format("{0}x{0} px", cell.thumbnail_size);
    if (plot.series.empty() || plot.series.back().name != name) {
      plot.series.emplace_back();
      plot.series.back().name = name;
    }
    image::draw::Series& series = plot.series.back();
    series.x.push_back(cell.neurons);
    series.y.push_back(100 * cell.mean());
    series.low.push_back(100 * (cell.mean() - cell.deviation()));
    series.high.push_back(100 * (cell.mean() + cell.deviation()));
    series.markers = true;
  }
  return plot;
}

void write_plot(const std::string& path, const image::draw::Plot& plot) {
  const bool svg = path.size() > 4 && path.substr(path.size() - 4) == ".svg";
  if (svg)
    write_file_atomically(path, image::draw::plot_svg(plot));
  else
    write_image(path, image::draw::plot_image(plot));
}

ExitStatus run_sweep(SweepFlags& flags, Context& context) {
  flags.options.kind = flags.reader == "mlp" ? plate::ReaderKind::kMlp : plate::ReaderKind::kHog;
  flags.options.seed = context.seed;
  const plate::CharacterSet set = plate::read_character_set(flags.input);
  const auto count = static_cast<int>(set.characters.size());
  if (flags.options.train >= count) {
    throw UsageError(
        fmt::format("--train {}: there are {} characters, some must be left as a test set",
                    flags.options.train, count));
  }
  const std::vector<plate::StudyCell> cells =
      plate::study_reader(set, flags.options, *context.progress, context.stop);
  if (!flags.csv.empty()) write_file_atomically(flags.csv, plate::study_csv(cells));
  if (!flags.output.empty()) write_plot(flags.output, plot_of(cells));
  for (const plate::StudyCell& cell : cells) {
    if (context.json) {
      print_json(nlohmann::ordered_json{{"reader", flags.reader},
                                        {"features", cell.thumbnail_size},
                                        {"neurons", cell.neurons},
                                        {"splits", cell.errors.size()},
                                        {"error_mean", rounded(cell.mean(), 5)},
                                        {"error_deviation", rounded(cell.deviation(), 5)}});
    } else {
      print_text(fmt::format("{:>4} px {:>5} neurons  {:6.2f} % +- {:.2f}\n", cell.thumbnail_size,
                             cell.neurons, 100 * cell.mean(), 100 * cell.deviation()));
    }
  }
  const auto best = std::min_element(
      cells.begin(), cells.end(),
      [](const plate::StudyCell& a, const plate::StudyCell& b) { return a.mean() < b.mean(); });
  if (!context.json && cells.size() > 1)
    print_text(fmt::format("best: {0}x{0} px, {1} neurons, {2:.2f} %\n", best->thumbnail_size,
                           best->neurons, 100 * best->mean()));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, SweepFlags& flags) {
  verb.add_option("DATA", flags.input,
                  "OCR.xml, a folder with one folder for each symbol, or labelled plates")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output, "output plot: .png .jpg .svg");
  verb.add_option("--csv", flags.csv, "CSV file of means and standard deviations");
  verb.add_option("--reader", flags.reader, "mlp, or hog: the default reader on the same splits")
      .check(one_of({"mlp", "hog"}))
      .show_default();
  bind_all(verb, flags.options);
}

}  // namespace

void add_plate_sweep(Command& plate, Context& context) {
  add_verb<SweepFlags>(plate, "sweep",
                       "study the character reader: accuracy over input size and hidden neurons",
                       context, add_flags, run_sweep);
}

}  // namespace tarsier::cli
