// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/show.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/face/shape/landmark_set.h"
#include "tarsier/face/shape/shape_model.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/view/animation.h"

#include <fmt/format.h>

#include "framework/browse_session.h"
#include "ui/face/landmark_show_session.h"
#include "ui/face/patch_session.h"
#include "verbs/landmarks/engine.h"
#include "verbs/landmarks/landmarks.h"
#include "window.h"
#include <algorithm>
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct LandmarkShowFlags {
  std::string file;
  std::string output;
  bool window = false;
  bool fullscreen = false;
  bool numbers = false;
  bool mirrored = false;
  bool plain = false;  // without symmetry colours
  int cell = 160;
  int columns = 0;
  int max_images = 100;
  int modes = 4;
  std::string on;   // an image on which patches are tested
  int search = 21;  // px
};

constexpr ArchiveLimits kLimits{512'000'000, 64, 50'000'000};
constexpr double kGifRate = 20;
constexpr int kGifFramesPerMode = 32;

bool ends_with(const std::string& path, const char* ending) {
  return std::filesystem::path(path).extension() == ending;
}

void print_result(const nlohmann::ordered_json& line, const std::string& text,
                  const Context& context) {
  if (context.json) {
    print_json(line);
  } else {
    print_text(text);
  }
}

ExitStatus show_set(const LandmarkShowFlags& flags, Context& context) {
  face::shape::LandmarkSet set = face::shape::read_landmark_set(flags.file);
  if (set.samples.empty()) throw InputError(flags.file, "holds no samples");
  face::shape::LandmarkStyle style;
  style.numbers = flags.numbers;
  style.symmetry = !flags.plain && !set.mirror.empty();
  if (flags.output.empty()) {
    window::prepare();
    LandmarkSetSession session(set, flags.file, style, flags.mirrored);
    return browse_session(session, "Tarsier landmarks", flags.fullscreen, context, {});
  }
  write_image(flags.output, face::shape::contact_sheet(set, flags.file, flags.cell, flags.columns,
                                                       flags.max_images, style));
  print_result(
      {{"output", flags.output}, {"samples", set.samples.size()}, {"points", set.points()}},
      fmt::format(
          "{}: {} of {} samples\n", flags.output,
          std::min<std::size_t>(set.samples.size(), static_cast<std::size_t>(flags.max_images)),
          set.samples.size()),
      context);
  return ExitStatus::kDone;
}

ExitStatus show_shape_model(const LandmarkShowFlags& flags, Context& context) {
  const face::shape::ShapeModel model = face::shape::read_shape_model(flags.file);
  if (flags.output.empty()) {
    window::prepare();
    ShapeModelSession session(model);
    const auto between = [&](std::chrono::milliseconds& wait) -> std::optional<View> {
      wait = std::chrono::milliseconds(40);
      return session.on_idle({});
    };
    return browse_session(session, "Tarsier shape model", flags.fullscreen, context, between);
  }
  const int modes = std::min(flags.modes, model.mode_count());
  if (ends_with(flags.output, ".gif")) {
    sfm::write_gif(flags.output,
                   face::shape::animate_modes(model, modes, {flags.cell * 2, flags.cell * 2},
                                              kGifFramesPerMode),
                   kGifRate);
  } else {
    write_image(flags.output, face::shape::draw_modes(model, modes, flags.cell));
  }
  print_result({{"output", flags.output},
                {"points", model.points()},
                {"modes", model.mode_count()},
                {"variance", model.variance_kept},
                {"trained_on", model.trained_on}},
               fmt::format("{}: {} of {} modes, {} points, {:.1f} % of the variance of {} shapes\n",
                           flags.output, modes, model.mode_count(), model.points(),
                           100 * model.variance_kept, model.trained_on),
               context);
  return ExitStatus::kDone;
}

// Fits the landmarks of the largest face in an image; nullopt if there is no face.
std::optional<PatchImage> image_with_points(const LandmarkShowFlags& flags) {
  LandmarkFlags landmark_flags;
  landmark_flags.model = flags.file;
  const face::LandmarkTracker tracker = load_landmark_tracker(landmark_flags);
  PatchImage image{
      std::filesystem::path(flags.on).filename().string(), read_gray_image(flags.on), {}};
  Frame frame;
  frame.image = image.gray;
  frame.still = true;
  face::LandmarkState state;
  const face::LandmarkResult result = tracker.process(frame, state);
  if (result.faces.empty()) return std::nullopt;
  image.points = result.faces.front().points;
  return image;
}

