// SPDX-License-Identifier: MIT
#include "verbs/calibrate/calibrate.h"

#include "tarsier/core/length.h"
#include "tarsier/core/log.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/input_files.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/input_schemes.h"
#include "framework/security_flags.h"
#include "ui/planar/calibrate_session.h"
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

// Searches every still, and some frames of videos.
planar::CalibratorState find_boards(const CalibrateFlags& flags,
                                    const planar::Calibrator& calibrator, Context& context) {
  planar::CalibratorState state;
  for (const std::string& input : flags.run.inputs) {
    const auto source = open_source(input, flags.run.source, input_schemes());
    if (source->is_live()) {
      throw UsageError(
          fmt::format("{}: a live source cannot be combined with other inputs", input));
    }
    calibrator.search(*source, state, *context.progress, context.stop);
  }
  if (state.images.empty()) throw InputError(flags.run.inputs.front(), "delivered no image");
  return state;
}

// Advice if no image shows the board.
std::string hint_of(const planar::Calibrator& calibrator, const planar::CalibratorState& state) {
  if (const auto other = calibrator.other_board(state))
    return fmt::format("; a board of {0} inner corners was found: use --board chess:{0}", *other);
  return calibrator.options().board.kind == planar::calibration::BoardKind::kChess
             ? "; chess:9x6 means 9 x 6 inner corners, one less than squares each way, and the "
               "whole board with its white rim must be in the image"
             : "; the whole board must be in the image (a part is enough for charuco boards)";
}

// --- the session ---

// Whether the run has a window or a camera: then a person moves the board.
bool is_session(const CalibrateFlags& flags) {
  if (flags.run.window || flags.run.fullscreen || !flags.run.actions.empty()) return true;
  for (const std::string& input : flags.run.inputs) {
    const SourceKind kind = classify_source(input, input_schemes());
    const bool is_live_scheme =
        kind == SourceKind::kScheme &&
        (input.starts_with("viewer:") || input.find("live=1") != std::string::npos);
    if (kind == SourceKind::kCamera || kind == SourceKind::kPiCamera || kind == SourceKind::kHttp ||
        kind == SourceKind::kFfmpegUrl || is_live_scheme) {
      return true;
    }
  }
  return false;
}

