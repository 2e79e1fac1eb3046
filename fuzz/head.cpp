// SPDX-License-Identifier: MIT
// Head models, points and poses.
#include "tarsier/core/errors.h"
#include "tarsier/face/head/evaluation.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head/point_file.h"

#include "fuzz.h"

namespace tarsier::fuzz {

using namespace tarsier::face::head;

TARSIER_FUZZ_TARGET(head_model, kJson) {
  HeadModel model = read_head_model(file_of(input, "head.json"));
  model.check();
  if (model.points() > 100 || model.mode_count() > 30) return;
  (void)shape_of(model, Eigen::VectorXd::Ones(model.mode_count()));
  const HeadPoseEstimator estimator(std::move(model));
}

TARSIER_FUZZ_TARGET(head_points, kBytes) {
  const std::string path = file_of(input, "points.txt");
  for (const int dimensions : {2, 3}) {
    try {
      expect(read_point_file(path, dimensions).allFinite(), "points that are not finite");
    } catch (const Error&) {
    }
  }
  expect(read_landmarks3d(path).allFinite(), "points that are not finite");
}

TARSIER_FUZZ_TARGET(head_mapping, kBytes) {
  (void)read_landmark_mapping(file_of(input, "mapping.txt"), 25, 68);
}

TARSIER_FUZZ_TARGET(pose_lines, kJson) {
  const std::vector<PoseLine> lines = read_pose_lines(file_of(input, "poses.jsonl"));
  (void)score_poses(match_poses(lines, lines), static_cast<int>(lines.size()));
}

TARSIER_FUZZ_TARGET(pointing, kBytes) {
  (void)parse_pointing_name(std::string(text_of(input)));
  file_of(input, "p.txt");
  (void)pointing_box(scratch_folder() + "/p.jpg");
}

}  // namespace tarsier::fuzz
