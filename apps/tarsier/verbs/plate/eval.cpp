// SPDX-License-Identifier: MIT
#include "verbs/plate/eval.h"

#include "tarsier/core/csv.h"
#include "tarsier/core/log.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/plate/plate.h"
#include <chrono>
#include <fstream>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::cli {
namespace {

using plate::ImageReadings;
using plate::PlateOutcome;

struct PlateEvalFlags {
  std::vector<std::string> inputs;
  std::vector<std::string> truths;
  plate::EvaluationOptions options;
  bool errors = false;
  std::string csv;
};

bool is_results(const std::string& input) { return input == "-" || input.ends_with(".jsonl"); }

std::vector<ImageReadings> read_results(const std::string& input) {
  if (input == "-") return plate::parse_readings(std::cin, "standard input");
  std::ifstream stream(input, std::ios::binary);
  if (!stream) throw InputError(input, "cannot be opened");
  std::vector<ImageReadings> readings = plate::parse_readings(stream, input);
  if (stream.bad()) throw InputError(input, "cannot be read");
  return readings;
}

std::vector<ImageReadings> read_images(const std::vector<std::string>& inputs,
                                       const ImageReader& reader, const Context& context) {
  const std::unique_ptr<FrameSource> source = open_sources(inputs);
  if (source->is_live()) throw UsageError("plate eval evaluates images, not live sources");
  std::vector<ImageReadings> readings;
  context.progress->begin("reading", source->count(), "images");
  while (!source->ended()) {
    throw_if_stopped(context.stop);
    const std::optional<Frame> frame = source->next(std::chrono::milliseconds(200), context.stop);
    if (!frame) continue;
    readings.push_back(reader(*frame));
    context.progress->advance();
  }
  context.progress->end();
  throw_if_stopped(context.stop);
  return readings;
}

plate::PlateTruth read_truths(const std::vector<std::string>& paths) {
  plate::PlateTruth all;
  for (const std::string& path : paths) {
    for (auto& [image, plates] : plate::read_plate_truth(path)) {
      if (!all.emplace(image, std::move(plates)).second) {
        throw InputError(
            path,
            fmt::format("'{}' is in two ground-truth files: images are matched by their base names",
                        printable(image)));
      }
    }
  }
  return all;
}

std::vector<ImageReadings> collect_readings(const PlateEvalFlags& flags,
                                            const ImageReading& reading, const Context& context) {
  std::vector<ImageReadings> readings;
  std::vector<std::string> images;
  for (const std::string& input : flags.inputs) {
    if (!is_results(input)) {
      images.push_back(input);
      continue;
    }
    for (ImageReadings& image : read_results(input)) readings.push_back(std::move(image));
  }
  if (images.empty()) return readings;
  if (!reading.make) {
    throw UsageError(
        fmt::format("'{}' is not a file of results: the lines of `plate read --json` end in "
                    ".jsonl, or are - for standard input",
                    printable(images.front())));
  }
  for (ImageReadings& image : read_images(images, reading.make(), context)) {
    readings.push_back(std::move(image));
  }
  return readings;
}

std::string percent(double share) {
  return share < 0 ? std::string("    -  ") : fmt::format("{:5.1f} %", 100 * share);
}

// " 95 %: 79-97 %": the confidence interval of a rate.
std::string interval_text(int successes, int trials) {
  if (trials == 0) return {};
  const Interval interval = wilson_interval(successes, trials);
  return fmt::format("95 %: {:.1f}-{:.1f} %", 100 * interval.low, 100 * interval.high);
}

std::string table(const plate::PlateScores& scores) {
  const auto line = [](const char* name, double share, const std::string& of) {
    return fmt::format("{:<22} {}  {}\n", name, percent(share), of);
  };
  std::string text = fmt::format("{} images, {} plates\n", scores.images, scores.truth);
  text += line("found", scores.recall,
               fmt::format("{}/{}  {}", scores.found, scores.boxes,
                           interval_text(scores.found, scores.boxes)));
  text += line("found at overlap 0.3", scores.recall_at_03, "");
  text += line("precision", scores.precision, fmt::format("{} returned", scores.returned));
  text += line("exact", scores.exact_rate,
               fmt::format("{}/{}  {}", scores.exact, scores.texts,
                           interval_text(scores.exact, scores.texts)));
  text += line("exact, O is 0", scores.texts > 0 ? 1.0 * scores.exact_o_as_0 / scores.texts : -1,
               fmt::format("{}/{}", scores.exact_o_as_0, scores.texts));
  text += line("exact, any place", scores.exact_any_rate,
               fmt::format("{}/{}", scores.exact_any, scores.texts));
  text += line("among ten", scores.top10_rate, fmt::format("{}/{}", scores.top10, scores.texts));
  text += line("characters", scores.character_rate, "");
  text += line("characters of found", scores.found_character_rate, "");
  text += scores.confidence_auc < 0
              ? fmt::format("{:<22}     -\n", "confidence AUC")
              : fmt::format("{:<22} {:6.3f}\n", "confidence AUC", scores.confidence_auc);
  if (scores.evaluated > 0) {
    text += fmt::format("{:<22} {:6.3f}  expected, of {} confidences\n", "calibration error",
                        scores.calibration_error, scores.evaluated);
    text += line("wrong above 0.9",
                 scores.high_confidence > 0
                     ? 1.0 * scores.high_confidence_wrong / scores.high_confidence
                     : -1,
                 fmt::format("{}/{}  {}", scores.high_confidence_wrong, scores.high_confidence,
                             interval_text(scores.high_confidence_wrong, scores.high_confidence)));
  }
  if (scores.median_ms >= 0) {
    text += fmt::format("{:<22} {:5.1f} ms median, {:.1f} ms 90th percentile\n", "time",
                        scores.median_ms, scores.p90_ms);
  }
  return text;
}

nlohmann::ordered_json outcome_json(const PlateOutcome& outcome) {
  return {{"image", outcome.image},
          {"truth", outcome.truth.text},
          {"found", outcome.found},
          {"text", outcome.reading ? nlohmann::ordered_json(outcome.reading->text) : nullptr},
          {"confidence",
           outcome.reading ? nlohmann::ordered_json(outcome.reading->confidence) : nullptr},
          {"edits", outcome.edits}};
}

std::string outcomes_csv(const plate::PlateScores& scores) {
  std::string text = csv_line({"image", "truth", "found", "text", "confidence", "edits", "exact"});
  for (const PlateOutcome& outcome : scores.outcomes) {
    text += csv_line({outcome.image, outcome.truth.text, outcome.found ? "1" : "0",
                      outcome.reading ? outcome.reading->text : "",
                      outcome.reading ? fmt::format("{:.4f}", outcome.reading->confidence) : "",
                      fmt::format("{}", outcome.edits), outcome.exact ? "1" : "0"});
  }
  return text;
}

ExitStatus evaluate(const PlateEvalFlags& flags, const ImageReading& reading,
                    const Context& context) {
  const plate::PlateTruth truth = read_truths(flags.truths);
  const std::vector<ImageReadings> readings = collect_readings(flags, reading, context);
  const plate::PlateScores scores = plate::evaluate_plates(readings, truth, flags.options);
  if (!flags.csv.empty() && flags.csv != "-") {
    write_file_atomically(flags.csv, std::string_view(outcomes_csv(scores)));
  }
  if (flags.csv == "-") {
    print_text(outcomes_csv(scores));
    return ExitStatus::kDone;
  }
  if (context.json) {
    print_json(plate::scores_json(scores));
  } else {
    print_text(table(scores));
  }
  if (!flags.errors) return ExitStatus::kDone;
  for (const PlateOutcome& outcome : scores.outcomes) {
    if (outcome.exact) continue;
    if (context.json) {
      print_json(outcome_json(outcome));
    } else {
      print_text(fmt::format("{}  {}  {}  {}\n", outcome.found ? "read  " : "missed",
                             printable(outcome.image), outcome.truth.text,
                             outcome.reading ? printable(outcome.reading->text) : ""));
    }
  }
  return ExitStatus::kDone;
}

}  // namespace

void add_plate_eval(Command& plate, Context& context, ImageReading reading) {
  Command& verb =
      plate.add_subcommand("eval", "evaluate detection and reading against ground truth");
  const auto flags = std::make_shared<PlateEvalFlags>();
  verb.add_option("INPUT", flags->inputs,
                  "results: .jsonl file of `plate read --json`, - for stdin; or the images to read")
      .required();
  verb.add_option("--truth", flags->truths,
                  "ground truth CSV with columns image,x,y,w,h,text ('-': a hidden character); "
                  "repeatable")
      .required();
  bind_all(verb, flags->options);
  verb.add_flag("--errors", flags->errors, "list missed and misread plates");
  verb.add_option("--csv", flags->csv, "CSV file: result of each plate; - for stdout");
  if (reading.add_flags) reading.add_flags(verb);
  add_common_flags(verb, context);
  set_run(verb, context, [&context, flags, reading = std::move(reading)] {
    return evaluate(*flags, reading, context);
  });
}

void add_plate_eval(Command& plate, Context& context) { add_plate_eval(plate, context, {}); }

}  // namespace tarsier::cli
