// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/mapper/features.h"
#include "tarsier/sfm/mapper/matching.h"
#include "tarsier/sfm/mapper/two_view.h"

#include <span>
#include <string>
#include <vector>

namespace tarsier::sfm {

// COLMAP's database (https://colmap.github.io/database.html; versions 3.x): cameras, images, their
// features with descriptors, and what pairs of images have in common. So COLMAP's mapper goes on from our features
// and matches, and ours from COLMAP's. COLMAP's pixel middles lie at 0.5, ours at 0.
struct ColmapDatabase {
  struct DatabaseCamera {
    geometry::Camera camera;
    bool is_focal_known = false;
  };
  struct DatabaseImage {
    std::string name;
    int camera = 0;     // index into `cameras`
    Features features;  // no colours
  };
  struct DatabasePair {
    int first = 0;  // indices into `images`
    int second = 0;
    std::vector<Match> matches;  // verified ones where there are any
    // Of verified pairs that we wrote; of COLMAP's the matches alone are read.
    TwoView view;
  };
  std::vector<DatabaseCamera> cameras;
  std::vector<DatabaseImage> images;
  std::vector<DatabasePair> pairs;
};

// Writes a new database, whole or not at all; what is there under that name is replaced. Descriptors must be SIFT's
// (128 bytes) or none. The verified matches stand in both tables, `matches` and `two_view_geometries`.
// Throws OutputError; std::invalid_argument for indices out of range and names that are there twice.
void write_colmap_database(const std::string& path, const ColmapDatabase& database);

// Images by name, pairs by image. Of keypoints places and sizes are read, of pairs those with 1 match at least.
// Throws InputError that says what is wrong: no such tables, blobs of another size than rows and columns say, numbers
// that are not finite, ids that are unknown, matches of features that are not there, a camera model
// that geometry/colmap_camera.h does not know.
[[nodiscard]] ColmapDatabase read_colmap_database(const std::string& path);

}  // namespace tarsier::sfm
