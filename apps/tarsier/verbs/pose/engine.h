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

// The flags of all verbs that estimate head poses.
struct PoseFlags {
  LandmarkFlags landmarks;
  std::string head;     // empty: the shipped model
  std::string mapping;  // empty: that of the head model
  std::string camera;   // a file, or numbers
  double focal = 0;     // px; 0: estimated
  std::string view;     // empty: the shipped model
  std::string fit = "landmarks";
  std::string appearance;  // empty: the shipped model
  std::string refine = "auto";
};
void add_pose_flags(Command& verb, PoseFlags& flags);

// `edits`: the appearance model is also used for edits. Throws InputError for the camera file, and
// UsageError.
[[nodiscard]] face::PoseTrackerOptions pose_options(const PoseFlags& flags, bool edits = false);
// Uses the shipped models. Throws as face::load_pose_models() does, and Interrupted.
[[nodiscard]] face::PoseModels load_pose_models(const face::PoseTrackerOptions& options);

// `path` empty: the shipped model.
[[nodiscard]] face::head::HeadModel read_head(const std::string& path);
void print_pointing(const face::head::PointingScore& score, const Context& context,
                    const std::string& title);

// How often the error was within the predicted standard deviations, with 95 % intervals.
// coverage_text(): one line per axis, "" if there are none. add_coverage(): the members
// "with_sigma" (number of poses), "yaw_within_sigma", "yaw_within_2sigma" .. (shares) of `line`.
// `of` names the kind of deviations: it follows "sigma" in the text and the axis in the members.
[[nodiscard]] std::string coverage_text(const face::head::AngleCoverage& coverage,
                                        const std::string& of = "");
void add_coverage(const face::head::AngleCoverage& coverage, nlohmann::ordered_json& line,
                  const std::string& of = "");

// Reads a camera from a file or from "fx,fy,cx,cy[,..]".
[[nodiscard]] geometry::Camera camera_of(const std::string& text);

}  // namespace tarsier::cli
