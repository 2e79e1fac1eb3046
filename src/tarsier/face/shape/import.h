// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include <string>
#include <vector>

// Readers of other programs' annotations. All take untrusted files: sizes are limited, every number
// is checked, and an error (InputError) names the file and the line. Image paths come out so that
// they can be opened from the current folder.
namespace tarsier::face::shape {

// 300-W and others: "version: 1 / n_points: 68 / { x y ... }". `offset` is subtracted (1: the file
// counts from 1, as Matlab does; 0: from 0).
[[nodiscard]] Eigen::Matrix2Xd read_pts(const std::string& path, double offset);

// IMM (Stegmann): columns path type x y point from to; x, y relative to width and height.
// Connections come from the columns "from" and "to".
struct AsfShape {
  Eigen::Matrix2Xd relative;  // 0..1
  std::vector<std::array<int, 2>> connections;
  std::string image;  // as named in the last line
};
[[nodiscard]] AsfShape read_asf(const std::string& path);

enum class ImportFormat { kAuto, kPts, kAsf, kMuct, kDlib };

struct ImportOptions {
  ImportFormat format = ImportFormat::kAuto;  // by ending
  double pts_offset = 0;
  // Folder of the images, where it is not that of the annotations (MUCT).
  std::string images;
};

// INPUT is a folder of annotation files, a list (.txt: an image path a line, its annotation beside
// it), one .pts or .asf file, a MUCT .csv (76 points; 0,0 is missing) or a dlib .xml (each box with
// parts is a sample). The image of an annotation is the file of the same name that exists as
// .jpg, .jpeg, .png, .bmp, .pgm or .ppm. What has no image is left out and named in `skipped`.
// A folder without .pts and .asf files is looked through for .xml, then .csv files. The person of a
// sample: MUCT and IMM have it in the name (the digits before "-" or "_" of IMM names, "i000" of
// MUCT's), else "". Mirror and connections come from known_markup where the file
// does not give them. Throws InputError where nothing is left.
struct Imported {
  LandmarkSet set;
  std::vector<std::string> skipped;  // "path: reason"
};
[[nodiscard]] Imported import_landmarks(const std::string& input,
                                        const ImportOptions& options = {});

// An image and the boxes of the objects in it, for detectors.
struct BoxedImage {
  std::string image;                     // path, from the current folder
  std::vector<cv::Rect2d> boxes;         // px; none: the image shows no object
  std::vector<cv::Rect2d> ignored;       // px, neither objects nor anything else
  std::vector<Eigen::Matrix2Xd> shapes;  // of each box: its points (NaN: missing) or 2 x 0
};
struct BoxedImages {
  std::vector<BoxedImage> images;
  std::vector<std::string> skipped;  // "path: reason"
};

// All boxes of a dlib .xml file, with and without parts; boxes with ignore='1' apart. Throws
// InputError as import_landmarks does.
[[nodiscard]] BoxedImages read_dlib_boxes(const std::string& path,
                                          const ImportOptions& options = {});

// The same from landmarks: images are named once. The box of a shape is the square around the
// mean of its points whose side is `sides` times their root mean squared distance from it: of 68
// points of a face, from above the brows to the chin. It does not jump as the mouth opens. Samples
// whose points are not complete become ignored boxes where they have a box; where they have none,
// their image is left out.
[[nodiscard]] std::vector<BoxedImage> boxes_from_landmarks(const LandmarkSet& set,
                                                           double sides = 2.8);

}  // namespace tarsier::face::shape
