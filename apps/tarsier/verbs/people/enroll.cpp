// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/people/collector.h"
#include "tarsier/face/people/name.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/input_schemes.h"
#include "framework/security_flags.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct EnrollFlags {
  PeopleFlags people;
  std::string name;
  std::string note;
  std::vector<std::string> inputs;
  SourceOptions source;
  std::int64_t max_faces = 20;
  bool largest = false;
  bool any_quality = false;
  face::people::CollectOptions collect;
};

// Reads faces from the inputs and enrols each good face as soon as it is found.
class Enrolment {
 public:
  Enrolment(const EnrollFlags& flags, Context& context)
      : flags_(flags),
        context_(context),
        faces_(make_face_reader(flags.people, UncertainFaces::kInclude), nullptr),
        collector_(flags.collect),
        gallery_(flags.people.gallery, DatabaseAccess::kCreate),
        background_(background_to_enroll(gallery_, flags.people)),
        enroller_(gallery_, background()) {}

  ExitStatus operator()() {
    const auto source = open_sources(flags_.inputs, flags_.source, input_schemes());
    // Whom the gallery would identify these faces as, before this person is in it. Pending learning
    // is done, so that new faces get their templates at once.
    if (auto known = model(face::people::SearchMode::kIndexed)) {
      coordinates_ = known->space < 0;
      before_.emplace(gallery_, background(), std::move(known), face::people::SearchMode::kIndexed);
    }
    while (!source->ended() && taken() < flags_.max_faces && !context_.stop.stop_requested()) {
      const auto frame = source->next(std::chrono::milliseconds(200), context_.stop);
      if (frame) process(*frame);
    }
    const std::vector<std::string> others =
        before_ && !crops_.empty() ? face::people::duplicate_names(*before_, crops_, flags_.name)
                                   : std::vector<std::string>();
    for (const std::string& other : others)
      log_warning("these faces look like '{}', who is enrolled already: one person, two names?",
                  other);
    report(others);
    if (context_.stop.stop_requested()) return ExitStatus::kInterrupted;
    // Prepares the model for the next verb. A large gallery has its templates already.
    const bool fixed = coordinates_ && !face::has_deep_templates(gallery_);
    if (taken() > 0 && !fixed) (void)model(face::people::SearchMode::kNone);
    return taken() > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
  }

 private:
  [[nodiscard]] std::int64_t taken() const { return collector_.accepted(); }

  [[nodiscard]] const face::recognition::Background* background() const {
    return background_ ? &*background_ : nullptr;
  }

  std::optional<face::people::GalleryModel> model(face::people::SearchMode search_mode) {
    try {
      return load_model(gallery_, background(), context_, face::people::TrainingPolicy::kIfNeeded,
                        search_mode);
    } catch (const InputError& error) {
      log_warning("{}", error.what());  // e.g. Fisherfaces with one person
      return std::nullopt;
    }
  }

  void process(const Frame& frame) {
    if (frame.name != source_name_) {
      source_name_ = frame.name;
      if (!frame.still) collector_.reset();
    }
    const std::vector<face::IdentifiedFace> faces = identifier_.find(frame, faces_);
    std::string reason;
    if (faces.empty()) {
      reason = faces_.reader().without_eyes() > 0 ? "eyes not found" : "no face";
    } else if (faces.size() > 1 && !flags_.largest) {
      reason = "several faces";
    }
    if (!reason.empty()) {
      collector_.reject(reason);
    } else {
      const face::people::Face& face =
          std::max_element(faces.begin(), faces.end(), [](const auto& a, const auto& b) {
            return a.face.box.area() < b.face.box.area();
          })->face;
      reason = collector_.offer(face, frame.time, !frame.still);
      if (reason.empty()) {
        enroller_.enroll(flags_.name, flags_.note, face, frame.name, now_ms());
        crops_.push_back(face.crop);
      }
    }
    if (!reason.empty() && frame.still) {
      log_warning("{}: {}{}", frame.name, reason,
                  reason == "several faces" ? " (--largest takes the largest)" : "");
    }
  }

  void report(const std::vector<std::string>& others) {
    const auto person = gallery_.find(flags_.name);
    const std::int64_t faces = person ? person->faces : 0;
    if (context_.json) {
      nlohmann::ordered_json refused = nlohmann::ordered_json::object();
      for (const auto& [reason, count] : collector_.rejected()) refused[reason] = count;
      print_json({{"name", flags_.name},
                  {"added", taken()},
                  {"faces", faces},
                  {"refused", std::move(refused)},
                  {"same_as", others}});
      return;
    }
    std::string text = fmt::format("{}: {} {} added, {} in all\n", printable(flags_.name), taken(),
                                   taken() == 1 ? "face" : "faces", faces);
    for (const auto& [reason, count] : collector_.rejected())
      text += fmt::format("  {:>5} refused: {}\n", count, reason);
    print_text(text);
  }

  const EnrollFlags& flags_;
  Context& context_;
  const face::Identifier identifier_{face::IdentificationOptions()};  // only finds faces
  face::IdentifierState faces_;
  face::people::Collector collector_;
  face::people::Gallery gallery_;
  std::optional<face::recognition::Background> background_;
  face::Enroller enroller_;
  std::optional<face::people::GalleryFollower> before_;
  bool coordinates_ = false;  // the gallery keeps faces as coordinates
  std::vector<cv::Mat> crops_;
  std::string source_name_;
};

ExitStatus enroll(EnrollFlags& flags, Context& context) {
  std::error_code ignored;
  if (std::filesystem::is_regular_file(flags.name, ignored)) {
    throw UsageError(flags.name + ": is a file; the name comes first: people enroll NAME INPUT..");
  }
  face::people::check_name(flags.name);
  face::people::check_note(flags.note);
  // Nothing is written if a requested model is missing.
  if (template_kind(flags.people) == face::TemplateKind::kDeep)
    static_cast<void>(face::load_deep_network(ModelStore::find(), own_network(flags.people)));
  if (!flags.people.embedding.empty()) static_cast<void>(find_deep_background(flags.people));
  flags.collect.check_quality = !flags.any_quality;
  return Enrolment(flags, context)();
}

void add_flags(Command& verb, EnrollFlags& flags) {
  verb.add_option("NAME", flags.name, "name of the person, UTF-8, at most 200 bytes").required();
  verb.add_option("INPUT", flags.inputs, "image, folder, glob, @list.txt, video, camera number")
      .required();
  add_gallery_flag(verb, flags.people);
  verb.add_option("--note", flags.note, "note on the consent: who agreed to what, and when");
  verb.add_option("--faces", flags.max_faces, "stop after this many faces")
      .check(range(1, 100000))
      .show_default();
  verb.add_flag("--largest", flags.largest, "use only the largest face of an image");
  verb.add_flag("--any-quality", flags.any_quality,
                "also enrol small, blurred, turned, dark or uncertain faces");
  verb.add_flag("--sequence", flags.source.sequence, "treat still images as the frames of a video");
  (void)add_security_flags(verb, flags.source.security);
  bind_all(verb, flags.collect);
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_enroll(Command& area, Context& context) {
  add_verb<EnrollFlags>(area, "enroll", "enrol faces of a person from images, videos or a camera",
                        context, add_flags, enroll);
}

}  // namespace tarsier::cli
