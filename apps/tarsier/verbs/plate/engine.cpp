// SPDX-License-Identifier: MIT
#include "verbs/plate/engine.h"

#include "framework/bind.h"

namespace tarsier::cli {
void add_plate_flags(Command& verb, PlateFlags& flags) {
  plate::ReaderOptions& reader = flags.reader;
  verb.add_option("--country", reader.countries,
                  "country code es, sk, us .. or group (eu), repeatable; any: all known countries")
      .delimiter(',')
      .type_name("CODE");
  verb.add_option("--pipeline", flags.pipeline,
                  "default: neural networks; classic: the textbook pipeline (SVM, MLP)")
      .check(one_of({"default", "classic"}))
      .show_default();
  bind_field(verb, reader, reader.max_candidates);
  bind_field(verb, reader, reader.min_confidence);
  const auto model = [](Flag& flag) { flag.group("Models"); };
  model(verb.add_option("--detector", reader.detector_model, "model file [the shipped model]"));
  model(verb.add_option("--reader,--model", reader.reader_model, "model file [the shipped model]"));
  model(verb.add_option("--countries-dir", reader.countries_folder,
                        "folder of plate layouts (*.txt) [the shipped ones]"));
  model(verb.add_option("--classic-reader", flags.classic_reader,
                        "mlp: the textbook's reader; hog: linear, on gradients")
            .check(one_of({"mlp", "hog"}))
            .show_default());
  constexpr const char* kTuning = "Finding and decoding";
  bind_all(verb, reader.recognizer.detector, kTuning);
  bind_all(verb, reader.recognizer, kTuning);
  bind_all(verb, reader.decoding, kTuning);
}

plate::ReaderOptions reader_options(const PlateFlags& flags, const Context& context) {
  plate::ReaderOptions options = flags.reader;
  options.pipeline =
      flags.pipeline == "classic" ? plate::Pipeline::kTextbook : plate::Pipeline::kNetworks;
  options.recognizer.parallel = context.threads != 1;
  options.textbook_reader =
      flags.classic_reader == "mlp" ? plate::ReaderKind::kMlp : plate::ReaderKind::kHog;
  options.textbook.seed = context.seed;
  return options;
}

plate::Reader load_reader(const PlateFlags& flags, const Context& context) {
  return plate::Reader::load(ModelStore::find(), reader_options(flags, context));
}

}  // namespace tarsier::cli
