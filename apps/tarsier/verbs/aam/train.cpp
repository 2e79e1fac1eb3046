// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/appearance/study.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/shape/text_files.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/bind.h"
#include "framework/stopwatch.h"
#include "verbs/aam/aam.h"
#include "verbs/landmarks/engine.h"
#include "verbs/landmarks/landmarks.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace tarsier::cli {
namespace {

using face::appearance::AppearanceModel;
using face::appearance::TrainingImage;

struct AamTrainFlags : TrainingFlags {
  std::string channels = "oriented";
  std::string mesh;
  bool no_detector = false;
  face::appearance::AppearanceOptions options{.frame_width = 64};  // 64 px suffice for features
};

// The box of the face to which the points belong.
face::appearance::Detect nearest_face() {
  const auto finder = std::make_shared<face::landmarks::FaceFinder>(make_face_finder());
  return [finder](const cv::Mat& image) -> std::optional<cv::Rect2d> {
    cv::Mat gray;
    cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
    // Images are cropped around their points.
    const cv::Point2d center(0.5 * image.cols, 0.5 * image.rows);
    std::optional<cv::Rect2d> best;
    double min_distance = 0;
    for (const face::landmarks::Candidate& face : finder->find(gray)) {
      const cv::Point2d offset =
          cv::Point2d(face.box.x + face.box.width / 2, face.box.y + face.box.height / 2) - center;
      const double distance = std::hypot(offset.x, offset.y) - 0.5 * face.box.width;
      if (best && distance >= min_distance) continue;
      best = face.box;
      min_distance = distance;
    }
    return best;
  };
}

ExitStatus train_appearance(AamTrainFlags& flags, Context& context) {
  const Stopwatch watch;
  face::appearance::AppearanceOptions& options = flags.options;
  options.channels = face::appearance::parse_channels(flags.channels);
  const face::shape::LandmarkSet set = part_of(load_set(flags.set), flags.hold_out, Part::kOthers);
  if (options.mirror && set.mirror.empty()) {
    throw UsageError(
        "--mirror: the set does not say which points are left and right of each "
        "other; mark the symmetry with `landmarks annotate`");
  }
  if (!flags.mesh.empty()) options.mesh = face::shape::read_triangles(flags.mesh, set.points());
  face::appearance::LoadOptions load;
  load.largest = static_cast<int>(std::max(
      160.0, 1.6 * std::max(options.frame_width, options.colour ? options.colour_width : 0)));
  std::vector<std::string> skipped;
  const std::vector<TrainingImage> images = face::appearance::load_training_images(
      set, "", load, *context.progress, context.stop, skipped);
  for (const std::string& one : skipped) log_warning("{}; left out", one);

  AppearanceModel model;
  try {
    model = face::appearance::train_appearance_model(images, set.mirror, options, *context.progress,
                                                     context.stop);
  } catch (const std::invalid_argument& error) {
    throw InputError(flags.set.input, error.what());
  }
  int detected = 0;
  if (!flags.no_detector)
    detected = face::appearance::set_shape_in_box(model, images, nearest_face());
  // A detector has some detections anywhere by chance.
  if (detected * 4 < static_cast<int>(images.size())) model.shape_in_box = {};
  model.lost_error = face::appearance::learn_lost_error(images, set.mirror, options, context.seed,
                                                        *context.progress, context.stop);

  const nlohmann::json about = {
      {"program", fmt::format("tarsier {}", version())},
      {"seed", context.seed},
      {"data",
       std::filesystem::path(flags.set.input).lexically_normal().parent_path().filename().string() +
           "/" + std::filesystem::path(flags.set.input).filename().string()},
      {"samples", images.size()},
      {"mirrored", options.mirror},
      {"left_out", flags.hold_out > 0 ? fmt::format("every {}th", flags.hold_out) : "none"},
      {"terms", flags.terms}};
  face::appearance::write_appearance_model(flags.output, model, about);

  const double seconds = rounded(watch.seconds(), 1);
  const face::appearance::Texture& finest = model.levels.front();
  if (context.json) {
    nlohmann::ordered_json line = {{"output", flags.output},
                                   {"samples", images.size()},
                                   {"detected", detected},
                                   {"points", model.points()},
                                   {"triangles", model.mesh.size()},
                                   {"shape_modes", model.shape.mode_count()},
                                   {"shape_variance", model.shape.variance_kept},
                                   {"texture_modes", finest.mode_count()},
                                   {"texture_variance", finest.variance_kept},
                                   {"pixels", finest.warp.pixels().size()},
                                   {"lost_error", model.lost_error},
                                   {"seconds", seconds}};
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format(
        "{}: {} images of {} points, {} shape modes ({:.1f} % of the variance), {} texture modes "
        "({:.1f} %) of {} pixels, {} s\n",
        flags.output, images.size(), model.points(), model.shape.mode_count(),
        100 * model.shape.variance_kept, finest.mode_count(), 100 * finest.variance_kept,
        finest.warp.pixels().size(), seconds));
  }
  return ExitStatus::kDone;
}

void add_flags(Command& verb, AamTrainFlags& flags) {
  add_training_flags(verb, flags, "aam eval");
  face::appearance::AppearanceOptions& options = flags.options;
  verb.add_option(
          "--channels", flags.channels,
          "channels of a pixel in the fit: grey, colour, gradient (2 numbers) or oriented (8)")
      .check(one_of({"grey", "colour", "gradient", "oriented"}))
      .show_default();
  bind_field(verb, options, options.frame_width);
  bind_field(verb, options, options.levels);
  bind_all(verb, options.shape);
  bind_field(verb, options, options.texture_variance);
  bind_field(verb, options, options.texture_modes);
  bind_field(verb, options, options.colour_width);
  bind_field(verb, options, options.colour_modes);
  verb.add_flag("!--no-colour", options.colour,
                "omit the colour texture; the model can then only be fitted");
  bind_field(verb, options, options.mirror);
  bind_field(verb, options, options.to_the_right);
  verb.add_option("--mesh", flags.mesh,
                  "triangles: three landmark numbers (from 0) a line [Delaunay triangulation of "
                  "the mean shape]");
  verb.add_flag("--no-detector", flags.no_detector,
                "do not learn the position in a face detector's box (objects other than faces)");
}

}  // namespace

void add_aam_train(Command& area, Context& context) {
  add_verb<AamTrainFlags>(area, "train", "train an appearance model on annotated images", context,
                          add_flags, train_appearance);
}

}  // namespace tarsier::cli
