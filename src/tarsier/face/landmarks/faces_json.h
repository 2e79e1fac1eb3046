// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/tracker.h"

#include <Eigen/Core>

#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face::landmarks {

// [{"id", "box": [x, y, w, h], "points": [[x, y] ..], "visible": [..], "sigma_px": [..], "score",
// "detection"}]; the id only of followed faces, the detector's score only of others, "visible" and
// "sigma_px" (Visibility) only where the model tells them.
[[nodiscard]] nlohmann::ordered_json faces_json(const std::vector<TrackedFace>& faces,
                                                bool with_ids);

// Points of other programs' or our own lines: {"image", "points": [[x, y] ..]} or {"image",
// "faces":
// [{"box", "points"} ..]}, of which the widest counts; none: no face found.
struct FaceLines {
  std::string path;
  std::map<std::string, std::optional<Eigen::Matrix2Xd>> points;  // by the image's canonical path
  // Nothing where the image has no line. Throws InputError where the number of points differs.
  [[nodiscard]] std::optional<Eigen::Matrix2Xd> find(const std::string& image, int count) const;
};
// Throws InputError naming file and line.
[[nodiscard]] FaceLines read_face_lines(const std::string& path);

}  // namespace tarsier::face::landmarks