ExitStatus run_live(CalibrateFlags& flags, const planar::Calibrator& calibrator, Context& context) {
  CalibrateSession session(calibrator);
  RunHooks hooks;
  hooks.title = "calibrate";
  hooks.describe = [&](const View& view, nlohmann::ordered_json& line) {
    for (const char* key : {"views", "coverage", "verdict", "calibrated", "rms", "fx"})
      line[key] = view.state[key];
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  if (status != ExitStatus::kDone) return status;
  if (session.calibrator_state().views.empty()) {
    log_warning("no view of the board {} was taken: no camera is written",
                calibrator.options().board.text());
    return ExitStatus::kNothingFound;
  }
  return finish_calibration(
      flags, calibrator.calibrate(session.calibrator_state(), {}, context.stop), context);
}

// --- the verb ---

void refuse_to_overwrite(const CalibrateFlags& flags) {
  const InputFiles inputs(flags.run.inputs, input_schemes());
  inputs.refuse_output(flags.output);
  inputs.refuse_output(flags.csv);
  for (const std::string& folder : {flags.draw, flags.undistorted}) {
    if (folder.empty()) continue;
    for (const std::string& path : inputs.paths()) {
      const std::string name = std::filesystem::path(path).stem().string() + ".png";
      inputs.refuse_output((std::filesystem::path(folder) / name).string());
    }
  }
}

ExitStatus run_calibrate(CalibrateFlags& flags, Context& context) {
  const bool live = is_session(flags);
  planar::CalibratorOptions options =
      live ? planar::live_calibrator_options() : planar::CalibratorOptions();
  options.board =
      planar::calibration::parse_board(flags.board, parse_length(flags.square, "--square"));
  options.calibrate = flags.lens_options;
  options.calibrate.lens = geometry::lens_named(flags.lens).value();
  options.calibrate.tangential = !flags.no_tangential;
  options.collect.max_views = flags.max_views;
  options.every = flags.run.every;
  options.keep_images = !flags.draw.empty() || !flags.undistorted.empty();
  const auto calibrator = planar::Calibrator::load(options);
  refuse_to_overwrite(flags);
  if (live) return run_live(flags, calibrator, context);
  const planar::CalibratorState state = find_boards(flags, calibrator, context);
  const std::string board = options.board.text();
  const auto stills = static_cast<std::size_t>(std::ranges::count_if(
      state.images, [](const planar::CalibrationImage& image) { return image.still; }));
  if (state.views.empty()) {
    log_warning("no board {} in {} {}{}", board, state.images.size(),
                state.images.size() == 1 ? "image" : "images", hint_of(calibrator, state));
  }
  const planar::CalibrationResult result = calibrator.calibrate(state, {}, context.stop);
  if (state.views.empty()) {
    if (context.json) print_images(result);
    return ExitStatus::kNothingFound;
  }
  const auto boards = static_cast<std::size_t>(std::ranges::count_if(
      result.views, [](const planar::calibration::BoardView& view) { return !view.empty(); }));
  if (4 * boards <= stills) {
    log_warning("the board {} is in {} of {} images only{}", board, boards, stills,
                hint_of(calibrator, state));
  }
  return finish_calibration(flags, result, context);
}

void add_lens_flags(Command& verb, CalibrateFlags& flags) {
  const auto lens = [](Flag& flag) { flag.group("Lens"); };
  lens(verb.add_option("--lens", flags.lens,
                       "pinhole (k1 k2 p1 p2 k3), rational (k1..k6 p1 p2), fisheye (k1..k4)")
           .check(one_of({"pinhole", "rational", "fisheye"}))
           .show_default());
  lens(bind_field(verb, flags.lens_options, flags.lens_options.radial));
  lens(verb.add_flag("--no-tangential", flags.no_tangential, "fix p1 and p2 to 0"));
  lens(verb.add_flag("--square-pixels", flags.lens_options.square_pixels, "fix fy to fx"));
  lens(bind_field(verb, flags.lens_options, flags.lens_options.outlier));
}

void add_flags(Command& verb, CalibrateFlags& flags) {
  flags.run.output = "none";
  verb.add_option(
          "INPUT", flags.run.inputs,
          "images, folders, globs, @list.txt, videos; or a camera or URL for a live session")
      .required()
      .type_name("");
  verb.add_option("--board", flags.board,
                  "chess:9x6 (inner corners), charuco:5x7:6x6_250, circles:4x11, circles-grid:7x6")
      .required();
  verb.add_option("--square", flags.square,
                  "side of a square, or distance of dots: 25mm, 2.5cm, 0.025")
      .required();
  verb.add_option("-o,--output", flags.output, "output camera file (camera.yaml)");
  verb.add_option("--format", flags.format, "format of the camera file: tarsier, opencv, colmap")
      .check(one_of({"tarsier", "opencv", "colmap"}))
      .show_default();
  verb.add_option("--csv", flags.csv, "CSV file, one row an image");
  verb.add_option("--draw", flags.draw,
                  "output folder for images with detected corners, and coverage.png");
  verb.add_option("--undistorted", flags.undistorted, "output folder for undistorted images");
  verb.add_option("--views", flags.max_views, "maximum number of images taken from a video")
      .check(range(3, 500))
      .show_default();
  verb.add_option("--every", flags.run.every, "videos: examine N times fewer frames")
      .check(range(1, 100000))
      .show_default();
  const auto live = [](Flag& flag) { flag.group("Session"); };
  live(verb.add_flag("--window", flags.run.window,
                     "live session in a window that takes views automatically (h: keys)"));
  live(verb.add_flag("--fullscreen", flags.run.fullscreen, "show the window in full screen"));
  live(verb.add_option("--actions", flags.run.actions,
                       "-: read actions by name from stdin, one a line")
           .check(one_of({"-"})));
  live(verb.add_option("--frames", flags.run.frames, "stop after this many frames; 0: all")
           .check(at_least(0))
           .show_default());
  SourceOptions& source = flags.run.source;
  live(bind_field(verb, source, source.width, {},
                  "requested camera image width, px; 0: the camera's choice"));
  live(bind_field(verb, source, source.height));
  live(bind_field(verb, source, source.fps, {},
                  "requested frame rate of a camera; 0: the camera's own"));
  for (Flag* flag : add_security_flags(verb, flags.run.source.security)) live(*flag);
  add_lens_flags(verb, flags);
}

}  // namespace

void add_calibrate(Command& app, Context& context) {
  add_verb<CalibrateFlags>(
      app, "calibrate",
      "calibrate a camera (focal length, principal point, distortion) from images of a board",
      context, add_flags, run_calibrate);
}

}  // namespace tarsier::cli
