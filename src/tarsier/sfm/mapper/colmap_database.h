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

// COLMAP's database (https://colmap.github.io/database.html): cameras, images, their features with
// descriptors, and matches of image pairs. COLMAP's mapper can use features and matches of this
// library, and vice versa. Versions 3.x and 4.x are read; rigs, frames and pose priors are ignored.
// Version 3.8 is written: later ones add the missing tables when they open it, and take each camera
// for a rig. COLMAP places pixel centres at 0.5, this library at 0.
struct ColmapDatabase {
  struct DatabaseCamera {
    geometry::Camera camera;
    bool is_focal_known = false;
  };
  struct DatabaseImage {
    std::string name;
    int camera = 0;     // index into `cameras`
    Features features;  // without colours
  };
  struct DatabasePair {
    int first = 0;  // indices into `images`
    int second = 0;
    std::vector<Match> matches;  // verified ones, where they exist
    // For verified pairs that are written; of COLMAP's pairs, only matches are read.
    TwoView view;
  };
  std::vector<DatabaseCamera> cameras;
  std::vector<DatabaseImage> images;
  std::vector<DatabasePair> pairs;
};

// Writes a new database, completely or not at all; an existing file is replaced. Descriptors must
// be SIFT (128 bytes) or empty. The verified matches are written to both tables, `matches` and
// `two_view_geometries`. Throws OutputError; std::invalid_argument for indices out of range and
// repeated names.
void write_colmap_database(const std::string& path, const ColmapDatabase& database);

// Reads images sorted by name and pairs by image; for keypoints positions and sizes, and pairs with
// at least 1 match. Descriptors other than SIFT (COLMAP 4) are left out with a warning; their
// features have the matches of the database only. Throws InputError with the fault: missing tables,
// blobs whose size differs from rows and columns, numbers that are not finite, unknown ids, matches
// of non-existing features, a camera model that geometry/colmap_camera.h does not know.
[[nodiscard]] ColmapDatabase read_colmap_database(const std::string& path);

}  // namespace tarsier::sfm
