// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/annotator_match.h"

#include "tarsier/core/statistics.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/media/lazy_opencv.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::face::proposals {
namespace {

using Eigen::Matrix2Xd;
using Eigen::Vector2d;

cv::Mat matrix_of(const shape::Similarity2d& s) {
  return (cv::Mat_<double>(2, 3) << s.a, -s.b, s.tx, s.b, s.a, s.ty);
}

// An image in the frame of its shape. The mean shape is upright, its size is `px` pixels, and the
// window extends `half` pixels from its centre.
struct ShapeFramePatch {
  cv::Mat gray;
  Matrix2Xd points;
  shape::Similarity2d frame_from_image;
};

ShapeFramePatch warp_to_shape_frame(const cv::Mat& gray, const Matrix2Xd& points,
                                    const Matrix2Xd& mean, double px, int half) {
  const shape::Similarity2d place{px, 0, static_cast<double>(half), static_cast<double>(half)};
  ShapeFramePatch result;
  result.frame_from_image = place * shape::fit_similarity(points, mean);
  const double shrink = result.frame_from_image.scale();
  cv::Mat blurred;  // never `gray` itself: its pixels belong to the caller
  // Downsampling: blur first to avoid aliasing.
  if (shrink < 0.7) {
    const double sigma = 0.4 * std::sqrt(1 / (shrink * shrink) - 1);
    cv::GaussianBlur(gray, blurred, {}, sigma);
  }
  const int side = 2 * half + 1;
  cv::warpAffine(blurred.empty() ? gray : blurred, result.gray, matrix_of(result.frame_from_image),
                 {side, side}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  result.gray.convertTo(result.gray, CV_32F);
  result.points = result.frame_from_image(points);
  return result;
}

cv::Mat window(const cv::Mat& gray, const Vector2d& at, int side) {
  cv::Mat result;
  cv::getRectSubPix(gray, {side, side}, {static_cast<float>(at.x()), static_cast<float>(at.y())},
                    result);
  return result;
}

// Offset of a parabola's peak from the middle of three values.
double peak_offset(double before, double middle, double after) {
  const double bend = before - 2 * middle + after;
  return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
}

Matrix2Xd centred_mean(const std::vector<regression::TrainingFace>& faces) {
  // The first face can serve as the reference frame, because images are only compared.
  Matrix2Xd sum = Matrix2Xd::Zero(2, faces[0].points.cols());
  for (const regression::TrainingFace& face : faces)
    sum += shape::fit_similarity(face.points, faces[0].points)(face.points);
  sum.colwise() -= Vector2d(sum.rowwise().mean());
  return sum / regression::shape_size(sum);
}

}  // namespace

std::optional<Matrix2Xd> transfer_by_flow(const cv::Mat& from, const Matrix2Xd& points,
                                          const cv::Mat& to) {
  constexpr double kMaxRoundTripError_px = 1.5;
  std::vector<cv::Point2f> start;
  std::vector<int> index;
  for (Eigen::Index i = 0; i < points.cols(); ++i) {
    if (points.col(i).hasNaN()) continue;
    start.emplace_back(static_cast<float>(points(0, i)), static_cast<float>(points(1, i)));
    index.push_back(static_cast<int>(i));
  }
  if (start.empty()) return std::nullopt;
  const cv::Size side(21, 21);
  const cv::TermCriteria criteria(cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 30, 0.01);
  std::vector<cv::Point2f> end;
  std::vector<cv::Point2f> back;
  std::vector<std::uint8_t> forward_status;
  std::vector<std::uint8_t> backward_status;
  std::vector<float> error;
  lazy_opencv::optical_flow_pyr_lk(from, to, start, end, forward_status, error, side, 4, criteria);
  lazy_opencv::optical_flow_pyr_lk(to, from, end, back, backward_status, error, side, 4, criteria);
  Matrix2Xd tracked = Matrix2Xd::Constant(2, points.cols(), std::nan(""));
  int tracked_count = 0;
  for (std::size_t k = 0; k < start.size(); ++k) {
    if (forward_status[k] == 0 || backward_status[k] == 0 ||
        cv::norm(back[k] - start[k]) > kMaxRoundTripError_px)
      continue;
    tracked.col(index[k]) << static_cast<double>(end[k].x), static_cast<double>(end[k].y);
    ++tracked_count;
  }
  // The images show different things: the flow is not reliable.
  if (tracked_count < std::max<int>(1, static_cast<int>(start.size()) / 2)) return std::nullopt;
  if (tracked_count < 3) {
    // One or two points determine only a shift.
    Vector2d shift = Vector2d::Zero();
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      if (!tracked.col(i).hasNaN()) shift += (tracked.col(i) - points.col(i)) / tracked_count;
    Matrix2Xd result = points.colwise() + shift;
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      if (!tracked.col(i).hasNaN()) result.col(i) = tracked.col(i);
    return result;
  }
  // Reweighted fits exclude points that moved differently from the others.
  Eigen::VectorXd weights = Eigen::VectorXd::Ones(points.cols());
  shape::Similarity2d motion;
  for (int round = 0; round < 6; ++round) {
    motion = shape::fit_similarity(points, tracked, weights);
    const Matrix2Xd residuals = motion(points) - tracked;
    std::vector<double> lengths;
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      if (!residuals.col(i).hasNaN()) lengths.push_back(residuals.col(i).norm());
    const double spread = std::max(1.0, 1.5 * upper_median(lengths));
    for (Eigen::Index i = 0; i < points.cols(); ++i)
      weights[i] =
          residuals.col(i).hasNaN() ? 0 : 1 / (1 + std::pow(residuals.col(i).norm() / spread, 2));
  }
  Matrix2Xd result = motion(points);
  for (Eigen::Index i = 0; i < points.cols(); ++i)
    if (!tracked.col(i).hasNaN() && weights[i] > 0.05) result.col(i) = tracked.col(i);
  return result;
}

std::optional<Matrix2Xd> match_mean_image(const std::vector<regression::TrainingFace>& faces,
                                          const Matrix2Xd& mean, const cv::Mat& gray,
                                          const Matrix2Xd& last) {
  if (faces.empty()) return std::nullopt;
  constexpr double kTemplateSize_px = 14;  // px of the template per size of the mean: coarse
  constexpr double kMargin = 0.25;         // sizes around the mean
  const double reach = mean.cwiseAbs().maxCoeff() + kMargin;
  const int half = static_cast<int>(std::ceil(reach * kTemplateSize_px));
  cv::Mat sum;
  for (const regression::TrainingFace& face : faces) {
    cv::Mat one = warp_to_shape_frame(face.gray, face.points, mean, kTemplateSize_px, half).gray;
    cv::Scalar mean_level;
    cv::Scalar deviation;
    cv::meanStdDev(one, mean_level, deviation);
    one = (one - mean_level[0]) / std::max(1.0, deviation[0]);
    if (sum.empty()) {
      sum = one;
    } else {
      sum += one;
    }
  }
  std::vector<double> sizes;  // px of the images
  for (const regression::TrainingFace& face : faces)
    sizes.push_back(regression::shape_size(face.points) * face.scale);
  Matrix2Xd known(2, 0);
  for (Eigen::Index i = 0; i < last.cols(); ++i) {
    if (last.col(i).hasNaN()) continue;
    known.conservativeResize(2, known.cols() + 1);
    known.rightCols(1) = last.col(i);
  }
  sizes.push_back(upper_median(sizes));
  const double min_size = *std::min_element(sizes.begin(), sizes.end()) / 1.15;
  const double max_size = *std::max_element(sizes.begin(), sizes.end()) * 1.15;
  double best = -2;
  std::optional<Matrix2Xd> result;
  for (double size = min_size; size <= max_size * 1.0001; size *= 1.08) {
    const double scale = kTemplateSize_px / size;
    cv::Mat small;
    cv::resize(gray, small, {}, scale, scale, scale < 1 ? cv::INTER_AREA : cv::INTER_LINEAR);
    // The object may be half outside the image.
    cv::copyMakeBorder(small, small, half, half, half, half, cv::BORDER_REPLICATE);
    small.convertTo(small, CV_32F);
    if (small.rows < sum.rows || small.cols < sum.cols) continue;
    cv::Mat match;
    cv::matchTemplate(small, sum, match, cv::TM_CCOEFF_NORMED);
    double value = 0;
    cv::Point at;
    cv::minMaxLoc(match, nullptr, &value, nullptr, &at);
    if (value <= best) continue;
    best = value;
    // Convert the template's centre (half + half in the padded image) back to the image.
    const double sx = static_cast<double>(small.cols - 2 * half) / gray.cols;
    const double sy = static_cast<double>(small.rows - 2 * half) / gray.rows;
    const Vector2d center((at.x + 0.5) / sx - 0.5, (at.y + 0.5) / sy - 0.5);
    result = (mean * size).colwise() + center;
  }
  return result;
}

Matrix2Xd refine(const std::vector<regression::TrainingFace>& faces, const cv::Mat& gray,
                 const Matrix2Xd& points) {
  if (faces.empty() || regression::shape_size(points) < 2) return points;
  constexpr double kMaxDisplacement = 0.10;    // sizes, max displacement of a point
  constexpr double kWindow = 0.22;             // sizes, half a window
  constexpr std::size_t kMaxSimilarFaces = 5;  // number of most similar faces used
  // A displacement costs (move / kDisplacementScale)^2 / 2 * kDisplacementCost of correlation.
  constexpr double kDisplacementScale = 0.06;  // sizes
  constexpr double kDisplacementCost = 0.12;   // of sqrt(2) kDisplacementScale
  std::vector<double> sizes;
  for (const regression::TrainingFace& face : faces)
    sizes.push_back(regression::shape_size(face.points));
  const double px =
      std::clamp(std::min(upper_median(sizes), regression::shape_size(points)), 12.0, 60.0);
  const Matrix2Xd mean = centred_mean(faces);
  const double extent = mean.cwiseAbs().maxCoeff() + kWindow + kMaxDisplacement + 0.6;
  const int half = static_cast<int>(std::ceil(extent * px));
  const int patch = 2 * static_cast<int>(std::lround(kWindow * px)) + 1;
  const int reach = std::max(1, static_cast<int>(std::lround(kMaxDisplacement * px)));
  const ShapeFramePatch current = warp_to_shape_frame(gray, points, mean, px, half);
  const auto n = static_cast<std::size_t>(points.cols());

  // Responses of each face's windows around where the point is now.
  std::vector<cv::Mat> areas;
  for (std::size_t i = 0; i < n; ++i)
    areas.push_back(
        window(current.gray, current.points.col(static_cast<Eigen::Index>(i)), patch + 2 * reach));
  std::vector<std::vector<cv::Mat>> responses(faces.size());
  std::vector<std::pair<double, std::size_t>> ranked_faces;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const ShapeFramePatch example =
        warp_to_shape_frame(faces[f].gray, faces[f].points, mean, px, half);
    double total = 0;
    for (std::size_t i = 0; i < n; ++i) {
      const cv::Mat model =
          window(example.gray, example.points.col(static_cast<Eigen::Index>(i)), patch);
      cv::Mat match;
      cv::matchTemplate(areas[i], model, match, cv::TM_CCOEFF_NORMED);
      cv::patchNaNs(match, 0);
      cv::min(match, 1.0, match);
      cv::max(match, -1.0, match);
      double best = 0;
      cv::minMaxLoc(match, nullptr, &best);
      total += best;
      responses[f].push_back(std::move(match));
    }
    ranked_faces.emplace_back(-total / static_cast<double>(n), f);
  }
  std::sort(ranked_faces.begin(), ranked_faces.end());
  const std::size_t used = std::min(kMaxSimilarFaces, ranked_faces.size());

