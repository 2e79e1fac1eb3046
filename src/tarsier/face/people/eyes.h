// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <memory>
#include <optional>
#include <string_view>

// Finds the eyes of a face and crops the face with the eyes at fixed positions.
namespace tarsier::face::people {

// Centres of the eyes in the image, px (pixel centres at integers); left and right in the image.
struct Eyes {
  cv::Point2d left;
  cv::Point2d right;
  [[nodiscard]] double distance() const;  // px
};

enum class EyeMethod {
  kLandmarks,  // means of the landmarks around each eye
  kCascades,   // haarcascade_eye; if it fails, haarcascade_eye_tree_eyeglasses
  kSplits,     // haarcascade_lefteye_2splits and haarcascade_righteye_2splits
};
[[nodiscard]] std::string_view name_of(EyeMethod method);  // "landmarks", "cascades", "2splits"
[[nodiscard]] EyeMethod parse_eye_method(std::string_view name);  // throws std::invalid_argument

// The region of a face's bounding box that each detector searches, shares of its width and height.
// The right eye's region is the mirror image.
struct EyeRegion {
  double x, y, width, height;
};
[[nodiscard]] EyeRegion eye_region(EyeMethod method);  // not for kLandmarks

// Finds the eyes in a face's bounding box by boosted cascades, at full resolution. Not thread-safe.
class EyeDetector {
 public:
  // Throws ModelError if cascades are missing (Debian: opencv-data), std::invalid_argument for
  // kLandmarks.
  explicit EyeDetector(EyeMethod method);
  ~EyeDetector();
  EyeDetector(EyeDetector&&) noexcept;
  EyeDetector& operator=(EyeDetector&&) noexcept;
  // Empty unless both eyes are found. `gray`: CV_8UC1.
  [[nodiscard]] std::optional<Eyes> find(const cv::Mat& gray, const cv::Rect& face);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The crop is a similarity transform: rotation, scale and translation only.
struct CropOptions {
  cv::Size size{128, 160};  // px
  // Of the left eye, share of the width; the right eye is mirrored.
  double eye_x = 0.27;
  double eye_y = 0.34;  // share of the height

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(32, 512)},
            {"size.height", size.height, range(32, 512)},
            {"eye_x", eye_x, inside(0, 0.5)},
            {"eye_y", eye_y, inside(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// CV_8UC1 of options.size with unchanged brightness; outside the image, the border is replicated.
// Throws std::invalid_argument for eyes that are less than a pixel apart or not finite.
[[nodiscard]] cv::Mat crop_face(const cv::Mat& gray, const Eyes& eyes,
                                const CropOptions& options = {});

// The centres of the eyes from 68 points (300-W order, 2 x 68, px), by a least-squares similarity
// of eyes, nose and mouth. Turned or tilted faces keep their scale; with the eye distance alone
// they would not.
[[nodiscard]] Eyes eyes_from_landmarks(const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::people
