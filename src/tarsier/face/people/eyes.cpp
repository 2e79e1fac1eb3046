// SPDX-License-Identifier: MIT
#include "tarsier/face/people/eyes.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/face/detect/cascade.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>
#include <opencv2/objdetect.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::face::people {
namespace {

constexpr NameTable<EyeMethod, 3> kMethods{"way to find eyes",
                                           {{
                                               {EyeMethod::kLandmarks, "landmarks"},
                                               {EyeMethod::kCascades, "cascades"},
                                               {EyeMethod::kSplits, "2splits"},
                                           }}};
// Smallest eye, share of the region's width.
constexpr double kMinEyeWidth = 0.3;

cv::Rect region_of(const EyeRegion& region, const cv::Rect& face, bool right) {
  const double x = right ? 1 - region.x - region.width : region.x;
  return {cvRound(face.x + x * face.width), cvRound(face.y + region.y * face.height),
          cvRound(region.width * face.width), cvRound(region.height * face.height)};
}

std::optional<cv::Point2d> find_eye(Cascade& cascade, const cv::Mat& gray, const cv::Rect& region) {
  const cv::Rect area = region & cv::Rect(0, 0, gray.cols, gray.rows);
  if (area.width < 8 || area.height < 8) return std::nullopt;
  cv::Mat part;
  cv::equalizeHist(gray(area), part);
  // Cascades cannot detect below their window size, so small faces are enlarged.
  const cv::Size own = cascade.window();
  const double zoom = std::max(1.0, own.width / (kMinEyeWidth * area.width));
  if (zoom > 1) cv::resize(part, part, {}, zoom, zoom, cv::INTER_LINEAR);
  const int min_width = std::max(own.width, cvRound(kMinEyeWidth * part.cols));
  const std::vector<cv::Rect> found =
      cascade.detect(part, {.min = {min_width, min_width * own.height / std::max(1, own.width)}});
  if (found.empty()) return std::nullopt;
  const cv::Rect& box =
      *std::max_element(found.begin(), found.end(),
                        [](const cv::Rect& a, const cv::Rect& b) { return a.area() < b.area(); });
  return cv::Point2d(area.x + (box.x + box.width / 2.0) / zoom - 0.5,
                     area.y + (box.y + box.height / 2.0) / zoom - 0.5);
}

}  // namespace

double Eyes::distance() const { return std::hypot(right.x - left.x, right.y - left.y); }

std::string_view name_of(EyeMethod method) { return kMethods.name(method); }

EyeMethod parse_eye_method(std::string_view name) { return kMethods.parse(name); }

EyeRegion eye_region(EyeMethod method) {
  TARSIER_REQUIRE(method != EyeMethod::kLandmarks, "landmarks have no regions");
  if (method == EyeMethod::kCascades) return {0.16, 0.26, 0.30, 0.28};
  return {0.12, 0.17, 0.37, 0.36};
}

struct EyeDetector::Impl {
  EyeRegion region{};
  // Tried in this order, for the left and the right eye in the image.
  std::vector<Cascade> left;
  std::vector<Cascade> right;

  static std::optional<cv::Point2d> first(std::vector<Cascade>& cascades, const cv::Mat& gray,
                                          const cv::Rect& area) {
    for (Cascade& cascade : cascades)
      if (const auto eye = find_eye(cascade, gray, area)) return eye;
    return std::nullopt;
  }
};

EyeDetector::EyeDetector(EyeMethod method) : impl_(std::make_unique<Impl>()) {
  impl_->region = eye_region(method);
  if (method == EyeMethod::kCascades) {
    for (const char* name : {"haarcascade_eye.xml", "haarcascade_eye_tree_eyeglasses.xml"}) {
      impl_->left.emplace_back(name);
      impl_->right.emplace_back(name);
    }
  } else {
    // These files are named after the person's own sides.
    impl_->left.emplace_back("haarcascade_righteye_2splits.xml");
    impl_->right.emplace_back("haarcascade_lefteye_2splits.xml");
  }
}
EyeDetector::~EyeDetector() = default;
EyeDetector::EyeDetector(EyeDetector&&) noexcept = default;
EyeDetector& EyeDetector::operator=(EyeDetector&&) noexcept = default;

