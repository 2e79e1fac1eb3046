// SPDX-License-Identifier: MIT
#include "tarsier/core/length.h"
#include "tarsier/core/log.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/input_files.h"
#include "tarsier/planar/image_targets/quality.h"
#include "tarsier/planar/image_targets/target_io.h"
#include "tarsier/planar/image_targets/train.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/on_event.h"
#include "framework/run_session.h"
#include "framework/stopwatch.h"
#include "ui/planar/target_session.h"
#include "verbs/ar/ar.h"
#include "verbs/pose/pose.h"
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

using Json = nlohmann::ordered_json;

struct TargetTrainFlags {
  std::string image;
  std::string output;
  std::string width = "20cm";
  std::string name;
  std::string draw;
  planar::image_targets::TrainOptions options;
};

ExitStatus run_train_target(TargetTrainFlags& flags, Context& context) {
  flags.options.width = parse_length(flags.width, "--width");
  flags.options.seed = context.seed;
  flags.options.check();
  const InputFiles input({flags.image});
  input.refuse_output(flags.output);
  input.refuse_output(flags.draw);
  const cv::Mat image = read_image(flags.image);
  const int shorter = std::min(image.cols, image.rows);
  if (shorter < 32 || shorter * 8 < std::max(image.cols, image.rows)) {
    throw InputError(flags.image,
                     fmt::format("is {} x {} px: sides of at least 32 px are needed, none more "
                                 "than 8 times the other",
                                 image.cols, image.rows));
  }
  const std::string name =
      flags.name.empty() ? std::filesystem::path(flags.image).stem().string() : flags.name;
  const Stopwatch watch;
  const planar::image_targets::Target trained =
      planar::image_targets::train_target(image, name, flags.options, context.stop);
  const double seconds = watch.seconds();
  planar::image_targets::write_target(
      flags.output, trained,
      {{"image", flags.image},
       {"program", std::string("tarsier ") + std::string(version())},
       {"seed", flags.options.seed},
       {"trials", flags.options.trials}});
  if (!flags.draw.empty()) write_image(flags.draw, planar::image_targets::draw_quality(trained));
  const planar::image_targets::Quality& q = trained.quality;
  if (context.json) {
    Json line;
    line["image"] = flags.image;
    line["target"] = flags.output;
    line["name"] = trained.name;
    line["width"] = trained.width;
    line["height"] = trained.height;
    line["features"] = trained.features.size();
    line["rating"] = q.rating;
    line["quality"] = {{"found", q.repeatability},
                       {"features", q.features},
                       {"spread", q.spread},
                       {"distinct", q.distinct}};
    line["reasons"] = q.reasons;
    line["seconds"] = rounded(seconds, 2);
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format("{}: {} features, rating {:.2f} (1 is best), print {:g} x {:.4g} m\n",
                           flags.output, trained.features.size(), q.rating, trained.width,
                           trained.height));
    for (const std::string& reason : q.reasons) print_text("  " + reason + "\n");
  }
  // The file is always written; the exit status says that the image cannot be detected.
  return q.rating < 0.05 ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

struct FollowFlags {
  RunFlags run;
  std::vector<std::string> targets;
  std::string camera;
  std::string csv;
  std::string draw = "box";
  OnEventFlags on_event;
  PublishFlags publish;
  planar::TargetTrackerOptions tracker;
};

// Columns of --csv: one row per target and frame.
constexpr const char* kTargetColumns =
    "frame,time,id,confidence,x0,y0,x1,y1,x2,y2,x3,y3,tx,ty,tz,rms_px";

std::string row_of(const Frame& frame, const planar::image_targets::TrackedTarget& seen) {
  std::string row =
      fmt::format("{},{:.3f},{},{:.3f}", frame.index, frame.time, seen.target, seen.confidence);
  for (const cv::Point2d& c : seen.corners) row += fmt::format(",{:.3f},{:.3f}", c.x, c.y);
  if (seen.pose) {
    const Eigen::Vector3d& t = seen.pose->camera_from_plane.translation;
    row += fmt::format(",{:.5f},{:.5f},{:.5f}", t[0], t[1], t[2]);
  } else {
    row += ",,,";
  }
  return row + fmt::format(",{:.3f}", seen.rms_px);
}

TargetOverlay overlay_of(const std::string& name) {
  if (name == "outline") return TargetOverlay::kOutline;
  if (name == "axes") return TargetOverlay::kAxes;
  return name == "none" ? TargetOverlay::kNone : TargetOverlay::kBox;
}

