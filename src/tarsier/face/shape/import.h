// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>
#include <opencv2/core/types.hpp>

#include <string>
#include <vector>

// Readers of other programs' annotations. Files are untrusted: sizes are limited and every number
// is checked. Errors (InputError) name the file and the line. Image paths are returned relative to
// the current folder.
namespace tarsier::face::shape {

// 300-W and others: "version: 1 / n_points: 68 / { x y ... }". `offset` is subtracted from the
// coordinates (1 if the file counts from 1, as Matlab does; otherwise 0).
[[nodiscard]] Eigen::Matrix2Xd read_pts(const std::string& path, double offset);

// IMM (Stegmann): columns path type x y point from to. x, y are relative to width and height;
// "from" and "to" give the connections.
struct AsfShape {
  Eigen::Matrix2Xd relative;  // 0..1
  std::vector<std::array<int, 2>> connections;
  std::string image;  // as named in the last line
};
[[nodiscard]] AsfShape read_asf(const std::string& path);

enum class ImportFormat { kAuto, kPts, kAsf, kMuct, kDlib };

struct ImportOptions {
  ImportFormat format = ImportFormat::kAuto;  // by file extension
  double pts_offset = 0;
  // Folder of the images, if different from that of the annotations (MUCT).
  std::string images;
};

// INPUT is one of: a folder of annotation files, a list (.txt: one image path per line, its
// annotation in the same folder), one .pts or .asf file, a MUCT .csv (76 points; 0,0 is missing),
// or a dlib .xml (each box with parts is a sample). A folder without .pts and .asf files is
// searched for .xml, then for .csv files.
//
// The image of an annotation is the existing file of the same name with the extension .jpg, .jpeg,
// .png, .bmp, .pgm or .ppm. Annotations without an image are skipped and listed in `skipped`. The
// person of a sample comes from the names of MUCT and IMM (the digits before "-" or "_" of IMM
// names, "i000" of MUCT's), otherwise it is "". Mirror and connections come from known_markup if
// the file does not contain them. Throws InputError if no sample is left.
struct Imported {
  LandmarkSet set;
  std::vector<std::string> skipped;  // "path: reason"
};
[[nodiscard]] Imported import_landmarks(const std::string& input,
                                        const ImportOptions& options = {});

// An image and the boxes of its objects, for detectors.
struct BoxedImage {
  std::string image;                     // path, relative to the current folder
  std::vector<cv::Rect2d> boxes;         // px; empty: no object in the image
  std::vector<cv::Rect2d> ignored;       // px, regions that are neither objects nor background
  std::vector<Eigen::Matrix2Xd> shapes;  // for each box its points (NaN: missing) or 2 x 0
};
struct BoxedImages {
  std::vector<BoxedImage> images;
  std::vector<std::string> skipped;  // "path: reason"
};

// All boxes of a dlib .xml file, with and without parts; boxes with ignore='1' are returned
// separately. Throws InputError as import_landmarks does.
[[nodiscard]] BoxedImages read_dlib_boxes(const std::string& path,
                                          const ImportOptions& options = {});

// The same from landmarks, with one entry per image. The box of a shape is a square around the mean
// of its points; its side is `sides` times their root mean squared distance from the mean. For 68
// points of a face it extends from above the eyebrows to the chin, and is stable when the mouth
// opens. Incomplete samples become ignored boxes if they have a box; otherwise their image is
// skipped.
[[nodiscard]] std::vector<BoxedImage> boxes_from_landmarks(const LandmarkSet& set,
                                                           double sides = 2.8);

}  // namespace tarsier::face::shape
