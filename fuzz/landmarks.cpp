// SPDX-License-Identifier: MIT
// Models that find and fit landmarks. Each parsed model is also used once, on a small image.
#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/detect/anchor_detector.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/face/landmarks/model.h"

#include <opencv2/core.hpp>

#include "fuzz.h"

namespace tarsier::fuzz {
namespace {

cv::Mat image() {
  cv::Mat gray(96, 96, CV_8UC1);
  for (int y = 0; y < gray.rows; ++y)
    for (int x = 0; x < gray.cols; ++x)
      gray.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>((x * x + 3 * y + x * y / 7) & 0xff);
  return gray;
}

}  // namespace

TARSIER_FUZZ_TARGET(landmark_model, kJson) {
  const face::landmarks::LandmarkModel model =
      face::landmarks::read_landmark_model(file_of(input, "model.json"));
  model.check();
  if (model.points() > 100) return;
  const cv::Mat gray = image();
  const Eigen::Matrix2Xd start = (model.shape.mean * 25).array() + 48;
  for (const auto method :
       {face::landmarks::FitMethod::kTrees, face::landmarks::FitMethod::kDescent,
        face::landmarks::FitMethod::kPatches}) {
    if (!model.has(method)) continue;
    face::landmarks::FitWorkspace workspace;
    face::landmarks::FitOptions options;
    options.method = method;
    options.patches.iterations = 2;
    (void)face::landmarks::fit_points(model, options, gray, start, workspace);
  }
  (void)face::landmarks::start_in_box(model.box, model.shape.mean, {20, 20, 50, 50});
}

TARSIER_FUZZ_TARGET(hog_detector, kJson) {
  const face::landmarks::HogDetector model =
      face::landmarks::read_hog_detector(file_of(input, "model.json"));
  model.check();
  face::landmarks::FaceFinder finder(model, {});
  (void)finder.find(image());
}

TARSIER_FUZZ_TARGET(face_networks, kJson) {
  const face::FaceNetworks networks = face::read_face_networks(file_of(input, "model.json"));
  face::FaceSearchWorkspace workspace;
  (void)face::search_faces(image(), networks, {.min_face = 16, .max_candidates = 20}, workspace);
}

TARSIER_FUZZ_TARGET(anchor_detector, kJson) {
  const face::AnchorDetector detector =
      face::read_anchor_detector(file_of(input, "face-anchors.json"));
  face::AnchorWorkspace workspace;
  face::AnchorSearchOptions options;
  options.side = 96;
  (void)face::search_anchors(image(), detector, options, workspace);
}

TARSIER_FUZZ_TARGET(face_lines, kJson) {
  const face::landmarks::FaceLines lines =
      face::landmarks::read_face_lines(file_of(input, "faces.jsonl"));
  (void)lines.find(scratch_folder() + "/a.png", 5);
}

TARSIER_FUZZ_TARGET(appearance_model, kJson) {
  const face::appearance::AppearanceModel model =
      face::appearance::read_appearance_model(file_of(input, "model.json"));
  model.check();
  if (model.points() > 100) return;
  const Eigen::Matrix2Xd start = (model.shape.mean * 25).array() + 48;
  for (const face::appearance::Texture& texture : model.levels) {
    if (texture.size() > 100'000 || texture.mode_count() > 50) return;
    (void)face::appearance::fit_texture(model, texture, texture.modes(), image(), start);
  }
}

}  // namespace tarsier::fuzz
