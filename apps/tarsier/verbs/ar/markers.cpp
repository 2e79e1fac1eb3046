// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/length.h"
#include "tarsier/core/log.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/render/obj_io.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/on_event.h"
#include "framework/run_session.h"
#include "ui/planar/ar_session.h"
#include "verbs/ar/ar.h"
#include "verbs/pose/pose.h"
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

// More triangles cannot be rendered live, and no object on a marker needs them.
constexpr int kMaxTriangles = 500'000;

struct MarkersFlags {
  RunFlags run;
  std::string family = "36h11";
  std::string size = "50mm";
  std::string board;
  std::string camera;
  std::string backend = "own";
  std::string draw = "ids";
  std::string mesh;
  std::string up = "y";
  planar::augment::AugmentOptions augment;
  bool no_shadow = false;
  std::string smooth = "one-euro";
  std::string csv;
  OnEventFlags on_event;
  PublishFlags publish;
  planar::MarkerTrackerOptions tracker;
};

// Columns of --csv: one row per marker and frame.
constexpr const char* kMarkerColumns =
    "frame,time,image,id,x,y,z,rx,ry,rz,error_px,ambiguity,x0,y0,x1,y1,x2,y2,x3,y3";

std::string row_of(const Frame& frame, const planar::TrackedMarker& posed) {
  std::string row = fmt::format("{},{}", frame_cells(frame), posed.marker.id);
  if (posed.pose) {
    const geometry::Rigid3& pose = posed.pose->camera_from_marker;
    const Eigen::Vector3d r = geometry::rotation_vector(pose.rotation);
    for (const Eigen::Vector3d& v : {pose.translation, r})
      row += fmt::format(",{:.6f},{:.6f},{:.6f}", v[0], v[1], v[2]);
    row += fmt::format(",{:.3f},{:.3f}", posed.pose->rms_px, posed.pose->ambiguity);
  } else {
    row += ",,,,,,,,";
  }
  for (const Eigen::Vector2d& p : posed.marker.corners)
    row += fmt::format(",{:.3f},{:.3f}", p.x(), p.y());
  return row;
}

std::shared_ptr<const render::Mesh> read_mesh(const std::string& path, planar::augment::Up up) {
  render::ObjLimits limits;
  limits.max_faces = kMaxTriangles;
  const render::ObjFile file = render::read_obj(path, limits);
  for (const std::string& note : file.notes) log_warning("{}", note);
  const render::Bounds box = render::bounds_of(file.mesh);
  if (cv::norm(box.high - box.low) <= 0) throw InputError(path, "all its points coincide");
  return std::make_shared<const render::Mesh>(planar::augment::upright_mesh(file.mesh, up));
}

planar::MarkerTracker tracker_of(const MarkersFlags& flags) {
  planar::MarkerTrackerOptions options = flags.tracker;
  options.families = {flags.family};
  options.side = parse_length(flags.size, "--size");
  if (!flags.board.empty()) {
    options.board = planar::markers::read_marker_board(flags.board);
    options.families = {options.board->family};
  }
  if (flags.backend == "opencv") options.detector = planar::MarkerDetector::kOpencv;
  options.track.smooth = flags.smooth != "none";
  if (!flags.camera.empty()) options.camera = camera_of(flags.camera);
  return planar::MarkerTracker::load(options);
}

ArSessionOptions drawing_of(const MarkersFlags& flags) {
  ArSessionOptions options;
  options.outlines = flags.draw == "ids" && flags.mesh.empty();
  options.augment = flags.augment;
  options.augment.shadow = !flags.no_shadow;
  options.augment.object =
      planar::augment::object_named(flags.draw).value_or(planar::augment::Object::kNone);
  if (!flags.mesh.empty()) {
    options.augment.mesh =
        read_mesh(flags.mesh, flags.up == "z" ? planar::augment::Up::kZ : planar::augment::Up::kY);
    options.augment.object = planar::augment::Object::kMesh;
  }
  return options;
}

std::string line_of(const std::string& name,
                    const std::optional<planar::markers::MarkerPose>& pose) {
  if (!pose) return fmt::format(" [{}: no pose]", name);
  const Eigen::Vector3d& t = pose->camera_from_marker.translation;
  return fmt::format(" [{}: {:.3f} m away, at {:+.3f} {:+.3f} {:+.3f}]", name, t.norm(), t[0], t[1],
                     t[2]);
}

