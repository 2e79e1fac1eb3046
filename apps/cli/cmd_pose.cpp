// SPDX-License-Identifier: MIT
#include "cmd_pose.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/head/point_file.h"
#include "tarsier/head/train_head.h"

#include <fmt/format.h>

#include <filesystem>
#include <numeric>
#include <vector>

namespace tarsier::cli {

void add_pose(Command& app, Context& context) {
  Command& area =
      app.add_subcommand("pose", "where heads look, and the pose of any object of known points");
  area.require_subcommand(1);
  add_pose_solve(area, context);
  add_pose_train_head(area, context);
  add_pose_train_view(area, context);
  add_pose_track(area, context);
  add_pose_eval(area, context);
  add_pose_synth(area, context);
}

void add_pose_flags(Command& verb, PoseFlags& flags) {
  add_landmark_flags(verb, flags.landmarks);
  verb.add_option("--head", flags.head, "head model [head.json, which ships]");
  verb.add_option("--mapping", flags.mapping,
                  "which landmark each head point is: lines \"head_point landmark\", from 0");
  Flag& camera = verb.add_option("--camera", flags.camera,
                                 "camera file of `calibrate`, or fx,fy,cx,cy[,k1,k2,p1,p2[,k3]]");
  verb.add_option("--focal", flags.focal,
                  "focal length in px [1.3 times the picture's larger side]")
      .check(positive())
      .excludes(camera);
  verb.add_option("--refine", flags.refine,
                  "auto: the direction is corrected by what the whole head looks like; none: from "
                  "the landmarks alone")
      .check(one_of({"auto", "none"}))
      .show_default();
  verb.add_option("--view", flags.view,
                  "what corrects it, a file of `pose train-view` [head-view.json among the models, "
                  "if it is there]");
}

head::HeadModel read_head(const std::string& path) {
  if (!path.empty()) return head::read_head_model(path);
  const std::string folder = find_models_folder("");
  if (folder.empty()) throw ModelError("head.json", "no folder of models: set TARSIER_MODELS");
  return head::read_head_model((std::filesystem::path(folder) / "head.json").string());
}

geometry::Camera camera_of(const std::string& text) {
  std::error_code error;
  if (text.find(',') != std::string::npos && !std::filesystem::exists(text, error)) {
    return geometry::parse_camera(text);
  }
  return geometry::read_camera_file(text);
}

namespace {

// What corrects the directions. The model that ships was learnt with the head and landmarks that
// ship: others slip in other ways.
std::shared_ptr<const head_view::ViewModel> view_of(const PoseFlags& flags) {
  if (flags.refine == "none") {
    if (!flags.view.empty()) throw UsageError("--view and --refine none exclude each other");
    return nullptr;
  }
  std::string path = flags.view;
  if (path.empty()) {
    if (!flags.head.empty() || !flags.mapping.empty() || !flags.landmarks.model.empty())
      return nullptr;
    path = (std::filesystem::path(find_models_folder("")) / "head-view.json").string();
    // A folder of models without it: from the landmarks alone.
    std::error_code error;
    if (!std::filesystem::exists(path, error)) return nullptr;
  }
  return std::make_shared<const head_view::ViewModel>(head_view::read_view_model(path));
}

}  // namespace

PoseEngine make_pose_engine(const PoseFlags& flags) {
  PoseEngine engine{make_landmark_engine(flags.landmarks), read_head(flags.head), {}, {}};
  const int landmarks = engine.landmarks.model.points();
  engine.mapping = flags.mapping.empty() ? head::own_mapping(engine.head)
                                         : head::read_landmark_mapping(
                                               flags.mapping, engine.head.points(), landmarks);
  for (const int landmark : engine.mapping.landmarks) {
    if (landmark >= landmarks) {
      throw UsageError(
          fmt::format("the head's points are of a markup with a landmark {}, the landmark model "
                      "has {}: give --mapping FILE",
                      landmark, landmarks));
    }
  }
  if (engine.mapping.landmarks.size() < 6) {
    throw UsageError("--mapping: a head's pose needs at least 6 points");
  }
  engine.options.fit = engine.landmarks.fit;
  engine.options.focal_px = flags.focal;
  if (!flags.camera.empty()) engine.options.camera = camera_of(flags.camera);
  engine.options.view = view_of(flags);
  return engine;
}

HeadComparison compare_head(const head::HeadModel& head, const std::string& path) {
  const Eigen::Matrix3Xd truth = head::read_landmarks3d(path);
  if (truth.cols() != head.points()) {
    throw InputError(path, fmt::format("has {} points, the head {}", truth.cols(), head.points()));
  }
  // In the head's mm: the truth may be in cm.
  HeadComparison comparison;
  comparison.all_mm = head::aligned_error(truth, head.mean);
  if (head.points() == 68) {
    std::vector<int> inner(51);
    std::iota(inner.begin(), inner.end(), 17);
    comparison.inner_mm = head::aligned_error(truth, head.mean, inner);
  }
  return comparison;
}

}  // namespace tarsier::cli
