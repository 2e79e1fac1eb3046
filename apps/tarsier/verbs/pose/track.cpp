// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/render/builtin.h"
#include "tarsier/render/obj_io.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/run_session.h"
#include "ui/face/pose_session.h"
#include "verbs/aam/engine.h"
#include "verbs/pose/pose.h"
#include <algorithm>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct TrackFlags {
  RunFlags run;
  PoseFlags pose;
  face::landmarks::TrackerOptions tracker;
  face::head::HeadPoseOptions head;
  std::string smooth = "one-euro";
  std::string draw = "axes";
  std::string csv;
  std::vector<std::string> edits;
  double amount = 1;
  bool no_identity = false;
};

// Columns of --csv: one row per frame and face with a pose.
constexpr const char* kPoseColumns =
    "frame,time,face,score,yaw,pitch,roll,x,y,z,rms_px,yaw_sigma_deg,pitch_sigma_deg,"
    "roll_sigma_deg";

std::string row_of(const Frame& frame, const face::PosedFace& face) {
  const face::head::HeadPose& pose = *face.pose;
  const Eigen::Vector3d& t = pose.camera_from_head.translation;
  return fmt::format(
      "{},{:.3f},{},{:.3f},{:.2f},{:.2f},{:.2f},{:.1f},{:.1f},{:.1f},{:.2f},{:.2f},{:.2f},{:.2f}",
      frame.index, frame.time, face.face.id, face.face.score, pose.angles.yaw_deg,
      pose.angles.pitch_deg, pose.angles.roll_deg, t[0], t[1], t[2], pose.rms_px,
      pose.yaw_sigma_deg, pose.pitch_sigma_deg, pose.roll_sigma_deg);
}

void set_overlay(const std::string& what, PoseSessionOptions& options) {
  constexpr std::pair<const char*, PoseOverlay> kKinds[] = {{"none", PoseOverlay::kNone},
                                                            {"axes", PoseOverlay::kAxes},
                                                            {"box", PoseOverlay::kBox},
                                                            {"head", PoseOverlay::kHead}};
  for (const auto& [name, overlay] : kKinds) {
    if (what == name) {
      options.overlay = overlay;
      return;
    }
  }
  options.overlay = PoseOverlay::kObject;
  for (const char* name : {"glasses", "hat"}) {
    if (what != name) continue;
    options.object = std::make_shared<const render::Mesh>(*render::builtin_mesh(name));
    return;
  }
  if (!what.ends_with(".obj") && !what.ends_with(".OBJ")) {
    throw UsageError(fmt::format(
        "--draw {}: expected none, axes, box, head, glasses, hat or a Wavefront file (.obj)",
        what));
  }
  render::ObjFile file = render::read_obj(what);
  for (const std::string& note : file.notes) log_warning("{}", note);
  options.object = std::make_shared<const render::Mesh>(std::move(file.mesh));
}

void set_edits(const TrackFlags& flags, PoseSessionOptions& options) {
  if (flags.edits.empty()) return;
  for (const std::string& name : flags.edits)
    options.edits.push_back(face::appearance::parse_edit(name));
  options.edit_amount = flags.amount;
  const std::string path =
      flags.pose.appearance.empty() ? shipped_appearance_model() : flags.pose.appearance;
  auto model = std::make_shared<face::appearance::AppearanceModel>(
      face::appearance::read_appearance_model(path));
  if (!model->colour) throw ModelError(path, "has no colour texture to draw faces with");
  if (model->points() != 68)
    throw ModelError(path, fmt::format("has {} points; --edit needs 68", model->points()));
  options.appearance = std::move(model);
}