ExitStatus show_in_window(const LandmarkShowFlags& flags,
                          const face::landmarks::LandmarkModel& model,
                          std::optional<PatchImage> image, Context& context) {
  window::prepare();
  if (model.patches) {
    PatchSession session(*model.patches, model.shape, std::move(image));
    return browse_session(session, "Tarsier patches", flags.fullscreen, context, {});
  }
  ShapeModelSession session(model.shape);
  const auto between = [&](std::chrono::milliseconds& wait) -> std::optional<View> {
    wait = std::chrono::milliseconds(40);
    return session.on_idle({});
  };
  return browse_session(session, "Tarsier shape model", flags.fullscreen, context, between);
}

ExitStatus show_responses(const LandmarkShowFlags& flags,
                          const face::landmarks::LandmarkModel& model, const PatchImage& image,
                          Context& context) {
  write_image(flags.output, face::regression::draw_responses(*model.patches, image.gray,
                                                             image.points, flags.search));
  double best = 0;
  for (const face::regression::PointResponse& response :
       face::regression::point_responses(*model.patches, image.gray, image.points, flags.search)) {
    best += response.best / model.points();
  }
  print_result({{"output", flags.output}, {"points", model.points()}, {"response", best}},
               fmt::format("{}: {} responses, at best {:.2f} on average\n", flags.output,
                           model.points(), best),
               context);
  return ExitStatus::kDone;
}

// Shows the parts of a tracker: the shape's modes, and the patches on the mean face; in a window
// patch by patch.
ExitStatus show_tracker(const LandmarkShowFlags& flags, Context& context) {
  const face::landmarks::LandmarkModel model = face::landmarks::read_landmark_model(flags.file);
  if (!flags.on.empty()) {
    if (!model.patches) throw ModelError(flags.file, "has no patches that --on could show");
    std::optional<PatchImage> image = image_with_points(flags);
    if (!image) {
      log_warning("{}: no face found", flags.on);
      return ExitStatus::kNothingFound;
    }
    if (!flags.output.empty()) return show_responses(flags, model, *image, context);
    return show_in_window(flags, model, std::move(image), context);
  }
  if (flags.output.empty()) return show_in_window(flags, model, std::nullopt, context);
  const int modes = std::min(flags.modes, model.shape.mode_count());
  if (ends_with(flags.output, ".gif")) {
    sfm::write_gif(flags.output,
                   face::shape::animate_modes(model.shape, modes, {flags.cell * 2, flags.cell * 2},
                                              kGifFramesPerMode),
                   kGifRate);
  } else {
    std::vector<cv::Mat> parts{face::shape::draw_modes(model.shape, modes, flags.cell)};
    std::vector<std::string> names{"shape modes"};
    if (model.patches) {
      parts.push_back(face::regression::draw_patches(*model.patches, model.shape, -1, 4));
      names.emplace_back("patches");
    }
    write_image(flags.output, image::draw::tile(parts, names, {1400, 700}));
  }
  nlohmann::ordered_json about = {{"output", flags.output}, {"points", model.points()}};
  std::string has;
  for (const face::landmarks::FitMethod method :
       {face::landmarks::FitMethod::kTrees, face::landmarks::FitMethod::kDescent,
        face::landmarks::FitMethod::kPatches}) {
    if (model.has(method)) has += fmt::format("{}{}", has.empty() ? "" : ", ", name_of(method));
  }
  about["methods"] = has;
  print_result(about,
               fmt::format("{}: {} points; methods: {}\n", flags.output, model.points(), has),
               context);
  return ExitStatus::kDone;
}

