// SPDX-License-Identifier: MIT
#include "verbs/plate/engine.h"

namespace tarsier::cli {
void add_plate_flags(Command& verb, PlateFlags& flags) {
  verb.add_option("--country", flags.countries,
                  "es, sk, us .. or a group (eu); several allowed; any: all that are known")
      .delimiter(',')
      .type_name("CODE");
  verb.add_option("--pipeline", flags.pipeline, "default: networks; classic: the textbook's")
      .check(one_of({"default", "classic"}))
      .show_default();
  verb.add_option("--top", flags.top, "candidates of each plate")
      .check(range(1, 100))
      .show_default();
  verb.add_option("--min-confidence", flags.min_confidence, "leave out plates below, 0..1")
      .check(range(0.0, 1.0))
      .show_default();
  const auto model = [](Flag& flag) { flag.group("Models"); };
  model(verb.add_option("--detector", flags.detector, "file; default: what ships"));
  model(verb.add_option("--reader,--model", flags.reader, "file; default: what ships"));
  model(verb.add_option("--countries-dir", flags.countries_folder,
                        "folder of layouts (*.txt); default: what ships"));
  model(verb.add_option("--classic-reader", flags.classic_reader, "mlp: the textbook's; hog")
            .check(one_of({"mlp", "hog"}))
            .show_default());
  const auto tune = [](Flag& flag) { flag.show_default().group("Finding and decoding"); };
  tune(verb.add_option("--find-threshold", flags.recognizer.detector.threshold,
                       "of the detector, (0, 1); lower: more, slower"));
  tune(verb.add_option("--find-pixels", flags.recognizer.detector.max_pixels,
                       "larger pictures are searched at this many; more: smaller plates, slower"));
  tune(verb.add_option("--plate-threshold", flags.recognizer.min_plate,
                       "of the aligner's plate score, (0, 1)"));
  tune(verb.add_option(
      "--evidence", flags.recognizer.min_evidence,
      "ln(confidence) + logit(plate) of what is reported; lower: more, of which more "
      "are none"));
  tune(verb.add_option("--free-penalty", flags.decoding.free_penalty,
                       "nats against texts that fit no country's layout, 0..50"));
}

plate::ReaderOptions reader_options(const PlateFlags& flags, const Context& context) {
  plate::ReaderOptions options;
  options.pipeline =
      flags.pipeline == "classic" ? plate::Pipeline::kTextbook : plate::Pipeline::kNetworks;
  options.countries = flags.countries;
  options.min_confidence = flags.min_confidence;
  options.max_candidates = flags.top;
  options.countries_folder = flags.countries_folder;
  options.detector_model = flags.detector;
  options.reader_model = flags.reader;
  options.recognizer = flags.recognizer;
  options.recognizer.parallel = context.threads != 1;
  options.decoding = flags.decoding;
  options.textbook_reader =
      flags.classic_reader == "mlp" ? plate::ReaderKind::kMlp : plate::ReaderKind::kHog;
  options.textbook.seed = context.seed;
  return options;
}

plate::Reader load_reader(const PlateFlags& flags, const Context& context) {
  return plate::Reader::load(ModelStore::find(), reader_options(flags, context));
}

}  // namespace tarsier::cli