std::optional<Eyes> EyeDetector::find(const cv::Mat& gray, const cv::Rect& face) {
  require_gray(gray);
  const auto left = Impl::first(impl_->left, gray, region_of(impl_->region, face, false));
  if (!left) return std::nullopt;
  const auto right = Impl::first(impl_->right, gray, region_of(impl_->region, face, true));
  if (!right) return std::nullopt;
  const Eyes eyes{*left, *right};
  // Such a pair is impossible in a face: one of them is an eyebrow or a nostril.
  const double slope = std::abs(right->y - left->y) / std::max(1e-9, right->x - left->x);
  if (right->x <= left->x || slope > 0.7 || eyes.distance() < 0.2 * face.width) return std::nullopt;
  return eyes;
}

cv::Mat crop_face(const cv::Mat& gray, const Eyes& eyes, const CropOptions& options) {
  require_gray(gray);
  options.check();
  for (const double value : {eyes.left.x, eyes.left.y, eyes.right.x, eyes.right.y})
    TARSIER_REQUIRE(std::isfinite(value) && std::abs(value) < 1e6, "an eye at {}", value);
  const double distance = eyes.distance();
  TARSIER_REQUIRE(distance >= 1, "eyes {} px apart", distance);
  using Complex = std::complex<double>;
  const Complex from_left(eyes.left.x, eyes.left.y);
  const Complex from_right(eyes.right.x, eyes.right.y);
  const double to_left = options.eye_x * options.size.width - 0.5;
  const double to_right = (1 - options.eye_x) * options.size.width - 0.5;
  const double to_y = options.eye_y * options.size.height - 0.5;
  const Complex turn = (to_right - to_left) / (from_right - from_left);
  const Complex shift = Complex(to_left, to_y) - turn * from_left;
  const cv::Mat map = (cv::Mat_<double>(2, 3) << turn.real(), -turn.imag(), shift.real(),
                       turn.imag(), turn.real(), shift.imag());
  const double scale = std::abs(turn);
  cv::Mat source = gray;
  if (scale < 0.6) {  // avoid aliasing
    cv::GaussianBlur(gray, source, {}, 0.4 / scale);
  }
  cv::Mat out;
  cv::warpAffine(source, out, map, options.size, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return out;
}

Eyes eyes_from_landmarks(const Eigen::Matrix2Xd& points) {
  TARSIER_REQUIRE(points.cols() == 68 && points.allFinite(), "{} points", points.cols());
  using Complex = std::complex<double>;
  const auto mean = [&](int first, int count) {
    const Eigen::Vector2d m = points.middleCols(first, count).rowwise().mean();
    return Complex(m.x(), m.y());
  };
  // Positions in the mean upright face (faces68), in units of the distance between the eye centres,
  // with the origin midway between them. For the mouth, the upper lip is used, because the lower
  // one moves when speaking.
  struct Anchor {
    Complex in_image;
    Complex in_face;
    double weight;
  };
  const Anchor anchors[] = {{mean(36, 6), {-0.5, 0}, 2},
                            {mean(42, 6), {0.5, 0}, 2},
                            {mean(31, 5), {0, 0.70}, 1},
                            {mean(50, 3), {0, 0.93}, 1}};
  double weight = 0;
  Complex center_in_image;
  Complex center_in_face;
  for (const Anchor& a : anchors) {
    weight += a.weight;
    center_in_image += a.weight * a.in_image;
    center_in_face += a.weight * a.in_face;
  }
  center_in_image /= weight;
  center_in_face /= weight;
  Complex numerator;
  double denominator = 0;
  for (const Anchor& a : anchors) {
    numerator += a.weight * std::conj(a.in_face - center_in_face) * (a.in_image - center_in_image);
    denominator += a.weight * std::norm(a.in_face - center_in_face);
  }
  const Complex turn = numerator / denominator;
  const Complex left = center_in_image + turn * (Complex(-0.5, 0) - center_in_face);
  const Complex right = center_in_image + turn * (Complex(0.5, 0) - center_in_face);
  return {{left.real(), left.imag()}, {right.real(), right.imag()}};
}

}  // namespace tarsier::face::people
