// SPDX-License-Identifier: MIT
#include "verbs/plate/train_classic.h"

#include "tarsier/core/log.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/plate_svm.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>

namespace tarsier::cli {
namespace {

const std::string& only_input(const ClassicTrainFlags& flags) {
  if (flags.inputs.size() != 1)
    throw UsageError("--pipeline classic learns from one file or folder");
  return flags.inputs.front();
}

nlohmann::json provenance(const ClassicTrainFlags& flags, const Context& context, std::size_t count,
                          const char* what) {
  return {{"program", fmt::format("tarsier {}", version())},
          {"seed", context.seed},
          {"data", std::filesystem::path(flags.inputs.front()).filename().string()},
          {what, count},
          {"terms", flags.terms}};
}

}  // namespace

void add_classic_detector_flags(Command& verb, ClassicTrainFlags& flags) {
  verb.add_option("--features", flags.features, "image features: pixels, hog, pca or lbp")
      .check(one_of({"pixels", "hog", "pca", "lbp"}))
      .show_default()
      .group("Classic");
  bind_all(verb, flags.svm, "Classic");
}

void add_classic_reader_flags(Command& verb, ClassicTrainFlags& flags) {
  verb.add_option("--reader", flags.reader, "hog: linear, on gradients; mlp: the textbook's reader")
      .check(one_of({"hog", "mlp"}))
      .show_default()
      .group("Classic");
  bind_all(verb, flags.characters, "Classic");
  bind_all(verb, flags.characters.mlp, "Classic");
}

ExitStatus train_classic_detector(const ClassicTrainFlags& flags, Context& context) {
  const plate::PlateSet set = plate::read_plate_set(only_input(flags));
  plate::PlateSvmOptions options = flags.svm;
  options.features = plate::parse_plate_features(flags.features);
  const Rng rng(context.seed);
  const double error = plate::cross_validated_error(set, options, rng.fork(7));
  const plate::PlateSvm svm = plate::train_plate_svm(set, options, rng);
  nlohmann::json about = provenance(flags, context, set.candidates.size(), "candidates");
  about["error_of_unseen"] = error;
  plate::write_plate_svm(flags.output, svm, about);
  if (context.json)
    print_json(about);
  else
    log_info("{}: {} candidates, error on held-out candidates {:.1f} %", flags.output,
             set.candidates.size(), 100 * error);
  return ExitStatus::kDone;
}

ExitStatus train_classic_reader(const ClassicTrainFlags& flags, Context& context) {
  const plate::CharacterSet set = plate::read_character_set(only_input(flags));
  plate::CharacterReaderOptions options = flags.characters;
  options.kind = flags.reader == "mlp" ? plate::ReaderKind::kMlp : plate::ReaderKind::kHog;
  const Rng rng(context.seed);
  const auto count = static_cast<int>(set.characters.size());
  if (count < 100) throw InputError(flags.inputs.front(), "holds fewer than 100 characters");
  // Evaluates on held-out characters.
  const plate::CharacterSplit split =
      plate::split_characters(set, static_cast<int>(count * 0.85), rng.fork(1));
  const double error = plate::character_error(
      plate::train_character_reader(set, split.train, options, rng.fork(2), context.stop), set,
      split.test);
  std::vector<int> all(set.characters.size());
  std::iota(all.begin(), all.end(), 0);
  const plate::CharacterReader reader =
      plate::train_character_reader(set, all, options, rng.fork(3), context.stop);
  nlohmann::json about = provenance(flags, context, set.characters.size(), "characters");
  about["error_of_unseen"] = error;
  plate::write_character_reader(flags.output, reader, about);
  if (context.json)
    print_json(about);
  else
    log_info("{}: {} characters, error on held-out characters {:.1f} %", flags.output,
             set.characters.size(), 100 * error);
  return ExitStatus::kDone;
}

}  // namespace tarsier::cli
