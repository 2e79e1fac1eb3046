// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/run_session.h"
#include "ui/face/landmark_session.h"
#include "verbs/landmarks/engine.h"
#include "verbs/landmarks/landmarks.h"
#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

const double kDefaultGain = face::landmarks::AlphaBetaFilterOptions{}.gain;

struct LandmarkFitFlags {
  RunFlags run;
  LandmarkFlags landmarks;
  face::landmarks::TrackerOptions tracker;
  std::string csv;
  double smooth = -1;
  bool follows = false;  // the verb is `track`
};

// Columns of --csv: one row per face and frame.
std::string landmark_columns(int points) {
  std::string names = "frame,time,face,score";
  for (int p = 0; p < points; ++p) names += fmt::format(",x{0},y{0}", p);
  return names;
}

std::string row_of(const Frame& frame, const face::landmarks::TrackedFace& face) {
  std::string row =
      fmt::format("{},{:.3f},{},{:.3f}", frame.index, frame.time, face.id, face.score);
  for (Eigen::Index p = 0; p < face.points.cols(); ++p) {
    row += fmt::format(",{:.2f},{:.2f}", face.points(0, p), face.points(1, p));
  }
  return row;
}

ExitStatus run_landmark_fit(LandmarkFitFlags& flags, Context& context) {
  if (flags.smooth >= 0) {
    flags.tracker.smoothing = flags.smooth > 0;
    if (flags.smooth > 0) flags.tracker.filter.gain = std::min(1.0, kDefaultGain / flags.smooth);
  }
  flags.tracker.check();
  default_to_headless(flags.run);
  face::LandmarkTracker tracker = load_landmark_tracker(flags.landmarks, flags.tracker);
  RunHooks hooks;
  hooks.table = {flags.csv, landmark_columns(tracker.model().points())};
  DebugFolder debug(context.debug_dir);
  LandmarkSession session(std::move(tracker), debug.sink());
  bool found = false;
  hooks.title = "landmarks";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    found = found || !session.result().faces.empty();
    if (frame.still && !context.json && !context.quiet) {
      print_text(fmt::format("{}: {} {}", printable(frame.name), session.result().faces.size(),
                             session.result().faces.size() == 1 ? "face" : "faces"));
      for (const face::landmarks::TrackedFace& face : session.result().faces) {
        print_text(fmt::format(" [{:.0f},{:.0f} {:.0f}x{:.0f} {:.2f}]", face.box.x, face.box.y,
                               face.box.width, face.box.height, face.score));
      }
      print_text("\n");
    }
  };
  hooks.rows = [&](const Frame& frame) {
    std::vector<std::string> rows;
    for (const face::landmarks::TrackedFace& face : session.result().faces)
      rows.push_back(row_of(frame, face));
    return rows;
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line.update(to_json(session.result()));
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  return status == ExitStatus::kDone && !found ? ExitStatus::kNothingFound : status;
}

void add_flags(Command& verb, LandmarkFitFlags& flags) {
  add_run_flags(verb, flags.run);
  add_landmark_flags(verb, flags.landmarks);
  verb.add_option("--csv", flags.csv, "CSV file: frame, time, face, score, points");
  const auto video = [](Flag& flag) { flag.group("Videos and cameras"); };
  video(verb.add_option("--smooth", flags.smooth,
                        "smoothing of landmarks at rest, times the normal one; 0: none [1]"));
  bind_all(verb, flags.tracker, "Videos and cameras");
}

}  // namespace

void add_landmarks_fit(Command& area, Context& context) {
  add_debug_flag(add_verb<LandmarkFitFlags>(area, "fit", "fit landmarks to the faces in images",
                                            context, add_flags, run_landmark_fit),
                 context);
}

void add_landmarks_track(Command& area, Context& context) {
  const auto add_track_flags = [](Command& verb, LandmarkFitFlags& flags) {
    flags.follows = true;
    add_flags(verb, flags);
  };
  add_debug_flag(add_verb<LandmarkFitFlags>(area, "track",
                                            "track faces and their landmarks in videos and cameras",
                                            context, add_track_flags, run_landmark_fit),
                 context);
}

}  // namespace tarsier::cli
