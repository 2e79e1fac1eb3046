// SPDX-License-Identifier: MIT
#include "verbs/people/engine.h"

#include "tarsier/core/stop.h"
#include "tarsier/face/onnx/own_networks.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "verbs/landmarks/engine.h"
#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <map>
#include <pwd.h>
#include <string_view>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace tarsier::cli {
namespace {

constexpr std::string_view kNoBackground = "none";

}  // namespace

void add_gallery_flag(Command& verb, PeopleFlags& flags) {
  verb.add_option("--gallery", flags.gallery, "gallery file: the enrolled people").show_default();
}

void add_face_flags(Command& verb, PeopleFlags& flags) {
  const auto group = [](Flag& flag) { flag.group("Faces"); };
  group(verb.add_option("--eyes", flags.eyes, "eye finder: landmarks, cascades, 2splits")
            .show_default());
  group(add_min_face_flag(verb, flags.min_face));
  group(verb.add_flag("!--strict", flags.thorough,
                      "accept only confident detections of the frontal detector; faster"));
  group(add_rolled_flag(verb, flags.rolled));
  group(verb.add_option("--detector-model", flags.detector_model,
                        "ONNX face detector (YuNet family) to use instead of the shipped one"));
  add_template_flags(verb, flags);
}

void add_template_flags(Command& verb, PeopleFlags& flags) {
  const auto group = [](Flag& flag) { flag.group("Faces"); };
  group(verb.add_option("--template", flags.templates,
                        "face template: classic, deep, or auto: the gallery's; for a new one deep "
                        "if installed")
            .show_default());
  group(verb.add_option("--embedding", flags.embedding,
                        "ONNX file of your own network for deep templates (package tarsier-onnx)"));
  group(verb.add_option("--background", flags.background,
                        "background model or none [people-background.json; with --embedding "
                        "NAME.onnx: NAME.people.json]"));
}

std::string background_of(const PeopleFlags& flags) {
  if (!flags.background.empty() || flags.embedding.empty()) return flags.background;
  std::filesystem::path candidate = flags.embedding;
  candidate.replace_extension(".people.json");
  std::error_code error;
  return std::filesystem::is_regular_file(candidate, error) ? candidate.string() : std::string();
}

face::SharedNetwork own_network(const PeopleFlags& flags) {
  if (flags.embedding.empty()) return nullptr;
  // A verb may call this several times.
  static std::map<std::string, face::SharedNetwork> read;
  face::SharedNetwork& network = read[flags.embedding];
  if (!network) network = face::onnx::load_embedding(flags.embedding);
  return network;
}

face::TemplateKind template_kind(const PeopleFlags& flags) {
  const face::TemplateKind kind = face::parse_template_kind(flags.templates);
  if (flags.embedding.empty()) return kind;
  if (kind == face::TemplateKind::kClassic)
    throw UsageError("--embedding or --template classic, not both");
  return face::TemplateKind::kDeep;
}

face::people::FaceReaderOptions reading_options(const PeopleFlags& flags,
                                                UncertainFaces uncertain) {
  face::people::FaceReaderOptions options;
  options.eyes = face::people::parse_eye_method(flags.eyes);
  options.finder.detector.min_face = flags.min_face;
  options.finder.thorough = flags.thorough;
  options.finder.rolled = face::landmarks::parse_rolled_search(flags.rolled);
  if (uncertain == UncertainFaces::kInclude) options.min_uncertain = face::people::kMinUncertain;
  if (!flags.detector_model.empty())
    options.finder.external_detector = face::onnx::load_box_detector(flags.detector_model);
  return options;
}

face::IdentifierOptions identifier_options(const PeopleFlags& flags) {
  face::IdentifierOptions options;
  options.gallery = flags.gallery;
  options.background = background_of(flags);
  options.templates = template_kind(flags);
  options.network = own_network(flags);
  options.reading = reading_options(flags, UncertainFaces::kInclude);
  return options;
}

face::Identifier load_identifier(const face::IdentifierOptions& options) {
  const EndOnSignals at_once;  // loading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  return face::Identifier::load(ModelStore::find(), options);
}

face::people::FaceReader make_face_reader(const PeopleFlags& flags, UncertainFaces uncertain) {
  const face::people::FaceReaderOptions options = reading_options(flags, uncertain);
  // A wrong path is reported before anything is written, even if the file is needed only later.
  if (!flags.background.empty()) static_cast<void>(find_background(flags));
  const EndOnSignals at_once;  // loading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  return face::FaceReaderModel::load(ModelStore::find(), options).make_reader();
}