  Matrix2Xd moved = current.points;
  for (std::size_t i = 0; i < n; ++i) {
    cv::Mat sum = cv::Mat::zeros(2 * reach + 1, 2 * reach + 1, CV_32F);
    for (std::size_t k = 0; k < used; ++k) {
      const double weight = std::exp(-(ranked_faces[k].first - ranked_faces[0].first) / 0.03);
      sum += weight * responses[ranked_faces[k].second][i];
    }
    double weights = 0;
    for (std::size_t k = 0; k < used; ++k)
      weights += std::exp(-(ranked_faces[k].first - ranked_faces[0].first) / 0.03);
    sum /= weights;
    for (int y = -reach; y <= reach; ++y) {
      for (int x = -reach; x <= reach; ++x) {
        sum.at<float>(y + reach, x + reach) -=
            static_cast<float>(kDisplacementCost * 0.5 * (x * x + y * y) /
                               (kDisplacementScale * px * kDisplacementScale * px));
      }
    }
    cv::Point at;
    cv::minMaxLoc(sum, nullptr, nullptr, nullptr, &at);
    Vector2d step(at.x - reach, at.y - reach);
    if (at.x > 0 && at.x < 2 * reach)
      step.x() += peak_offset(sum.at<float>(at.y, at.x - 1), sum.at<float>(at),
                              sum.at<float>(at.y, at.x + 1));
    if (at.y > 0 && at.y < 2 * reach)
      step.y() += peak_offset(sum.at<float>(at.y - 1, at.x), sum.at<float>(at),
                              sum.at<float>(at.y + 1, at.x));
    moved.col(static_cast<Eigen::Index>(i)) += step;
  }
  return current.frame_from_image.inverse()(moved);
}

}  // namespace tarsier::face::proposals
