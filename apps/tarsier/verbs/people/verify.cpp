// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/media/frame_source.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/batch.h"
#include "framework/input_schemes.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include <algorithm>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct VerifyFlags {
  PeopleFlags people;
  std::string name;
  std::vector<std::string> inputs;
  double rate = 0.01;
  BatchFlags batch;
};

struct VerificationResult {
  face::people::Recognition identity;
  bool trusted = true;
};

// Compares with the claimed person only. So a stranger has one chance of a false accept, not one
// for each enrolled person. Empty: corrections exclude the person.
std::optional<VerificationResult> verify_face(const face::recognition::Recognizer& model,
                                              const face::people::Face& face,
                                              const std::string& name, double rate) {
  const auto features = face::recognition::template_of(
      model, face::people::recognizer_input(model.options.algorithm, face.crop));
  for (const auto& person : face::recognition::identify_template(model, features)) {
    if (model.labels[static_cast<std::size_t>(person.person)] == name)
      return VerificationResult{face::people::recognition_of(model, person, rate, 1), face.trusted};
  }
  return std::nullopt;
}

ExitStatus verify(const VerifyFlags& flags, Context& context) {
  face::people::Gallery gallery = face::open_gallery(flags.people.gallery);
  if (!gallery.find(flags.name)) {
    throw InputError(flags.people.gallery,
                     fmt::format("nobody is enrolled as '{}'", printable(flags.name)));
  }
  const auto model = model_of_gallery(gallery, flags.people, context);
  if (!model ||
      std::find(model->labels.begin(), model->labels.end(), flags.name) == model->labels.end()) {
    throw InputError(flags.people.gallery,
                     fmt::format("'{}' has no faces yet", printable(flags.name)));
  }
  face::people::FaceReader reader = make_face_reader(flags.people, UncertainFaces::kInclude);
  bool all = true;
  bool any = false;
  std::unique_ptr<Batch> batch;
  if (flags.batch.is_requested()) {
    batch =
        std::make_unique<Batch>(flags.batch, BatchTable(), flags.inputs, input_schemes(), context);
    context.is_batch = true;
  }
  const auto source = batch ? batch->open() : open_sources(flags.inputs);
  while (!source->ended()) {
    throw_if_stopped(context.stop);
    const auto frame = source->next(std::chrono::milliseconds(200), context.stop);
    if (!frame) continue;
    cv::Mat gray;
    cv::cvtColor(frame->image, gray, cv::COLOR_BGR2GRAY);
    const auto faces = reader.read(gray);
    std::optional<VerificationResult> result;
    // Of several faces, the one most similar to the person counts.
    for (const face::people::Face& face : faces) {
      const auto one = verify_face(*model, face, flags.name, flags.rate);
      if (one && (!result || one->identity.score > result->identity.score)) result = one;
    }
    const bool same = result && result->identity.known;
    any = any || !faces.empty();
    all = all && same;
    nlohmann::ordered_json line = {{"image", frame->name}, {"name", flags.name}};
    line["same"] = same;
    line["faces"] = faces.size();
    if (result) {
      line["confidence"] = rounded(result->identity.confidence, 4);
      line["score"] = result->identity.score;
      line["threshold"] = result->identity.threshold;
      line["trusted"] = result->trusted;
    }
    if (batch) batch->record(frame->index, line, {});
    if (context.json) {
      print_json(line);
    } else if (!result) {
      print_text(fmt::format("{}: {}\n", printable(frame->name),
                             faces.empty() ? std::string("no face")
                                           : fmt::format("is not {} (a correction excludes it)",
                                                         printable(flags.name))));
    } else {
      print_text(fmt::format(
          "{}: {} {} ({}{:.0f} %; score {:.3f}, threshold {:.3f})\n", printable(frame->name),
          same ? "is" : "is not", printable(flags.name), result->trusted ? "" : "uncertain face; ",
          100 * result->identity.confidence, result->identity.score, result->identity.threshold));
    }
  }
  if (batch) batch->finish();
  return any && all ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_flags(Command& verb, VerifyFlags& flags) {
  verb.add_option("NAME", flags.name, "name as `people list` shows it").required();
  verb.add_option("INPUT", flags.inputs, "images of the person").required();
  add_gallery_flag(verb, flags.people);
  verb.add_option("--far", flags.rate, "false accept rate that sets the threshold")
      .check(range(1e-9, 0.999))
      .show_default();
  add_batch_flags(verb, flags.batch);
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_verify(Command& area, Context& context) {
  add_verb<VerifyFlags>(area, "verify", "verify a person's identity; exit status 0: yes, 1: no",
                        context, add_flags, verify);
}

}  // namespace tarsier::cli
