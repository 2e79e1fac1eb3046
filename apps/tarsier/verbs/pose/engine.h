// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/pipelines/pose_tracker.h"

#include "framework/cli.h"
#include "verbs/landmarks/engine.h"
#include <nlohmann/json_fwd.hpp>
#include <string>

namespace tarsier::cli {

// The flags of every verb that finds heads.
struct PoseFlags {
  LandmarkFlags landmarks;
  std::string head;     // empty: the one that ships
  std::string mapping;  // empty: the head's own
  std::string camera;   // a file, or numbers
  double focal = 0;     // px; 0: guessed
  std::string view;     // empty: the one that ships
  std::string fit = "landmarks";
  std::string appearance;  // empty: the one that ships
  std::string refine = "auto";
};
void add_pose_flags(Command& verb, PoseFlags& flags);

// `edits`: the appearance model has another use, too. Throws InputError (the camera's file),
// UsageError.
[[nodiscard]] face::PoseTrackerOptions pose_options(const PoseFlags& flags, bool edits = false);
// With the models that ship. Throws as face::load_pose_models(), Interrupted.
[[nodiscard]] face::PoseModels load_pose_models(const face::PoseTrackerOptions& options);

[[nodiscard]] face::head::HeadModel read_head(
    const std::string& path);  // empty: the one that ships
void print_pointing(const face::head::PointingScore& score, const Context& context,
                    const std::string& title);

// How often the truth was within the deviations that came with the angles, with 95 % intervals: a
// line an axis, "" where there were none; and "with_sigma" (poses), "yaw_within_sigma",
// "yaw_within_2sigma" .. (shares) as members of `line`. `of`: which deviations, if not all: in the
// text behind "sigma", in the members behind the axis.
[[nodiscard]] std::string coverage_text(const face::head::AngleCoverage& coverage,
                                        const std::string& of = "");
void add_coverage(const face::head::AngleCoverage& coverage, nlohmann::ordered_json& line,
                  const std::string& of = "");

// A file, or "fx,fy,cx,cy[,..]".
[[nodiscard]] geometry::Camera camera_of(const std::string& text);

}  // namespace tarsier::cli
