// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/recognition/evaluation.h"
#include "tarsier/face/recognition/same_camera.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "framework/size_flag.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include <algorithm>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier::cli {
namespace {

using face::recognition::Algorithm;
using face::recognition::EvaluationResult;
using face::recognition::Rate;
using face::recognition::SeedResult;

const cv::Size kPlot{800, 560};

struct PeopleEvalFlags {
  PeopleFlags people;
  std::string list;
  std::string train_list;
  bool raw = false;
  std::string size;
  int training = 5;
  int seeds = 5;
  int enrolled = 0;
  double rate = 0.01;
  bool fit_same_camera = false;
  std::vector<std::string> algorithms;
  std::string csv;
  std::string cmc;
  std::string roc;
};

nlohmann::ordered_json json_of(const Rate& rate) {
  if (rate.value < 0) return nullptr;
  return {{"rate", rounded(rate.value, 4)},       {"hits", rate.count.hits},
          {"trials", rate.count.trials},          {"draws", rate.draws},
          {"low", rounded(rate.interval.low, 4)}, {"high", rounded(rate.interval.high, 4)}};
}

// Uncertain faces count as probes. An image without a face counts as a wrong probe in every split.
Rate overall_identification_rate(const EvaluationResult& result, std::size_t missed) {
  Rate out = result.rate(&SeedResult::identified);
  const Rate uncertain = result.rate(&SeedResult::uncertain_identified);
  if (out.draws == 0 || (missed == 0 && uncertain.draws == 0)) return out;
  out.count.hits += uncertain.count.hits;
  out.count.trials += uncertain.count.trials + static_cast<long>(missed) * out.draws;
  const auto trials = static_cast<double>(out.count.trials);
  out.value = static_cast<double>(out.count.hits) / trials;
  out.interval = wilson_interval_of_rate(out.value, trials / out.draws);
  return out;
}

// Faces that are probes and do not train.
std::ptrdiff_t count_uncertain(const ListedFaces& listed) {
  return std::count(listed.trusted.begin(), listed.trusted.end(), false);
}

nlohmann::ordered_json line_of(const EvaluationResult& result, const ListedFaces& listed,
                               const std::string& background) {
  const SeedResult m = result.mean();
  const Rate identified = overall_identification_rate(result, listed.missed.size());
  nlohmann::ordered_json line = {
      {"algorithm", face::recognition::name_of(result.algorithm)},
      {"training", result.options.gallery > 0 ? nlohmann::ordered_json(nullptr)
                                              : nlohmann::ordered_json(result.options.training)},
      {"training_images", result.seeds.front().training},
      {"seeds", result.seeds.size()},
      {"people", m.people},
      {"accuracy", rounded(m.accuracy, 4)},
      {"accuracy_of_all", rounded(identified.value, 4)},
      {"identified", json_of(identified)},
      {"not_found", listed.missed.size()},
      {"uncertain", count_uncertain(listed)},
      {"uncertain_identified", json_of(result.rate(&SeedResult::uncertain_identified))}};
  line["background"] =
      result.with_background ? nlohmann::ordered_json(background) : nlohmann::ordered_json(nullptr);
  if (result.options.open_set) {
    const auto or_null = [](double value) {
      return value < 0 ? nlohmann::ordered_json(nullptr)
                       : nlohmann::ordered_json(rounded(value, 4));
    };
    line["enrolled"] = result.options.enrolled > 0 ? result.options.enrolled : m.people / 2;
    line["tar"] = or_null(m.true_accept_rate);
    line["dir"] = or_null(m.correct_accept_rate);
    line["eer"] = or_null(m.equal_error_rate);
    line["auc"] = or_null(m.auc);
    line["chosen_true"] = json_of(result.rate(&SeedResult::true_accept_count));
    line["chosen_right"] = json_of(result.rate(&SeedResult::correct_accept_count));
    line["stated_rate"] = result.options.stated_rate;
    line["stated_tar"] = or_null(m.calibrated_true_accept_rate);
    line["stated_dir"] = or_null(m.calibrated_correct_accept_rate);
    line["stated_far"] = or_null(m.calibrated_false_accept_rate);
    line["stated_true"] = json_of(result.rate(&SeedResult::calibrated_true_accept_count));
    line["stated_right"] = json_of(result.rate(&SeedResult::calibrated_correct_accept_count));
    line["stated_false"] = json_of(result.rate(&SeedResult::calibrated_false_accept_count));
    line["uncertain_true"] = json_of(result.rate(&SeedResult::uncertain_true_accept_count));
    line["uncertain_false"] = json_of(result.rate(&SeedResult::uncertain_false_accept_count));
  }
  line["train_s"] = rounded(m.train_seconds, 4);
  line["identify_ms"] = rounded(m.identify_ms, 4);
  return line;
}

// "95.20 % (476 of 500; 89.1 to 98.0 %)"
std::string text_of(const Rate& rate) {
  if (rate.value < 0) return "-";
  return fmt::format("{:.2f} % ({} of {}; {:.1f} to {:.1f} %)", 100 * rate.value, rate.count.hits,
                     rate.count.trials, 100 * rate.interval.low, 100 * rate.interval.high);
}

std::string text_of(const EvaluationResult& result, std::size_t missed) {
  const SeedResult m = result.mean();
  std::string text =
      fmt::format("{:<8} identified          {}\n", face::recognition::name_of(result.algorithm),
                  text_of(overall_identification_rate(result, missed)));
  if (result.options.open_set) {
    if (m.calibrated) {
      text += fmt::format(
          "         at the stated rate of {:g} %, with the calibrated threshold:\n"
          "           true accepts      {}\n"
          "           by the right name {}\n"
          "           false accepts     {}\n",
          100 * result.options.stated_rate,
          text_of(result.rate(&SeedResult::calibrated_true_accept_count)),
          text_of(result.rate(&SeedResult::calibrated_correct_accept_count)),
          text_of(result.rate(&SeedResult::calibrated_false_accept_count)));
    } else {
      text +=
          "         no calibrated threshold: no impostor scores (more people or a background "
          "needed)\n";
    }
    text += fmt::format(
        "         at a threshold chosen on these very scores for {:g} % false accepts:\n"
        "           true accepts      {}\n"
        "           by the right name {}\n"
        "         equal error rate {:.2f} %, area under the curve {:.4f}\n",
        100 * result.options.false_accepts, text_of(result.rate(&SeedResult::true_accept_count)),
        text_of(result.rate(&SeedResult::correct_accept_count)), 100 * m.equal_error_rate, m.auc);
  }
  if (result.rate(&SeedResult::uncertain_identified).draws > 0) {
    text += fmt::format(
        "         uncertain faces (included in the first line only): identified {}\n"
        "           true accepts      {}\n"
        "           false accepts     {}\n",
        text_of(result.rate(&SeedResult::uncertain_identified)),
        text_of(result.rate(&SeedResult::uncertain_true_accept_count)),
        text_of(result.rate(&SeedResult::uncertain_false_accept_count)));
  }
  return text + fmt::format("         training {:.2f} s, a probe {:.2f} ms\n", m.train_seconds,
                            m.identify_ms);
}

ExitStatus fit_same_camera_constants(const PeopleEvalFlags& flags, const ListedFaces& listed,
                                     const std::optional<face::recognition::Background>& background,
                                     Context& context) {
  if (!background) throw UsageError("--fit-same-camera needs a background");
  const face::recognition::SameCameraAdjustment compiled =
      face::recognition::same_camera_adjustment(background->network ? Algorithm::kDeep
                                                                    : Algorithm::kDefault);
  face::recognition::SameCameraFit fit;
  try {
    fit =
        face::recognition::fit_same_camera(listed.faces, listed.labels, flags.training, flags.seeds,
                                           *background, *context.progress, context.stop);
  } catch (const std::invalid_argument& error) {
    throw InputError(flags.list, error.what());
  }
  if (context.json) {
    print_json({{"shift", rounded(fit.adjustment.shift, 4)},
                {"spread", rounded(fit.adjustment.spread, 4)},
                {"compiled_shift", compiled.shift},
                {"compiled_spread", compiled.spread},
                {"people", fit.people},
                {"galleries", fit.galleries},
                {"scores", fit.scores}});
    return ExitStatus::kDone;
  }
  print_text(
      fmt::format("impostor scores of this camera: mean {:+.4f} above the background's, standard "
                  "deviation {:.3f} times the background's\n"
                  "  ({} scores against {} galleries of one person, {} people; the program uses "
                  "{:g} and {:g})\n",
                  fit.adjustment.shift, fit.adjustment.spread, fit.scores, fit.galleries,
                  fit.people, compiled.shift, compiled.spread));
  return ExitStatus::kDone;
}

// The faces of --train-list (if given), then those of the list. `gallery` returns the number of
// training faces. Throws InputError if a person of the list has no detected face in --train-list.
ListedFaces read_faces(const PeopleEvalFlags& flags, cv::Size size,
                       face::people::FaceReader* reader, Context& context, int& gallery) {
  ListedFaces probes = read_listed_faces(flags.list, flags.raw, size, false, reader, context,
                                         UncertainFaces::kInclude);
  for (const std::string& image : probes.missed) log_warning("{}: no face", image);
  gallery = 0;
  if (flags.train_list.empty()) return probes;
  ListedFaces out = read_listed_faces(flags.train_list, flags.raw, size, false, reader, context);
  for (const std::string& image : out.missed) log_warning("{}: no face", image);
  gallery = static_cast<int>(out.faces.size());
  for (const std::string& label : probes.labels)
    if (std::find(out.labels.begin(), out.labels.begin() + gallery, label) ==
        out.labels.begin() + gallery)
      throw InputError(
          flags.list,
          fmt::format("{} has no face in {}: each probe person needs a training image there",
                      printable(label), flags.train_list));
  out.missed = std::move(probes.missed);
  std::move(probes.faces.begin(), probes.faces.end(), std::back_inserter(out.faces));
  std::move(probes.labels.begin(), probes.labels.end(), std::back_inserter(out.labels));
  out.trusted.insert(out.trusted.end(), probes.trusted.begin(), probes.trusted.end());
  return out;
}

void write_plot(const std::string& path, const cv::Mat& image, const std::string& svg) {
  if (path.ends_with(".svg")) {
    write_file_atomically(path, std::string_view(svg));
  } else {
    write_image(path, image);
  }
}

ExitStatus evaluate_people(const PeopleEvalFlags& flags, Context& context) {
  std::vector<Algorithm> algorithms;
  for (const std::string& name : flags.algorithms) {
    try {
      algorithms.push_back(face::recognition::parse_algorithm(name));
    } catch (const std::invalid_argument& error) {
      throw UsageError(fmt::format("--algorithm: {}", error.what()));
    }
  }
  const face::TemplateKind kind = template_kind(flags.people);
  if (algorithms.empty() && kind != face::TemplateKind::kDeep)
    algorithms = {Algorithm::kEigen, Algorithm::kFisher, Algorithm::kLbph, Algorithm::kDefault};
  if (flags.algorithms.empty() &&
      (kind == face::TemplateKind::kDeep || (kind == face::TemplateKind::kAuto && !flags.raw &&
                                             face::has_deep_templates(ModelStore::find()))))
    algorithms.push_back(Algorithm::kDeep);
  const bool deep = std::count(algorithms.begin(), algorithms.end(), Algorithm::kDeep) > 0;
  // Deep templates have their own background. --background names it only if no other algorithm is
  // evaluated.
  std::optional<face::recognition::Background> deep_background;
  if (deep)
    deep_background =
        algorithms.size() == 1
            ? find_deep_background(flags.people)
            : face::load_deep_background(ModelStore::find(), {}, own_network(flags.people));
  // The installed background is used, as for a gallery, unless the user names another one or none.
  // Raw images are cropped differently from the faces of that background. So they are evaluated
  // without it, unless one is named (as in `people train --raw`).
  const bool named = !flags.people.background.empty();
  const bool general = std::count(algorithms.begin(), algorithms.end(), Algorithm::kDefault) > 0;
  std::optional<face::recognition::Background> background;
  const bool only_deep = deep && algorithms.size() == 1;
  if (!only_deep && (named || (general && !flags.raw))) background = find_background(flags.people);
  const std::string path = background_path(flags.people);
  const std::string deep_path = only_deep && named
                                    ? flags.people.background
                                    : ModelStore::find().expected_path("people-deep.json");
  const cv::Size size = flags.size.empty() ? cv::Size() : parse_size(flags.size, 8, 1024);
  std::optional<face::people::FaceReader> reader;
  if (!flags.raw)
    reader.emplace(make_face_reader(
        flags.people, flags.fit_same_camera ? UncertainFaces::kExclude : UncertainFaces::kInclude));
  // All algorithms share these crops; the classical preparation is computed from them.
  face::recognition::EvaluationOptions options;
  const ListedFaces listed =
      read_faces(flags, size, reader ? &*reader : nullptr, context, options.gallery);
  options.training = flags.training;
  options.may_train = listed.trusted;
  options.seeds.clear();
  for (int i = 0; i < flags.seeds; ++i) options.seeds.push_back(static_cast<std::uint64_t>(i));
  options.stated_rate = flags.rate;
  options.enrolled = flags.enrolled;
  if (flags.fit_same_camera)
    return fit_same_camera_constants(flags, listed, only_deep ? deep_background : background,
                                     context);
  std::vector<EvaluationResult> results;
  if (!context.json) {
    const std::string training = options.gallery > 0
                                     ? fmt::format("{} more training images of {}", options.gallery,
                                                   printable(flags.train_list))
                                     : fmt::format("{} training images each", flags.training);
    print_text(fmt::format(
        "{} faces of {} people in {}, {}, {} draws; {} not found, {} uncertain (these do not "
        "train)\n"
        "background of the {} recogniser: {}\n"
        "(in brackets: counts of all draws; the 95 % interval by the probes of one draw, as draws "
        "share their images)\n",
        listed.faces.size() - static_cast<std::size_t>(options.gallery),
        face::recognition::count_people(listed.labels), printable(flags.list), training,
        flags.seeds, listed.missed.size(), count_uncertain(listed), only_deep ? "deep" : "default",
        only_deep    ? printable(deep_path)
        : background ? printable(path)
        : flags.raw && !named
            ? "none (--raw: the one that ships is for faces that the program cuts)"
            : "none"));
  }
  for (const Algorithm algorithm : algorithms) {
    std::vector<cv::Mat> faces = listed.faces;
    if (!flags.raw && !face::recognition::is_whitened(algorithm))
      for (cv::Mat& face : faces) face = face::people::recognizer_input(algorithm, face);
    face::recognition::RecognizerOptions recognizer;
    recognizer.algorithm = algorithm;
    try {
      results.push_back(face::recognition::evaluate(
          faces, listed.labels, recognizer, options, *context.progress, context.stop,
          algorithm == Algorithm::kDeep ? &*deep_background
          : background                  ? &*background
                                        : nullptr));
    } catch (const std::invalid_argument& error) {
      throw InputError(flags.list, error.what());
    }
    if (context.json) {
      print_json(line_of(results.back(), listed, algorithm == Algorithm::kDeep ? deep_path : path));
    } else {
      print_text(text_of(results.back(), listed.missed.size()));
    }
  }
  if (!flags.csv.empty())
    write_file_atomically(flags.csv, std::string_view(face::recognition::evaluation_csv(results)));
  if (!flags.cmc.empty())
    write_plot(flags.cmc, face::recognition::cmc_plot(results, kPlot),
               face::recognition::cmc_plot_svg(results, kPlot));
  if (!flags.roc.empty())
    write_plot(flags.roc, face::recognition::roc_plot(results, kPlot),
               face::recognition::roc_plot_svg(results, kPlot));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, PeopleEvalFlags& flags) {
  verb.add_option(
          "LIST", flags.list,
          "list of images, path<TAB>label a line; optionally four more columns: the eyes x y x y")
      .required();
  verb.add_flag("--raw", flags.raw, "the images are face crops already");
  verb.add_option("--size", flags.size, "size of the resized images: 42x48");
  Flag& training =
      verb.add_option("-k,--training", flags.training, "training images of each person")
          .check(range(1, 10000))
          .show_default();
  Flag& train_list =
      verb.add_option(
              "--train-list", flags.train_list,
              "second list to train on; all of LIST are probes (other light, poses or years)")
          .excludes(training);
  verb.add_option("--seeds", flags.seeds, "random splits, with seeds 0, 1, 2 ..")
      .check(range(1, 1000))
      .show_default();
  verb.add_option("--algorithm", flags.algorithms,
                  "algorithms to evaluate: eigen,fisher,lbph,default,deep")
      .delimiter(',');
  verb.add_option("--enrolled", flags.enrolled,
                  "number of enrolled people; the others are unknown [half of them]")
      .check(range(1, 1000000));
  verb.add_option("--far", flags.rate, "false accept rate that sets each model's threshold")
      .check(range(1e-6, 0.5))
      .show_default();
  verb.add_option("--csv", flags.csv, "CSV file, one row a split");
  verb.add_option("--cmc", flags.cmc,
                  "plot of the identification rate over the rank (CMC), .png or .svg");
  verb.add_option("--roc", flags.roc,
                  "plot of true accepts over false accepts (ROC), .png or .svg");
  verb.add_flag(
          "--fit-same-camera", flags.fit_same_camera,
          "measure the rise of impostor scores above the background's, for images of one camera")
      .excludes(train_list);
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_eval(Command& area, Context& context) {
  add_verb<PeopleEvalFlags>(area, "eval", "evaluate recognisers on a labelled list", context,
                            add_flags, evaluate_people);
}

}  // namespace tarsier::cli