std::string line_of(const face::PosedFace& face) {
  if (!face.pose) return fmt::format(" [no pose: {}]", face.reason);
  const face::head::HeadAngles& angles = face.pose->angles;
  return fmt::format(
      " [yaw {:+.1f} ± {:.1f} pitch {:+.1f} ± {:.1f} roll {:+.1f} ± {:.1f}, {:.0f} mm away]",
      angles.yaw_deg, face.pose->yaw_sigma_deg, angles.pitch_deg, face.pose->pitch_sigma_deg,
      angles.roll_deg, face.pose->roll_sigma_deg, face.pose->camera_from_head.translation.norm());
}

ExitStatus run_track(TrackFlags& flags, Context& context) {
  default_to_headless(flags.run);
  PoseSessionOptions drawing;
  set_overlay(flags.draw, drawing);
  set_edits(flags, drawing);
  face::PoseTrackerOptions options = pose_options(flags.pose, !flags.edits.empty());
  options.landmarks.tracker = flags.tracker;
  options.pose = flags.head;
  options.pose.fit_shape = !flags.no_identity;
  options.smoothing = flags.smooth == "none"   ? face::PoseSmoothing::kNone
                      : flags.smooth == "mean" ? face::PoseSmoothing::kMean
                                               : face::PoseSmoothing::kOneEuro;
  options.landmarks.tracker.smoothing = options.smoothing != face::PoseSmoothing::kNone;
  DebugFolder debug(context.debug_dir);
  PoseSession session(face::PoseTracker(load_pose_models(options), options), std::move(drawing),
                      debug.sink());
  bool found = false;
  RunHooks hooks;
  hooks.title = "pose";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    for (const face::PosedFace& face : session.faces()) found = found || face.pose.has_value();
    if (frame.still && !context.json && !context.quiet) {
      print_text(fmt::format("{}: {} {}", printable(frame.name), session.faces().size(),
                             session.faces().size() == 1 ? "face" : "faces"));
      for (const face::PosedFace& face : session.faces()) print_text(line_of(face));
      print_text("\n");
    }
  };
  hooks.table = {flags.csv, kPoseColumns};
  hooks.rows = [&](const Frame& frame) {
    std::vector<std::string> rows;
    for (const face::PosedFace& face : session.faces())
      if (face.pose) rows.push_back(row_of(frame, face));
    return rows;
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line.update(to_json(session.result()));
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  return status == ExitStatus::kDone && !found ? ExitStatus::kNothingFound : status;
}

void add_flags(Command& verb, TrackFlags& flags) {
  add_run_flags(verb, flags.run);
  add_pose_flags(verb, flags.pose);
  verb.add_option("--draw", flags.draw,
                  "axes, box, head, none, glasses, hat, or a Wavefront file (.obj; mm, origin "
                  "between the eyes, x right, y down, z away from the camera)")
      .show_default();
  verb.add_option("--edit", flags.edits,
                  "edit the faces: mouth (open), brows (raise); both with a comma")
      .delimiter(',')
      .check(one_of({"mouth", "brows"}));
  verb.add_option("--edit-amount", flags.amount, "strength of the edit, 1: natural")
      .check(range(0.0, 2.0))
      .show_default();
  verb.add_option("--csv", flags.csv,
                  "CSV file: frame, time, face, score, angles, place (mm), error, standard "
                  "deviations of the angles");
  verb.add_flag("--no-identity", flags.no_identity,
                "use the mean head for everyone; do not fit the shape");
  const auto video = [](Flag& flag) { flag.group("Videos and cameras"); };
  video(
      verb.add_option("--smooth", flags.smooth,
                      "none, mean (of 5 frames) or one-euro (steady when still, quick when moving)")
          .check(one_of({"none", "mean", "one-euro"}))
          .show_default());
  bind_all(verb, flags.tracker, "Videos and cameras");
}

}  // namespace

void add_pose_track(Command& area, Context& context) {
  add_debug_flag(
      add_verb<TrackFlags>(
          area, "track",
          "estimate head poses (yaw, pitch, roll, position) in images, videos and cameras", context,
          add_flags, run_track),
      context);
}

}  // namespace tarsier::cli
