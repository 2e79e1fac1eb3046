// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/run_session.h"
#include "ui/face/appearance_session.h"
#include "verbs/aam/aam.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::cli {
namespace {

using Overlay = AppearanceSession::Overlay;

struct AamFitFlags {
  RunFlags run;
  AamFlags aam;
  std::string draw = "mesh";
  bool parameters = false;
  std::string csv;
};

// Columns of --csv: one row per face and frame.
std::string fit_columns(int points) {
  std::string names = "frame,time,image,face,error,iterations,status";
  for (int p = 0; p < points; ++p) names += fmt::format(",x{0},y{0}", p);
  return names;
}

std::string row_of(const Frame& frame, const face::appearance::TrackedObject& object) {
  const Eigen::Matrix2Xd& points = object.fit.points;
  std::string row =
      fmt::format("{},{},{:.4f},{},{}", frame_cells(frame), object.id, object.fit.error,
                  object.fit.iterations, face::appearance::name_of(object.fit.status));
  for (Eigen::Index p = 0; p < points.cols(); ++p)
    row += fmt::format(",{:.3f},{:.3f}", points(0, p), points(1, p));
  return row;
}

nlohmann::ordered_json json_of(const face::appearance::TrackedObject& object, bool with_id,
                               bool with_parameters) {
  const Eigen::Matrix2Xd& points = object.fit.points;
  const Eigen::Vector2d low = points.rowwise().minCoeff();
  const Eigen::Vector2d size = points.rowwise().maxCoeff() - low;
  nlohmann::ordered_json face;
  if (with_id) face["id"] = object.id;
  face["box"] = {rounded(low.x(), 2), rounded(low.y(), 2), rounded(size.x(), 2),
                 rounded(size.y(), 2)};
  nlohmann::json list = nlohmann::json::array();
  for (Eigen::Index i = 0; i < points.cols(); ++i)
    list.push_back({rounded(points(0, i), 3), rounded(points(1, i), 3)});
  face["points"] = std::move(list);
  face["score"] = rounded(1 - object.fit.error, 4);
  face["error"] = rounded(object.fit.error, 4);
  face["iterations"] = object.fit.iterations;
  face["status"] = face::appearance::name_of(object.fit.status);
  if (with_parameters) {
    const auto numbers = [](const Eigen::VectorXd& v) {
      return std::vector<double>(v.data(), v.data() + v.size());
    };
    face["shape"] = numbers(object.fit.shape.b);
    face["texture"] = numbers(object.fit.c);
  }
  return face;
}

Overlay parse_overlay(const std::string& name) {
  for (const Overlay overlay :
       {Overlay::kMesh, Overlay::kFace, Overlay::kPoints, Overlay::kNothing})
    if (name_of(overlay) == name) return overlay;
  throw UsageError(fmt::format("--draw {}: expected mesh, face, points or nothing", name));
}

ExitStatus run_aam_fit(AamFitFlags& flags, Context& context) {
  default_to_headless(flags.run);
  const Overlay overlay = parse_overlay(flags.draw);
  const face::AppearanceTracker tracker = load_appearance_tracker(flags.aam);
  if (overlay == Overlay::kFace && !tracker.model().colour &&
      !face::appearance::has_offset(tracker.model().levels.front().channels))
    throw ModelError(tracker.path(), "has no colour texture for --draw face");
  DebugFolder debug(context.debug_dir);
  AppearanceSession session(tracker, overlay, debug.sink());
  bool found = false;
  RunHooks hooks;
  hooks.title = "appearance";
  hooks.debug = &debug;
  hooks.table = {flags.csv, fit_columns(tracker.model().points())};
  hooks.rows = [&](const Frame& frame) {
    std::vector<std::string> rows;
    for (const face::appearance::TrackedObject& object : session.objects())
      rows.push_back(row_of(frame, object));
    return rows;
  };
  hooks.after_frame = [&](const Frame& frame) {
    found = found || !session.objects().empty();
    if (!frame.still || context.json || context.quiet) return;
    std::string line = fmt::format("{}: {} {}", printable(frame.name), session.objects().size(),
                                   session.objects().size() == 1 ? "face" : "faces");
    for (const face::appearance::TrackedObject& object : session.objects()) {
      line += fmt::format(" [error {:.3f}, {} iterations, {}]", object.fit.error,
                          object.fit.iterations, face::appearance::name_of(object.fit.status));
    }
    print_text(line + "\n");
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    nlohmann::ordered_json faces = nlohmann::ordered_json::array();
    for (const face::appearance::TrackedObject& object : session.objects())
      faces.push_back(json_of(object, session.is_tracking(), flags.parameters));
    line["faces"] = std::move(faces);
    line["ms"] = rounded(session.milliseconds(), 2);
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  return status == ExitStatus::kDone && !found ? ExitStatus::kNothingFound : status;
}

void add_flags(Command& verb, AamFitFlags& flags) {
  add_run_flags(verb, flags.run);
  add_aam_flags(verb, flags.aam);
  verb.add_option("--draw", flags.draw,
                  "mesh, face (the model's, over the image), points or nothing")
      .show_default();
  verb.add_flag("--parameters", flags.parameters,
                "--json: include the shape and texture parameters");
  verb.add_option("--csv", flags.csv,
                  "CSV file: frame, time, image, face, error, iterations, status, points");
  bind_all(verb, flags.aam.track, "Videos and cameras");
}

}  // namespace

void add_aam_fit(Command& area, Context& context) {
  add_debug_flag(
      add_verb<AamFitFlags>(area, "fit", "fit a model to images, videos and cameras (tracked)",
                            context, add_flags, run_aam_fit),
      context);
}

}  // namespace tarsier::cli
