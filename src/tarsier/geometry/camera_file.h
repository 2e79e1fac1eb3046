// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <string>

namespace tarsier::geometry {

// Reads one camera from a file of up to 1 MB. The format is recognised by the content, not by the
// name:
// - Tarsier's camera.yaml (see write_camera_file);
// - YAML or XML of OpenCV's FileStorage: camera_matrix, Camera_Matrix, cameraMatrix or K;
//   distortion_coefficients, Distortion_Coefficients, distCoeffs or dist_coeffs (none, 4, 5 or 8
//   numbers, more only if they are 0; 4 for a fisheye, which is marked by "fisheye_model: 1", by
//   "distortion_model: equidistant" or fisheye, or by the options); image_width, image_height;
//   avg_reprojection_error;
// - COLMAP's cameras.txt with one camera (see colmap_camera.h); pixel centres at 0.5 are converted
//   to 0;
// - nine numbers: a calibration matrix, row by row.
// Width and height are 0 if the file does not state them. Throws InputError, which names the file
// and the fault: a missing or too large file, another format, missing or non-finite numbers, focal
// lengths that are not positive, skew.
struct CameraFileOptions {
  // The coefficients in OpenCV's file are those of cv::fisheye. Such a file may not state this.
  bool opencv_is_fisheye = false;
};
[[nodiscard]] Camera read_camera_file(const std::string& path,
                                      const CameraFileOptions& options = {});

enum class CameraFormat { kTarsier, kOpencv, kColmap };

// Writes plain YAML, atomically. Reading it restores the camera exactly:
//   model: pinhole                     # or rational, fisheye: see Lens
//   width: 3072                        # px; 0: not known
//   height: 2048
//   fx: 2759.4800000000000             # px; 17 digits
//   fy: 2764.1599999999999
//   cx: 1520.6900000000001             # px; the middle of the top left pixel is 0
//   cy: 1006.8099999999999
//   distortion: [0, 0, 0, 0, 0]        # 5, 8 or 4 numbers: see Lens
//   rms: 0                             # px, of the calibration; 0: not known
// width, height, distortion and rms are optional; other keys are not allowed. OpenCV's format is
// YAML of its FileStorage with the names of its calibration sample (camera_matrix,
// distortion_coefficients, image_width, ..., fisheye_model: 1 for a fisheye). COLMAP's format is a
// cameras.txt with camera 1, whose size must be known. Throws OutputError; std::invalid_argument
// for a camera that could not be read back.
void write_camera_file(const std::string& path, const Camera& camera,
                       CameraFormat format = CameraFormat::kTarsier);

// Parses a camera of the command line: "fx,fy,cx,cy[,k1,k2,p1,p2[,k3[,k4,k5,k6]]]". Width and
// height stay 0. Throws UsageError.
[[nodiscard]] Camera parse_camera(const std::string& text);

}  // namespace tarsier::geometry
