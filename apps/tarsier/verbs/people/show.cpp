// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/size_flag.h"
#include "verbs/people/engine.h"
#include "verbs/people/images.h"
#include "verbs/people/people.h"
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using face::recognition::Algorithm;
using face::recognition::Recognizer;

struct PeopleShowFlags {
  PeopleFlags people;
  std::string model;
  std::string face;
  std::string stages;
  std::string output;
  std::string size = "1200x900";
  bool raw = false;
  int components = 15;
};

bool has_images(const Recognizer& model) {
  return model.options.algorithm == Algorithm::kEigen ||
         model.options.algorithm == Algorithm::kFisher;
}

void describe(const Recognizer& model, const Context& context) {
  const int shown = static_cast<int>(std::min<Eigen::Index>(model.eigenvalues.size(), 20));
  const double total = model.eigenvalues.size() > 0 ? model.eigenvalues.sum() : 0;
  if (context.json) {
    std::vector<double> values(model.eigenvalues.data(), model.eigenvalues.data() + shown);
    print_json({{"algorithm", face::recognition::name_of(model.options.algorithm)},
                {"people", model.labels.size()},
                {"templates", model.templates.rows()},
                {"template_length", model.template_length()},
                {"width", model.options.size.width},
                {"height", model.options.size.height},
                {"values", values},
                {"calibrated", model.calibration.has_value()}});
    return;
  }
  std::string text =
      fmt::format("{}: {} people, {} templates of {} numbers, faces of {}x{}\n",
                  face::recognition::name_of(model.options.algorithm), model.labels.size(),
                  model.templates.rows(), model.template_length(), model.options.size.width,
                  model.options.size.height);
  const char* what = model.options.algorithm == Algorithm::kEigen ? "eigenvalues (share of all)"
                     : model.options.algorithm == Algorithm::kFisher
                         ? "scatter between / within people"
                         : "scatter within people";
  if (shown > 0) text += fmt::format("{}:", what);
  for (int i = 0; i < shown; ++i) {
    text += model.options.algorithm == Algorithm::kEigen
                ? fmt::format(" {:.4g} ({:.1f} %)", model.eigenvalues[i],
                              100 * model.eigenvalues[i] / total)
                : fmt::format(" {:.4g}", model.eigenvalues[i]);
  }
  if (shown > 0) text += "\n";
  if (model.calibration) {
    const auto& c = *model.calibration;
    const int people = std::max(1, static_cast<int>(model.labels.size()));
    text += fmt::format(
        "impostor scores against one person: {:.3f} +- {:.3f}; genuine scores: {:.3f}; threshold "
        "for 1 false accept in 10, 100, 1000: {:.3f}, {:.3f}, {:.3f}\n",
        c.location, c.scale, c.genuine_mean, c.threshold(0.1, people), c.threshold(0.01, people),
        c.threshold(0.001, people));
  }
  print_text(text);
}

// Adds the face, its reconstruction, the most similar people and the evidence for them.
void add_face(NamedImages& images, const Recognizer& model, const cv::Mat& input,
              face::people::Gallery* gallery, const Context& context) {
  images.add("face", input);
  if (has_images(model)) {
    const double error = face::recognition::reconstruction_error(model, input);
    images.add(fmt::format("reconstructed, error {:.2f}", error),
               face::recognition::reconstruction(model, input));
  }
  const auto scores = face::recognition::identify(model, input);
  std::vector<face::people::FaceRef> stored;  // in the order of the templates
  if (gallery != nullptr) stored = gallery->face_refs();
  int listed = 0;
  for (const auto& one : scores) {
    if (listed++ == 3) break;
    const std::string name = printable(model.labels[static_cast<std::size_t>(one.person)]);
    if (!context.json) {
      print_text(fmt::format(
          "  {:<24} score {:.4f}{}\n", name, one.score,
          model.calibration
              ? fmt::format(", {:.0f} %", 100 * model.calibration->probability(one.score))
              : ""));
    }
    if (static_cast<std::size_t>(one.nearest) >= stored.size()) continue;
    if (const auto face = gallery->face(stored[static_cast<std::size_t>(one.nearest)].id))
      images.add(fmt::format("nearest: {}", name),
                 face::people::recognizer_input(model.options.algorithm, face->crop));
  }
  if (!scores.empty()) {
    images.add(
        fmt::format("speaks for {}",
                    printable(model.labels[static_cast<std::size_t>(scores.front().person)])),
        evidence_image(model, input, scores.front().person));
  }
}

