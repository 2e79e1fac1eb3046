// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/io/atomic_file.h"
#include "tarsier/io/image_file.h"
#include "tarsier/recognition/evaluation.h"

#include <fmt/format.h>

#include "cmd_people.h"
#include "people_engine.h"
#include "size_flag.h"
#include <algorithm>
#include <cmath>
#include <memory>

namespace tarsier::cli {
namespace {

using recognition::Algorithm;
using recognition::EvaluationResult;
using recognition::SeedResult;

const cv::Size kPlot{800, 560};

struct EvalFlags {
  PeopleFlags people;
  std::string list;
  bool raw = false;
  std::string size;
  int training = 5;
  int seeds = 5;
  double rate = 0.01;
  std::vector<std::string> algorithms;
  std::string csv;
  std::string cmc;
  std::string roc;
};

nlohmann::ordered_json line_of(const EvaluationResult& result, std::size_t missed,
                               double all_accuracy) {
  const SeedResult m = result.mean();
  const auto rounded = [](double v) { return std::round(v * 1e4) / 1e4; };
  nlohmann::ordered_json line = {{"algorithm", recognition::name_of(result.algorithm)},
                                 {"training", result.options.training},
                                 {"seeds", result.seeds.size()},
                                 {"accuracy", rounded(m.accuracy)},
                                 {"accuracy_of_all", rounded(all_accuracy)},
                                 {"not_found", missed}};
  if (result.options.strangers) {
    line["tar"] = rounded(m.true_accepts);
    line["dir"] = rounded(m.right_accepts);
    line["eer"] = rounded(m.equal_error);
    line["auc"] = rounded(m.area);
    line["stated_rate"] = result.options.stated_rate;
    line["stated_tar"] = rounded(m.stated_true);
    line["stated_far"] = rounded(m.stated_false);
  }
  line["train_s"] = rounded(m.train_seconds);
  line["identify_ms"] = rounded(m.identify_ms);
  return line;
}

void write_plot(const std::string& path, const cv::Mat& image, const std::string& svg) {
  if (path.ends_with(".svg")) {
    write_file_atomically(path, std::string_view(svg));
  } else {
    write_image(path, image);
  }
}

ExitStatus evaluate_people(const EvalFlags& flags, Context& context) {
  std::vector<Algorithm> algorithms;
  for (const std::string& name : flags.algorithms) {
    try {
      algorithms.push_back(recognition::parse_algorithm(name));
    } catch (const std::invalid_argument& error) {
      throw UsageError(fmt::format("--algorithm: {}", error.what()));
    }
  }
  if (algorithms.empty())
    algorithms = {Algorithm::kEigen, Algorithm::kFisher, Algorithm::kLbph, Algorithm::kDefault};
  const cv::Size size = flags.size.empty() ? cv::Size() : parse_size(flags.size, 8, 1024);
  std::optional<people::FaceReader> reader;
  if (!flags.raw) reader.emplace(make_face_reader(flags.people));
  // The cut faces serve all; the classical preparation is made from them.
  const ListedFaces listed =
      read_listed_faces(flags.list, flags.raw, size, false, reader ? &*reader : nullptr, context);
  for (const std::string& path : listed.missed) log_warning("{}: no face", path);
  recognition::EvaluationOptions options;
  options.training = flags.training;
  options.seeds.clear();
  for (int i = 0; i < flags.seeds; ++i) options.seeds.push_back(static_cast<std::uint64_t>(i));
  options.stated_rate = flags.rate;
  std::vector<EvaluationResult> results;
  if (!context.json) {
    print_text(fmt::format("{} faces of {}, {} training pictures each, {} draws; {} not found\n",
                           listed.faces.size(), printable(flags.list), flags.training, flags.seeds,
                           listed.missed.size()));
    print_text(fmt::format("{:<9}{:>10}{:>8}{:>8}{:>8}{:>8}{:>11}{:>11}{:>9}{:>9}\n", "",
                           "accuracy", "TAR 1%", "DIR", "EER", "AUC", "stated TAR", "FAR",
                           "train s", "ident ms"));
  }
  for (const Algorithm algorithm : algorithms) {
    std::vector<cv::Mat> faces = listed.faces;
    if (!flags.raw && algorithm != Algorithm::kDefault)
      for (cv::Mat& face : faces) face = people::recognizer_input(algorithm, face);
    recognition::RecognizerOptions recognizer;
    recognizer.algorithm = algorithm;
    try {
      results.push_back(recognition::evaluate(faces, listed.labels, recognizer, options,
                                              *context.progress, context.stop));
    } catch (const std::invalid_argument& error) {
      throw InputError(flags.list, error.what());
    }
    const SeedResult m = results.back().mean();
    // Faces that were not found count as wrong, as probes.
    const double probes = m.probes;
    const double all =
        probes > 0 ? m.accuracy * probes / (probes + static_cast<double>(listed.missed.size())) : 0;
    if (context.json) {
      print_json_line(dumped(line_of(results.back(), listed.missed.size(), all)));
    } else {
      print_text(fmt::format(
          "{:<9}{:>8.2f} %{:>8.3f}{:>8.3f}{:>8.3f}{:>8.4f}{:>11.3f}{:>11.4f}{:>9.2f}{:>9.2f}\n",
          recognition::name_of(algorithm), 100 * all, m.true_accepts, m.right_accepts,
          m.equal_error, m.area, m.stated_true, m.stated_false, m.train_seconds, m.identify_ms));
    }
  }
  if (!flags.csv.empty())
    write_file_atomically(flags.csv, std::string_view(recognition::evaluation_csv(results)));
  if (!flags.cmc.empty())
    write_plot(flags.cmc, recognition::match_plot(results, kPlot),
               recognition::match_plot_svg(results, kPlot));
  if (!flags.roc.empty())
    write_plot(flags.roc, recognition::accept_plot(results, kPlot),
               recognition::accept_plot_svg(results, kPlot));
  return ExitStatus::kDone;
}

}  // namespace

void add_people_eval(CLI::App& area, Context& context) {
  CLI::App& verb = *area.add_subcommand("eval", "how well the recognisers do, side by side");
  auto flags = std::make_shared<EvalFlags>();
  verb.add_option("LIST", flags->list,
                  "lines `path<TAB>label`, with four more fields the eyes x y x y as seen")
      ->required();
  verb.add_flag("--raw", flags->raw, "pictures are cut faces already");
  verb.add_option("--size", flags->size, "pictures are resized to, e.g. 42x48");
  verb.add_option("-k,--training", flags->training, "pictures of each person that train")
      ->check(CLI::Range(1, 10000))
      ->capture_default_str();
  verb.add_option("--seeds", flags->seeds, "random draws, with seeds 0, 1, 2 ..")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  verb.add_option("--algorithm", flags->algorithms, "only these: eigen,fisher,lbph,default")
      ->delimiter(',');
  verb.add_option("--far", flags->rate, "rate that each model's own threshold is asked for")
      ->check(CLI::Range(1e-6, 0.5))
      ->capture_default_str();
  verb.add_option("--csv", flags->csv, "table to write, a line for each draw");
  verb.add_option("--cmc", flags->cmc, "plot of ranks to write, .png or .svg");
  verb.add_option("--roc", flags->roc, "plot of accepts to write, .png or .svg");
  add_face_flags(verb, flags->people);
  add_common_flags(verb, context);
  verb.callback([flags, &context] {
    context.run = [flags, &context] { return evaluate_people(*flags, context); };
  });
}

}  // namespace tarsier::cli
