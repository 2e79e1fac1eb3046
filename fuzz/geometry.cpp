// SPDX-License-Identifier: MIT
// Cameras, meshes and markers.
#include "tarsier/geometry/camera_file.h"
#include "tarsier/geometry/opencv_storage.h"
#include "tarsier/media/image_file.h"
#include "tarsier/planar/markers/board.h"
#include "tarsier/planar/markers/evaluation.h"
#include "tarsier/render/obj_io.h"

#include <opencv2/core.hpp>

#include "fuzz.h"
#include <cmath>

namespace tarsier::fuzz {

TARSIER_FUZZ_TARGET(camera_file, kBytes) {
  const std::string path = file_of(input, "camera.yaml");
  const geometry::Camera camera = geometry::read_camera_file(path);
  expect(std::isfinite(camera.fx) && camera.fx > 0 && camera.fy > 0, "a camera without focus");
  const std::string copy = scratch_folder() + "/copy.yaml";
  geometry::write_camera_file(copy, camera);
  const geometry::Camera back = geometry::read_camera_file(copy);
  expect(back.fx == camera.fx && back.cy == camera.cy && back.width == camera.width,
         "a camera changes when it is written");
  (void)geometry::read_camera_file(path, {.opencv_is_fisheye = true});
}

TARSIER_FUZZ_TARGET(marker_board, kBytes) {
  using planar::markers::MarkerBoard;
  const MarkerBoard board =
      planar::markers::parse_marker_board(std::string(text_of(input)), "board.json");
  const std::string copy = scratch_folder() + "/board.json";
  planar::markers::write_marker_board(copy, board);
  const MarkerBoard back = planar::markers::read_marker_board(copy);
  expect(back.markers.size() == board.markers.size() &&
             back.markers.front().center == board.markers.front().center,
         "a board changes when it is written");
}

TARSIER_FUZZ_TARGET(opencv_storage, kBytes) {
  (void)geometry::parse_opencv_storage(text_of(input), "camera.xml");
}

TARSIER_FUZZ_TARGET(obj, kBytes) {
  static const bool has_texture = [] {
    write_image(scratch_folder() + "/t.png", cv::Mat(4, 4, CV_8UC3, cv::Scalar(40, 90, 200)));
    return true;
  }();
  (void)has_texture;
  const auto parts = parts_of(input, 2);
  file_of(parts[1], "m.mtl");
  const render::ObjLimits limits{1'000'000, 20'000, 1'000'000, 4};
  const render::ObjFile file = render::read_obj(file_of(parts[0], "m.obj"), limits);
  file.mesh.check();
}

TARSIER_FUZZ_TARGET(marker_truth, kJson) {
  planar::markers::MarkerEvaluator evaluator;
  for (const planar::markers::MarkerTruth& truth :
       planar::markers::read_marker_truth(file_of(input, "truth.jsonl")))
    evaluator.add(truth, truth.markers, 1.0);
  (void)evaluator.score();
}

TARSIER_FUZZ_TARGET(marker_lines, kJson) {
  (void)planar::markers::read_detected_markers(file_of(input, "found.jsonl"));
}

}  // namespace tarsier::fuzz