ExitStatus run_markers(MarkersFlags& flags, Context& context) {
  default_to_headless(flags.run);
  const planar::MarkerTracker tracker = tracker_of(flags);
  ArSessionOptions options = drawing_of(flags);
  const bool guesses = !tracker.options().camera && tracker.options().focal_px <= 0;
  bool has_reported = false;
  DebugFolder debug(context.debug_dir);
  options.debug = debug.sink();
  ArSession session(tracker, std::move(options));
  bool found = false;
  OnEvent on_event(flags.on_event, context, flags.publish, http_access(flags.run));
  PresenceEvents events(on_event, "marker");
  RunHooks hooks;
  hooks.title = "markers";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    if (guesses && !has_reported) {
      log_warning(
          "no --camera: a focal length of {:.0f} px is guessed, and distances have the same "
          "relative error",
          session.result().camera.fx);
      has_reported = true;
    }
    if (on_event) events.frame(frame, to_json(session.result()).at("markers"));
    found = found || !session.result().markers.empty();
    if (frame.still && !context.json && !context.quiet) {
      const std::size_t count = session.result().markers.size();
      print_text(fmt::format("{}: {} {}", frame.name, count, count == 1 ? "marker" : "markers"));
      if (tracker.options().board) {
        print_text(line_of("board", session.result().board));
      } else {
        for (const planar::TrackedMarker& posed : session.result().markers)
          print_text(line_of(std::to_string(posed.marker.id), posed.pose));
      }
      print_text("\n");
    }
  };
  hooks.table = {flags.csv, kMarkerColumns};
  hooks.rows = [&](const Frame& frame) {
    std::vector<std::string> rows;
    for (const planar::TrackedMarker& posed : session.result().markers)
      rows.push_back(row_of(frame, posed));
    return rows;
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line.update(to_json(session.result()));
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  events.finish();
  on_event.finish();
  return status == ExitStatus::kDone && !found ? ExitStatus::kNothingFound : status;
}

void add_flags(Command& verb, MarkersFlags& flags) {
  add_run_flags(verb, flags.run);
  Flag& family =
      verb.add_option("--family", flags.family,
                      "aruco-original (orig), 4x4_50 .. 7x7_1000, 16h5, 25h9, 36h10, 36h11");
  family.show_default();
  Flag& size = verb.add_option("--size", flags.size, "side of the markers' black frame: 50mm");
  size.show_default();
  verb.add_option("--board", flags.board,
                  "places of markers on one sheet (`ar marker-sheet --layout`): one common pose")
      .excludes(family)
      .excludes(size);
  Flag& camera = verb.add_option("--camera", flags.camera,
                                 "camera file of `calibrate`, or fx,fy,cx,cy[,k1,k2,p1,p2[,k3]]");
  verb.add_option("--focal", flags.tracker.focal_px, "focal length, px [the longer image side]")
      .check(above(0))
      .excludes(camera);
  verb.add_option("--backend", flags.backend, "own, or opencv for comparison")
      .check(one_of({"own", "opencv"}))
      .show_default();
  verb.add_option("--csv", flags.csv,
                  "CSV file: frame, time, id, position (m), rotation vector, error, corners");
  add_on_event_flags(verb, flags.on_event, "when a marker appears or is lost");
  add_publish_flags(verb, flags.publish, "marker");
  const auto drawing = [](Flag& flag) { flag.group("What is drawn"); };
  Flag& draw = verb.add_option("--draw", flags.draw, "none, ids, axes or cube");
  drawing(draw.check(one_of({"none", "ids", "axes", "cube"})).show_default());
  Flag& mesh =
      verb.add_option("--mesh", flags.mesh, "Wavefront file (.obj) to draw on the markers");
  drawing(mesh.excludes(draw));
  drawing(verb.add_option("--mesh-up", flags.up, "up axis of the mesh: y or z")
              .check(one_of({"y", "z"}))
              .needs(mesh)
              .show_default());
  drawing(bind_field(verb, flags.augment, flags.augment.scale));
  drawing(verb.add_flag("--no-shadow", flags.no_shadow, "draw no shadows"));
  const auto finding = [](Flag& flag) { flag.group("Detection"); };
  finding(verb.add_option(
                  "--smooth", flags.smooth,
                  "smoothing in videos: none or one-euro (steady when still, quick when moving)")
              .check(one_of({"none", "one-euro"}))
              .show_default());
  finding(bind_field(verb, flags.tracker.detect.quads, flags.tracker.detect.quads.min_side_px));
  finding(
      bind_field(verb, flags.tracker.detect.decode, flags.tracker.detect.decode.min_correlation));
}

}  // namespace

void add_ar_markers(Command& ar, Context& context) {
  add_debug_flag(
      add_verb<MarkersFlags>(
          ar, "markers", "detect printed markers, estimate their poses and draw objects on them",
          context, add_flags, run_markers),
      context);
}

}  // namespace tarsier::cli