// Shows the filter of a face detector.
ExitStatus show_detector(const LandmarkShowFlags& flags, Context& context) {
  const face::landmarks::HogDetector model = face::landmarks::read_hog_detector(flags.file);
  if (flags.output.empty()) throw UsageError("-o: a face detector is shown as an image (.png ..)");
  const cv::Mat filter =
      face::landmarks::draw_hog_detector(model, std::clamp(flags.cell / 5, 8, 100));
  write_image(flags.output, filter);
  print_result({{"output", flags.output},
                {"window", {model.width, model.height}},
                {"threshold", model.threshold},
                {"knows_shapes", model.box.has_value()}},
               fmt::format("{}: window of {}x{} px, {} weights\n", flags.output, model.width,
                           model.height, model.weights.size()),
               context);
  return ExitStatus::kDone;
}

// The show function for each type of file. Other models add a line.
using Show = ExitStatus (*)(const LandmarkShowFlags&, Context&);
const std::map<std::string, Show>& shows() {
  static const std::map<std::string, Show> table{
      {"face-detector", show_detector},
      {"landmark-set", show_set},
      {"landmark-tracker", show_tracker},
      {"shape-model", show_shape_model},
  };
  return table;
}

ExitStatus show_landmarks(const LandmarkShowFlags& flags, Context& context) {
  if (flags.search % 2 == 0) {
    throw UsageError(
        fmt::format("--search {}: expected an odd number, so that the region has a middle pixel",
                    flags.search));
  }
  std::string type;
  try {
    type = read_any_archive(flags.file, kLimits).type;
  } catch (const ModelError& error) {  // usually a landmark set; the error texts are the same
    const std::string prefix = flags.file + ": ";
    std::string reason = error.what();
    if (reason.starts_with(prefix)) reason.erase(0, prefix.size());
    throw InputError(flags.file, reason);
  }
  const auto found = shows().find(type);
  if (found == shows().end()) {
    std::string known;
    for (const auto& [name, unused] : shows()) known += (known.empty() ? "" : ", ") + name;
    throw InputError(flags.file,
                     fmt::format("is a '{}', which cannot be shown; known: {}", type, known));
  }
  if (!flags.on.empty() && type != "landmark-tracker") {
    throw UsageError(
        fmt::format("--on needs a model with patches; {} is a '{}'", flags.file, type));
  }
  return found->second(flags, context);
}

void add_flags(Command& verb, LandmarkShowFlags& flags) {
  verb.add_option("FILE", flags.file, "annotated set, shape model, tracker or face detector")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output,
                  "output: contact sheet (.png ..) of a set; parts (.png ..) or animated modes "
                  "(.gif) of a model [window]");
  verb.add_flag("--window", flags.window, "show in a window (default without -o)");
  verb.add_flag("--fullscreen", flags.fullscreen, "show the window in full screen");
  const auto of_set = [](Flag& flag) { flag.group("Sets"); };
  of_set(verb.add_flag("--numbers", flags.numbers, "draw the landmark numbers"));
  of_set(verb.add_flag("--mirrored", flags.mirrored, "window: start with the mirrored view"));
  of_set(verb.add_flag("--plain", flags.plain, "draw left and right landmarks in one colour"));
  of_set(verb.add_option("--columns", flags.columns, "number of columns of the sheet; 0: automatic")
             .check(range(0, 100))
             .show_default());
  of_set(
      verb.add_option("--max-samples", flags.max_images, "maximum number of samples on the sheet")
          .check(range(1, 10000))
          .show_default());
  verb.add_option("--cell", flags.cell, "px, side of a cell of the sheet or strip")
      .check(range(40, 1000))
      .show_default();
  verb.add_option("--modes", flags.modes, "shape model: number of modes to show")
      .check(range(1, 1000))
      .show_default();
  const auto of_tracker = [](Flag& flag) { flag.group("Trackers"); };
  of_tracker(verb.add_option("--on", flags.on,
                             "face image: show the response of each patch around its landmark"));
  of_tracker(verb.add_option("--search", flags.search,
                             "px, side of the search region in the response sheet, odd")
                 .check(range(3, 101))
                 .show_default());
}

}  // namespace

void add_landmarks_show(Command& area, Context& context) {
  add_verb<LandmarkShowFlags>(area, "show", "show an annotated set or a model", context, add_flags,
                              show_landmarks);
}

}  // namespace tarsier::cli
