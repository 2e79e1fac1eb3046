// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/tracker.h"

#include <Eigen/Core>

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face::landmarks {

// [{"id", "box": [x, y, w, h], "points": [[x, y] ..], "visible": [..], "sigma_px": [..], "score",
// "detection"}]. "id" only for tracked faces, "detection" (the detector's score) only for others,
// "visible" and "sigma_px" (Visibility) only if the model provides them.
[[nodiscard]] nlohmann::ordered_json faces_json(const std::vector<TrackedFace>& faces,
                                                bool with_ids);

// Points from JSON lines of Tarsier or other programs: {"image", "points": [[x, y] ..]} or
// {"image", "faces": [{"box", "points"} ..]}, of which the widest is used; an empty list: no face
// found.
struct FaceLines {
  std::string path;
  std::map<std::string, std::optional<Eigen::Matrix2Xd>> points;  // by the image's canonical path
  // Empty if the image has no line. Throws InputError for another number of points.
  [[nodiscard]] std::optional<Eigen::Matrix2Xd> find(const std::string& image, int count) const;
};
// Throws InputError that names file and line.
[[nodiscard]] FaceLines read_face_lines(const std::string& path);

}  // namespace tarsier::face::landmarks
