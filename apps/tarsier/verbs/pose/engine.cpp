// SPDX-License-Identifier: MIT
#include "verbs/pose/engine.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/camera_file.h"

#include <filesystem>
#include <string>

namespace tarsier::cli {

void add_pose_flags(Command& verb, PoseFlags& flags) {
  add_landmark_flags(verb, flags.landmarks);
  verb.add_option("--head", flags.head, "head model [head.json, shipped]");
  verb.add_option("--mapping", flags.mapping,
                  "landmark of each head point: lines \"head_point landmark\", from 0");
  Flag& camera = verb.add_option("--camera", flags.camera,
                                 "camera file of `calibrate`, or fx,fy,cx,cy[,k1,k2,p1,p2[,k3]]");
  verb.add_option("--focal", flags.focal, "focal length, px [1.3 times the longer image side]")
      .check(above(0))
      .excludes(camera);
  verb.add_option(
          "--fit", flags.fit,
          "landmark source: landmarks, or aam: an active appearance model initialised by landmarks")
      .check(one_of({"landmarks", "aam"}))
      .show_default();
  verb.add_option("--appearance", flags.appearance,
                  "appearance model for --fit aam and `pose track --edit` [aam68.json, shipped]");
  verb.add_option("--refine", flags.refine,
                  "auto: correct the direction by the head's appearance (--fit aam: only with "
                  "--view); none: landmarks only")
      .check(one_of({"auto", "none"}))
      .show_default();
  verb.add_option("--view", flags.view,
                  "pose correction model of `pose train-view` [head-view.json, if installed]");
}

face::head::HeadModel read_head(const std::string& path) {
  return face::head::read_head_model(ModelStore::find().path_or(path, "head.json"));
}

geometry::Camera camera_of(const std::string& text) {
  std::error_code error;
  if (text.find(',') != std::string::npos && !std::filesystem::exists(text, error)) {
    return geometry::parse_camera(text);
  }
  return geometry::read_camera_file(text);
}

face::PoseTrackerOptions pose_options(const PoseFlags& flags, bool edits) {
  if (flags.refine == "none" && !flags.view.empty())
    throw UsageError("--view and --refine none exclude each other");
  if (flags.fit != "aam" && !edits && !flags.appearance.empty())
    throw UsageError("--appearance needs --fit aam, or --edit of `pose track`");
  face::PoseTrackerOptions options;
  options.landmarks = landmark_options(flags.landmarks);
  if (flags.fit == "aam") {
    options.fit = face::PoseFit::kAam;
    options.appearance = flags.appearance;
  }
  options.head = flags.head;
  options.mapping = flags.mapping;
  options.refine = flags.refine != "none";
  options.view = flags.view;
  options.focal_px = flags.focal;
  if (!flags.camera.empty()) options.camera = camera_of(flags.camera);
  return options;
}

face::PoseModels load_pose_models(const face::PoseTrackerOptions& options) {
  options.check();
  const EndOnSignals at_once;  // loading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  return face::load_pose_models(ModelStore::find(), options);
}

}  // namespace tarsier::cli
