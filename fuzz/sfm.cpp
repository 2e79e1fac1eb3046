// SPDX-License-Identifier: MIT
// Reconstructions, what is known of images, and targets.
#include "tarsier/planar/image_targets/detect.h"
#include "tarsier/planar/image_targets/target_io.h"
#include "tarsier/sfm/mapper/evaluation.h"
#include "tarsier/sfm/mapper/pairs.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/exif.h"

#include "fuzz.h"
#include <cmath>

namespace tarsier::fuzz {

using namespace tarsier::sfm;

TARSIER_FUZZ_TARGET(colmap, kBytes) {
  const auto parts = parts_of(input, 3);
  file_of(parts[0], "cameras.txt");
  file_of(parts[1], "images.txt");
  file_of(parts[2], "points3D.txt");
  const Model model = read_colmap(scratch_folder());
  const std::string copy = scratch_folder() + "/copy";
  write_colmap(copy, model);
  expect(read_colmap(copy).points.size() == model.points.size(), "points change when written");
}

TARSIER_FUZZ_TARGET(exif, kBytes) {
  const Exif exif = parse_exif(text_of(input));
  expect(exif.orientation >= 1 && exif.orientation <= 8, "an orientation that is none");
  const double focal = focal_px_of(exif, {640, 480});
  expect(focal == 0 || (focal >= 64 && focal <= 12'800), "a focal length out of range");
  if (exif.gps) (void)local_metres({*exif.gps, *exif.gps});
  for (const char c : exif.camera) expect(c >= 0x20 && c < 0x7f, "a name that is not printable");
}

TARSIER_FUZZ_TARGET(positions_csv, kBytes) {
  (void)read_positions_csv(file_of(input, "positions.csv"));
}

TARSIER_FUZZ_TARGET(pairs_list, kBytes) {
  const std::vector<std::string> names{"a.jpg", "b.jpg", "c d.jpg", "d.jpg", "c"};
  for (const auto& [first, second] : read_pairs_list(file_of(input, "pairs.txt"), names))
    expect(first >= 0 && first < second && second < 5, "a pair of other images");
}

TARSIER_FUZZ_TARGET(pose_truth, kJson) { (void)read_pose_truth(file_of(input, "truth.jsonl")); }

TARSIER_FUZZ_TARGET(target, kJson) {
  const planar::image_targets::Target read =
      planar::image_targets::read_target(file_of(input, "model.json"));
  (void)planar::image_targets::detect_targets({read}, read.gray);
}

}  // namespace tarsier::fuzz
