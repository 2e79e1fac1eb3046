// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::sfm {

// What a camera wrote about an image (Exif 2.32, CIPA DC-008). 0 means unknown.
struct Exif {
  double focal_mm = 0;                 // FocalLength
  double focal_35mm = 0;               // FocalLengthIn35mmFilm: mm, for an image 36 mm wide
  double focal_plane_px_per_mm = 0;    // FocalPlaneXResolution, for the image as taken
  cv::Size original_px;                // PixelXDimension, PixelYDimension; 0x0: unknown
  int orientation = 1;                 // 1..8; 5..8: turned by a quarter turn
  std::optional<Eigen::Vector3d> gps;  // latitude deg, longitude deg, altitude m (0: unknown)
  std::string camera;                  // make and model, printable ASCII; empty: unknown
};

// Reads EXIF from the bytes of a JPEG file. The start of the file suffices: the segments before the
// image data. Never throws and never reads outside the bytes. A missing, truncated, broken or
// impossible value keeps its default. A position is ignored where the receiver marked it void
// (GPSStatus V), where its hemisphere is missing, or where it is exactly 0 N 0 E, which receivers
// without a fix write.
[[nodiscard]] Exif parse_exif(std::string_view jpeg_bytes);

// Focal length in px of an image of this size, which may be a reduced or turned version of the
// image taken; 0: unknown. It is focal_35mm / 36 * the longer side (the convention of cameras; the
// standard's diagonal convention differs by 4 % for 4:3). Otherwise it is focal_mm *
// focal_plane_px_per_mm, times longer side / longer side of original_px. No sensor database is
// used, so the result is 0 where the camera gave only the focal length. Values outside 0.1 .. 20
// longer sides count as unknown. Throws std::invalid_argument for an empty size.
[[nodiscard]] double focal_px_of(const Exif& exif, cv::Size size);

// Positions in metres: x east, y north, z up, origin at their mean. Latitude, longitude and
// altitude on the WGS84 ellipsoid are converted to earth-centred coordinates and then to the
// tangent frame of the mean. Also correct across the date line and the poles. Altitudes above sea
// level are treated as above the ellipsoid, since the difference is the same for neighbours. Throws
// std::invalid_argument unless all are finite, |latitude| <= 90 and |longitude| <= 360 deg.
[[nodiscard]] std::vector<Eigen::Vector3d> local_metres(const std::vector<Eigen::Vector3d>& gps);

}  // namespace tarsier::sfm