ExitStatus show_people(const PeopleShowFlags& flags, Context& context) {
  const cv::Size size = parse_size(flags.size, 100, 4000);
  NamedImages images;
  if (!flags.stages.empty()) {
    face::people::FaceReader reader = make_face_reader(flags.people);
    images = face_stages(reader, read_gray_image(flags.stages));
    if (images.images.empty()) {
      log_warning("{}: no face", flags.stages);
      return ExitStatus::kNothingFound;
    }
  } else {
    std::optional<Recognizer> model;
    std::unique_ptr<face::people::Gallery> gallery;
    if (!flags.model.empty()) {
      model = face::recognition::read_recognizer(flags.model);
      if (model->options.algorithm == Algorithm::kDeep)
        face::attach_network(*model,
                             face::load_deep_network(ModelStore::find(), own_network(flags.people)),
                             flags.model);
    } else {
      gallery = std::make_unique<face::people::Gallery>(face::open_gallery(flags.people.gallery));
      model = model_of_gallery(*gallery, flags.people, context);
      if (!model) {
        log_warning("{}: nobody is enrolled", flags.people.gallery);
        return ExitStatus::kNothingFound;
      }
    }
    describe(*model, context);
    if (has_images(*model)) {
      images.add("mean face", face::recognition::mean_face(*model));
      const int count = std::min(flags.components, static_cast<int>(model->components.rows()));
      for (int i = 0; i < count; ++i)
        images.add(
            fmt::format("{} {}", i + 1,
                        model->options.algorithm == Algorithm::kEigen ? "eigenface" : "fisherface"),
            face::recognition::component_image(*model, i));
    }
    if (!flags.face.empty()) {
      cv::Mat input = read_gray_image(flags.face);
      if (!flags.raw) {
        face::people::FaceReader reader = make_face_reader(flags.people);
        const auto faces = reader.read(input);
        if (faces.empty()) {
          log_warning("{}: no face", flags.face);
          return ExitStatus::kNothingFound;
        }
        input = face::people::recognizer_input(model->options.algorithm, faces.front().crop);
      }
      add_face(images, *model, input, gallery.get(), context);
    }
    if (images.images.empty() && gallery != nullptr)
      for (const face::people::Person& person : gallery->people())
        if (const auto face = gallery->latest_face(person.id))
          images.add(printable(person.name), face->crop);
  }
  if (flags.output.empty()) {
    if (!flags.stages.empty()) throw UsageError("-o: name the image to write");
    return ExitStatus::kDone;
  }
  if (images.images.empty()) {
    log_warning("this model has no images of its own; --face IMAGE shows what it sees");
    return ExitStatus::kNothingFound;
  }
  write_image(flags.output, image::draw::tile(images.images, images.names, size));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, PeopleShowFlags& flags) {
  verb.add_option("MODEL", flags.model, "model file [the gallery's model]");
  add_gallery_flag(verb, flags.people);
  verb.add_option("--face", flags.face, "image of a face to reconstruct and identify by the model");
  verb.add_flag("--raw", flags.raw, "the image of --face is a face crop already");
  verb.add_option("--stages", flags.stages, "image of a face: show the stages of its preparation");
  verb.add_option("--components", flags.components, "number of eigenfaces or fisherfaces to show")
      .check(range(0, 500))
      .show_default();
  verb.add_option("-o,--output", flags.output, "output image");
  verb.add_option("--size", flags.size, "size of the output image").show_default();
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_show(Command& area, Context& context) {
  add_verb<PeopleShowFlags>(
      area, "show",
      "show a model: mean face, eigenfaces, reconstruction, nearest faces, evidence, stages",
      context, add_flags, show_people);
}

}  // namespace tarsier::cli
