// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::sfm {

// What a camera wrote about an image (Exif 2.32, CIPA DC-008), where it did; 0: not known.
struct Exif {
  double focal_mm = 0;                 // FocalLength
  double focal_35mm = 0;               // FocalLengthIn35mmFilm: mm, on video 36 mm wide
  double focal_plane_px_per_mm = 0;    // FocalPlaneXResolution, of the image as it was taken
  cv::Size taken_px;                   // PixelXDimension, PixelYDimension; 0x0: not known
  int orientation = 1;                 // 1..8; 5..8: the image is turned by a quarter
  std::optional<Eigen::Vector3d> gps;  // latitude deg, longitude deg, altitude m (0: not known)
  std::string camera;                  // make and model, printable ASCII; empty: not known
};

// Reads it from the bytes of a JPEG file (the start of the file is enough: the segments before the
// image). Never throws and never reads outside the bytes: what is missing, cut short, broken or
// impossible is left at its default. A position that the receiver marked as void (GPSStatus V),
// that lacks its hemisphere, or that is exactly 0 N 0 E, as receivers without a fix write it, is
// none.
[[nodiscard]] Exif parse_exif(std::string_view jpeg_bytes);

// Focal length in px of an image of that size, which may have been made smaller and turned since
// it was taken; 0: not known. focal_35mm / 36 * the larger side (the convention of cameras; the
// standard's one by the diagonal differs for 4:3 by 4 %), else focal_mm * focal_plane_px_per_mm,
// times larger side / larger side of taken_px. Needs no sensor data base, thus is 0 where the
// camera gave the focal length alone. Values outside 0.1 .. 20 larger sides are taken as not known.
// Throws std::invalid_argument for an empty size.
[[nodiscard]] double focal_px_of(const Exif& exif, cv::Size size);

// Positions in metres, x east, y north, z up, around their mean (which is the origin): latitude,
// longitude, altitude on the ellipsoid WGS84 to earth-centred coordinates, and from there into the
// tangential frame of the mean. Right over the date line and the poles too. Altitudes above sea
// level are taken as above the ellipsoid: the difference is the same for neighbours. Throws
// std::invalid_argument unless all are finite, |latitude| <= 90 and |longitude| <= 360 deg.
[[nodiscard]] std::vector<Eigen::Vector3d> local_metres(const std::vector<Eigen::Vector3d>& gps);

}  // namespace tarsier::sfm
