// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/adapt.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/stopwatch.h"
#include "verbs/landmarks/landmarks.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::cli {
namespace {

struct AdaptFlags {
  SetFlags set;
  std::string base;
  std::string output;
  std::string terms;
  double ridge = 0;
  int hold_out = 0;
  face::landmarks::AdaptOptions options;
};

nlohmann::json provenance(const AdaptFlags& flags, const std::string& base,
                          const face::landmarks::AdaptedModel& adapted, const Context& context) {
  const std::string terms = "those of " + std::filesystem::path(base).filename().string();
  return {{"program", fmt::format("tarsier {}", version())},
          {"seed", context.seed},
          {"adapted_from", std::filesystem::path(base).filename().string()},
          {"data", std::filesystem::path(flags.set.input).filename().string()},
          {"samples", adapted.faces},
          {"ridge", adapted.ridge},
          {"terms", flags.terms.empty() ? terms : terms + "; " + flags.terms}};
}

std::string text_of(const AdaptFlags& flags, const face::landmarks::AdaptedModel& adapted,
                    double seconds) {
  std::string text = fmt::format("{}: {} {}, ridge {:g}", flags.output, adapted.faces,
                                 adapted.faces == 1 ? "image" : "images", adapted.ridge);
  if (adapted.base_error > 0) {
    text += fmt::format(
        "; error on held-out images {:.2f} % of the face size, of the base model {:.2f} %",
        100 * adapted.adapted_error, 100 * adapted.base_error);
  }
  return text + fmt::format("; {} s\n", seconds);
}

ExitStatus adapt(AdaptFlags& flags, Context& context) {
  const Stopwatch watch;
  const std::string base = ModelStore::find().path_or(flags.base, "landmarks68.json");
  const face::landmarks::LandmarkModel model = face::landmarks::read_landmark_model(base);
  if (!model.trees && !model.descent) {
    throw ModelError(base, "has neither trees nor sdm: only these can be adapted");
  }
  const face::shape::LandmarkSet set = part_of(load_set(flags.set), flags.hold_out, Part::kOthers);
  flags.options.seed = context.seed;
  if (flags.ridge > 0) flags.options.ridge = flags.ridge;
  const face::landmarks::AdaptedModel adapted = face::landmarks::adapt_landmark_model(
      model, set, "", flags.options, *context.progress, context.stop);
  for (const std::string& skipped : adapted.skipped) log_warning("{}; left out", skipped);
  if (adapted.base_kept)
    log_warning("{}: adapting does not reduce the error on held-out images: the base model is kept",
                base);
  face::landmarks::write_landmark_model(flags.output, adapted.model,
                                        provenance(flags, base, adapted, context));
  const double seconds = rounded(watch.seconds(), 1);
  if (context.json) {
    nlohmann::ordered_json line = {{"output", flags.output},
                                   {"faces", adapted.faces},
                                   {"ridge", adapted.ridge},
                                   {"chosen", adapted.ridge_chosen},
                                   {"kept", adapted.base_kept}};
    if (adapted.base_error > 0) {
      line["before"] = rounded(adapted.base_error, 5);
      line["after"] = rounded(adapted.adapted_error, 5);
    }
    line["seconds"] = seconds;
    print_json(line);
  } else if (!context.quiet) {
    print_text(text_of(flags, adapted, seconds));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, AdaptFlags& flags) {
  add_set_flags(verb, flags.set);
  verb.add_option("--model,--base", flags.base, "model to start from [landmarks68.json, shipped]");
  verb.add_option("-o,--output", flags.output, "output model file (.json)").required();
  verb.add_option("--ridge", flags.ridge,
                  "weight of the base model, in images; 0: chosen on held-out images from 3 "
                  "images on, else 0.3")
      .check(range(0.0, 1e6))
      .show_default();
  bind_field(verb, flags.options, flags.options.starts);
  verb.add_option("--hold-out", flags.hold_out,
                  "hold out every N-th sample, for `landmarks eval --held-out N`; 0: none")
      .check(range(0, 1000000))
      .show_default();
  verb.add_option("--terms", flags.terms, "terms of use of the data, stored in the model");
}

}  // namespace

void add_landmarks_adapt(Command& area, Context& context) {
  add_verb<AdaptFlags>(area, "adapt",
                       "adapt a model to one person or camera from a few annotated images", context,
                       add_flags, adapt);
}

}  // namespace tarsier::cli
