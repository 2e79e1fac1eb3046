// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/matching.h"
#include "tarsier/sfm/two_view/two_view.h"

#include <Eigen/Core>

#include <span>
#include <string>
#include <vector>

namespace tarsier::sfm {

// COLMAP's database (https://colmap.github.io/database.html): cameras, images, their features with
// descriptors, and matches of image pairs. COLMAP's mapper can use features and matches of this
// library, and vice versa. Versions 3.x and 4.x are read; rigs and frames are ignored.
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

// The camera position of an image in a database.
struct ColmapPosePrior {
  std::string name;      // of the image
  bool is_wgs84 = true;  // else any cartesian frame
  // WGS84: latitude deg, longitude deg, altitude m (0: unknown). Otherwise as it was written.
  Eigen::Vector3d position = Eigen::Vector3d::Zero();
};

// Reads the table `pose_priors`, sorted by image name; empty where there is no such table. Its
// forms in COLMAP's pull requests and its source (src/colmap/scene/database_sqlite.cc):
// - 2024 (#2620): image_id, position (3 doubles), coordinate_system (-1 undefined, 0 WGS84, 1
//   cartesian);
// - 3.11 to 3.13 (#2660): the same and position_covariance, which is not used here;
// - 4 (#3777): pose_prior_id, corr_data_id, corr_sensor_id, corr_sensor_type, position,
//   position_covariance, gravity, coordinate_system. For a camera (type 0), corr_data_id is the
//   image's id (#4547). Rows of other sensors are skipped.
// As in COLMAP, a prior may have no position (NULL or NaN), and an undefined coordinate system
// counts as cartesian, with a warning. WGS84's 0 N 0 E, which COLMAP's readers skip, is no position
// either. Priors with impossible positions or unknown coordinate systems are left out with a
// warning. Throws InputError as read_colmap_database(); also for positions of another size and for
// unknown images.
[[nodiscard]] std::vector<ColmapPosePrior> read_colmap_pose_priors(const std::string& path);

}  // namespace tarsier::sfm
