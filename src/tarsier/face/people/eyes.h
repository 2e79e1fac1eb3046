// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <memory>
#include <optional>
#include <string_view>

// Where the eyes of a face are, and the face cut out so that they always lie at the same place.
namespace tarsier::face::people {

// Centres, px of the image (centres of pixels at integers), left and right as seen.
struct Eyes {
  cv::Point2d left;
  cv::Point2d right;
  [[nodiscard]] double distance() const;  // px
};

enum class EyeMethod {
  kLandmarks,  // means of the points around each eye
  kCascades,   // haarcascade_eye, where it fails haarcascade_eye_tree_eyeglasses
  kSplits,     // haarcascade_lefteye_2splits and haarcascade_righteye_2splits
};
[[nodiscard]] std::string_view name_of(EyeMethod method);  // "landmarks", "cascades", "2splits"
[[nodiscard]] EyeMethod parse_eye_method(std::string_view name);  // throws std::invalid_argument

// Where in a face's box each detector looks, shares of its width and height; the right eye's region
// is the mirror image.
struct EyeRegion {
  double x, y, width, height;
};
[[nodiscard]] EyeRegion eye_region(EyeMethod method);  // not of kLandmarks

// Eyes by boosted cascades in a face's box, at full resolution. Not thread-safe.
class EyeDetector {
 public:
  // Throws ModelError where cascades are missing (Debian: opencv-data), std::invalid_argument for
  // kLandmarks.
  explicit EyeDetector(EyeMethod method);
  ~EyeDetector();
  EyeDetector(EyeDetector&&) noexcept;
  EyeDetector& operator=(EyeDetector&&) noexcept;
  // Nothing unless both are found. `gray`: CV_8UC1.
  [[nodiscard]] std::optional<Eyes> find(const cv::Mat& gray, const cv::Rect& face);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// The cut: rotation, scale and shift only.
struct CutOptions {
  cv::Size size{128, 160};  // px
  double eye_x = 0.27;      // of the left eye, share of the width; the right mirrored
  double eye_y = 0.34;      // share of the height

  [[nodiscard]] OptionFields fields() {
    return {{"size.width", size.width, range(32, 512)},
            {"size.height", size.height, range(32, 512)},
            {"eye_x", eye_x, inside(0, 0.5)},
            {"eye_y", eye_y, inside(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

// CV_8UC1 of options.size, as bright as it was; what is outside the image is its edge repeated.
// Throws std::invalid_argument for eyes that are less than a pixel apart or not finite.
[[nodiscard]] cv::Mat cut_face(const cv::Mat& gray, const Eyes& eyes,
                               const CutOptions& options = {});

// From 68 points (300-W order, 2 x 68, px): the centres of the eyes, as a least-squares similarity
// of eyes, nose and mouth puts them: a turned or tilted face keeps its scale, which the distance of
// the eyes alone does not.
[[nodiscard]] Eyes eyes_of_points(const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::people