ExitStatus run_follow(FollowFlags& flags, Context& context) {
  default_to_headless(flags.run);
  if (flags.targets.empty() && !opens_window(flags.run) && flags.run.actions.empty())
    throw UsageError(
        "--target: give the files of `ar target-train` to detect (or --window, to train on an "
        "image)");
  TargetSessionOptions options;
  options.train.trials = 8;  // fewer trials, because a user waits
  options.train.seed = context.seed;
  options.overlay = overlay_of(flags.draw);
  if (!flags.camera.empty()) flags.tracker.camera = camera_of(flags.camera);
  const auto tracker = planar::TargetTracker::load(flags.targets, flags.tracker);
  for (std::size_t i = 0; i < flags.targets.size(); ++i) {
    const double rating = tracker.targets()[i].quality.rating;
    if (rating < 0.3)
      log_warning("{}: a poor target (rating {:.2f}): see `ar target-train --draw`",
                  flags.targets[i], rating);
  }
  DebugFolder debug(context.debug_dir);
  options.debug = debug.sink();
  TargetSession session(tracker, options);
  bool found = false;
  OnEvent on_event(flags.on_event, context, flags.publish, http_access(flags.run));
  PresenceEvents events(on_event, "target");
  RunHooks hooks;
  hooks.title = "targets";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    const planar::TargetResult& result = session.result();
    found = found || !result.tracked.empty();
    if (on_event) events.frame(frame, to_json(result).at("markers"));
    if (frame.still && !context.json && !context.quiet) {
      print_text(frame.name + ":");
      for (const planar::image_targets::TrackedTarget& seen : result.tracked) {
        const cv::Point2d middle = (seen.corners[0] + seen.corners[2]) * 0.5;
        print_text(
            fmt::format(" [{} at {:.0f},{:.0f}]", result.target_of(seen).name, middle.x, middle.y));
      }
      print_text(result.tracked.empty() ? " none\n" : "\n");
    }
  };
  hooks.table = {flags.csv, kTargetColumns};
  hooks.rows = [&](const Frame& frame) {
    std::vector<std::string> rows;
    for (const planar::image_targets::TrackedTarget& seen : session.result().tracked)
      rows.push_back(row_of(frame, seen));
    return rows;
  };
  hooks.describe = [&](const View&, Json& line) { line.update(to_json(session.result())); };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  events.finish();
  on_event.finish();
  return status == ExitStatus::kDone && !found ? ExitStatus::kNothingFound : status;
}

void add_train_flags(Command& verb, TargetTrainFlags& flags) {
  verb.add_option("image", flags.image, "image of the flat target, frontal, without margin")
      .required();
  verb.add_option("-o,--output", flags.output, "output target file: cover.target.json").required();
  verb.add_option("--width", flags.width, "width of the print: 20cm, 0.2m, 200mm").show_default();
  verb.add_option("--name", flags.name, "name of the target [the image's name]");
  verb.add_option("--draw", flags.draw, "output image of the trackability, with the weak regions");
  bind_all(verb, flags.options);
}

void add_track_flags(Command& verb, FollowFlags& flags) {
  add_run_flags(verb, flags.run);
  verb.add_option("--target", flags.targets,
                  "target file of `ar target-train`; repeatable; targets are numbered from 0");
  verb.add_option(
      "--camera", flags.camera,
      "camera file of `calibrate`, or fx,fy,cx,cy[,k1,k2,p1,p2[,k3]]; needed for poses");
  verb.add_option("--draw", flags.draw, "box, axes, outline or none (box and axes need a camera)")
      .check(one_of({"box", "axes", "outline", "none"}))
      .show_default();
  verb.add_option("--csv", flags.csv,
                  "CSV file: frame, time, id, confidence, corners, position (m), error");
  add_on_event_flags(verb, flags.on_event, "when a target appears or is lost");
  add_publish_flags(verb, flags.publish, "target");
  bind_all(verb, flags.tracker.track, "Videos and cameras");
}

}  // namespace

void add_ar_target_train(Command& ar, Context& context) {
  add_verb<TargetTrainFlags>(ar, "target-train",
                             "make a target file from an image, for detection and tracking",
                             context, add_train_flags, run_train_target);
}

void add_ar_target_track(Command& ar, Context& context) {
  add_debug_flag(
      add_verb<FollowFlags>(
          ar, "target-track",
          "detect and track trained images in images, videos and cameras, with their poses",
          context, add_track_flags, run_follow),
      context);
}

}  // namespace tarsier::cli