std::string background_path(const PeopleFlags& flags) {
  if (flags.background == kNoBackground) return {};
  return flags.background.empty() ? ModelStore::find().expected_path("people-background.json")
                                  : flags.background;
}

std::optional<face::recognition::Background> find_background(const PeopleFlags& flags) {
  return face::load_background(ModelStore::find(), flags.background);
}

face::recognition::Background find_deep_background(const PeopleFlags& flags) {
  if (flags.background == kNoBackground)
    throw UsageError("--background none: deep templates need their background");
  return face::load_deep_background(ModelStore::find(), background_of(flags), own_network(flags));
}

std::optional<face::recognition::Background> background_to_enroll(face::people::Gallery& gallery,
                                                                  const PeopleFlags& flags) {
  face::resolve_template_kind(gallery, template_kind(flags), ModelStore::find(), true,
                              own_network(flags));
  if (face::has_deep_templates(gallery)) return find_deep_background(flags);
  return find_background(flags);
}

std::optional<face::people::GalleryModel> load_model(
    face::people::Gallery& gallery, const face::recognition::Background* background,
    Context& context, face::people::TrainingPolicy policy, face::people::SearchMode search_mode) {
  return face::train_gallery(gallery, background, policy, *context.progress, context.stop,
                             search_mode);
}

std::optional<face::recognition::Recognizer> model_of_gallery(face::people::Gallery& gallery,
                                                              const PeopleFlags& flags,
                                                              Context& context,
                                                              face::people::TrainingPolicy policy) {
  face::resolve_template_kind(gallery, template_kind(flags), ModelStore::find(), false,
                              own_network(flags));
  const auto background =
      policy == face::people::TrainingPolicy::kAlways && !face::has_deep_templates(gallery)
          ? find_background(flags)
          : face::background_for(gallery, ModelStore::find(), background_of(flags),
                                 own_network(flags));
  auto model = load_model(gallery, background ? &*background : nullptr, context, policy);
  if (!model) return std::nullopt;
  return std::move(model->recognizer);
}

ListedFaces read_listed_faces(const std::string& list, bool raw, cv::Size size, bool classical,
                              face::people::FaceReader* reader, Context& context,
                              UncertainFaces uncertain) {
  ListedFaces out;
  const auto faces = face::recognition::read_face_list(list);
  context.progress->begin("faces", static_cast<std::int64_t>(faces.size()), "images");
  for (const face::recognition::LabelledFace& entry : faces) {
    throw_if_stopped(context.stop);
    context.progress->advance();
    cv::Mat gray = read_gray_image(entry.path);
    bool trusted = true;
    if (!raw) {
      std::optional<face::people::Face> face;
      if (entry.left_eye && entry.right_eye) {
        face = reader->face_from_eyes(gray, {*entry.left_eye, *entry.right_eye});
      } else {
        std::vector<face::people::Face> found = reader->read(gray);
        if (!found.empty() && (found.front().trusted || uncertain == UncertainFaces::kInclude))
          face = std::move(found.front());
      }
      if (!face) {
        out.missed.push_back(entry.path);
        out.missed_labels.push_back(entry.label);
        continue;
      }
      trusted = face->trusted;
      gray = face::people::recognizer_input(
          classical ? face::recognition::Algorithm::kEigen : face::recognition::Algorithm::kDefault,
          face->crop);
    }
    if (size.area() > 0) cv::resize(gray, gray, size, 0, 0, cv::INTER_LINEAR);
    out.faces.push_back(gray);
    out.labels.push_back(entry.label);
    out.trusted.push_back(trusted);
  }
  context.progress->end();
  if (out.faces.empty()) throw InputError(list, "no face was found in any of its images");
  return out;
}

std::string time_text(std::int64_t ms) {
  constexpr std::int64_t kEnd = 253'402'300'799'999;  // end of the year 9999
  return plate::moment_text(
      plate::Moment(std::chrono::milliseconds(std::clamp<std::int64_t>(ms, 0, kEnd))));
}

face::people::CorrectionStamp correction_stamp() {
  const uid_t user = ::getuid();
  std::array<char, 4096> buffer{};
  passwd entry{};
  passwd* found = nullptr;
  if (::getpwuid_r(user, &entry, buffer.data(), buffer.size(), &found) == 0 && found != nullptr)
    return {now_ms(), found->pw_name};
  return {now_ms(), fmt::format("user {}", user)};
}

std::int64_t now_ms() { return plate::moment_now().time_since_epoch().count(); }

}  // namespace tarsier::cli
