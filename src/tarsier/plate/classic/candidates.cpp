// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/candidates.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/classic/features.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::plate {
namespace {

constexpr int kPlainScale = 3;  // scale of ClassicCandidate::plain

double length(cv::Point2f v) { return std::hypot(v.x, v.y); }

bool has_plate_shape(const Quad& quad, const CandidateOptions& options) {
  const double width = length(quad[1] - quad[0]);
  const double height = length(quad[3] - quad[0]);
  if (height < options.min_height || height > options.max_height) return false;
  const double aspect = width / height;
  return aspect > options.aspect * (1 - options.aspect_error) &&
         aspect < options.aspect * (1 + options.aspect_error);
}

cv::Mat rectified(const cv::Mat& gray, const Quad& quad, cv::Size size) {
  const cv::Point2f to[3] = {{-0.5F, -0.5F},
                             {static_cast<float>(size.width) - 0.5F, -0.5F},
                             {-0.5F, static_cast<float>(size.height) - 0.5F}};
  const cv::Point2f from[3] = {quad[0], quad[1], quad[3]};
  cv::Mat result;
  cv::warpAffine(gray, result, cv::getAffineTransform(from, to), size, cv::INTER_LINEAR,
                 cv::BORDER_REPLICATE);
  return result;
}

// The first and last nonzero points of each row: they have the same convex hull as all nonzero
// points.
std::vector<cv::Point> row_ends(const cv::Mat& mask) {
  std::vector<cv::Point> ends;
  for (int y = 0; y < mask.rows; ++y) {
    const auto* row = mask.ptr<std::uint8_t>(y);
    const auto* const end = row + mask.cols;
    const auto* const first = std::find_if(row, end, [](std::uint8_t v) { return v != 0; });
    if (first == end) continue;
    int last = mask.cols - 1;
    while (row[last] == 0) --last;
    ends.emplace_back(static_cast<int>(first - row), y);
    ends.emplace_back(last, y);
  }
  return ends;
}

// The rotated box of the flood fill from white points around the centre; false if it is not a
// plate.
bool flooded_box(const cv::Mat& gray, const Quad& around, const CandidateOptions& options, Rng& rng,
                 Quad& box) {
  const cv::Point2f center = (around[0] + around[2]) * 0.5F;
  const double reach = std::min(length(around[1] - around[0]), length(around[3] - around[0])) / 2;
  // Fills only the neighbourhood: a mask of the whole image for each candidate would be slow.
  const int margin = static_cast<int>(length(around[1] - around[0]) * 0.8) + 4;
  const cv::Rect window =
      cv::Rect(cvRound(center.x) - margin, cvRound(center.y) - margin, 2 * margin, 2 * margin) &
      cv::Rect(0, 0, gray.cols, gray.rows);
  if (window.empty()) return false;
  cv::Mat part = gray(window);
  cv::Mat mask = cv::Mat::zeros(part.rows + 2, part.cols + 2, CV_8UC1);
  for (int i = 0; i < options.seeds; ++i) {
    const int y = cvRound(static_cast<double>(center.y) + rng.uniform(-reach, reach));
    const int x = cvRound(static_cast<double>(center.x) + rng.uniform(-reach, reach));
    const cv::Point seed = cv::Point(x, y) - window.tl();
    if (seed.x < 0 || seed.y < 0 || seed.x >= part.cols || seed.y >= part.rows) continue;
    if (mask.at<std::uint8_t>(seed.y + 1, seed.x + 1) != 0) continue;
    const cv::Scalar range(options.flood_range);
    cv::floodFill(part, mask, seed, cv::Scalar(255), nullptr, range, range,
                  4 | (255 << 8) | cv::FLOODFILL_FIXED_RANGE | cv::FLOODFILL_MASK_ONLY);
  }
  const cv::Mat flooded = mask(cv::Rect(1, 1, part.cols, part.rows));
  if (cv::countNonZero(flooded) < 20) return false;
  box = upright_corners(cv::minAreaRect(row_ends(flooded)));
  for (cv::Point2f& p : box) p += cv::Point2f(window.tl());
  return has_plate_shape(box, options);
}

}  // namespace

void CandidateOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_height < max_height, "heights {}..{}", min_height, max_height);
}

Quad upright_corners(const cv::RotatedRect& box) {
  Quad points;
  box.points(points.data());
  // The longer side becomes horizontal; the upper of the two long sides is the top.
  if (length(points[1] - points[0]) < length(points[2] - points[1]))
    std::rotate(points.begin(), points.begin() + 1, points.end());
  if (points[0].y + points[1].y > points[2].y + points[3].y)
    std::rotate(points.begin(), points.begin() + 2, points.end());
  if (points[0].x > points[1].x) {
    std::swap(points[0], points[1]);
    std::swap(points[2], points[3]);
  }
  return points;
}

std::vector<ClassicCandidate> find_candidates(const cv::Mat& gray, const CandidateOptions& options,
                                              Rng rng, DebugSink* debug) {
  options.check();
  TARSIER_REQUIRE(gray.type() == CV_8UC1 && !gray.empty(), "an image of type {}", gray.type());
  std::vector<ClassicCandidate> result;
  if (gray.cols < 20 || gray.rows < 20) return result;
  cv::Mat blurred;
  cv::blur(gray, blurred, {5, 5});
  cv::Mat edges;
  cv::Sobel(blurred, edges, CV_8U, 1, 0, 3);
  cv::Mat binary;
  cv::threshold(edges, binary, 0, 255, cv::THRESH_OTSU);
  cv::Mat closed;
  cv::morphologyEx(binary, closed, cv::MORPH_CLOSE,
                   cv::getStructuringElement(cv::MORPH_RECT, {17, 3}));
  if (debug != nullptr) {
    debug->image("blurred", blurred);
    debug->image("edges", edges);
    debug->image("threshold", binary);
    debug->image("closed", closed);
  }
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(closed, contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  cv::Mat overlay;
  if (debug != nullptr) cv::cvtColor(gray, overlay, cv::COLOR_GRAY2BGR);
  const auto outline = [&](const Quad& quad, const cv::Scalar& color) {
    const std::vector<cv::Point> points(quad.begin(), quad.end());
    cv::polylines(overlay, points, true, color, 1, cv::LINE_AA);
  };
  std::uint64_t number = 0;
  for (const std::vector<cv::Point>& contour : contours) {
    const Quad rough = upright_corners(cv::minAreaRect(contour));
    if (!has_plate_shape(rough, options)) continue;
    Rng own = rng.fork(++number);
    // The box of the edges and the flooded box are both candidates.
    std::vector<Quad> boxes{rough};
    Quad box;
    if (flooded_box(gray, rough, options, own, box)) boxes.insert(boxes.begin(), box);
    for (const Quad& corners : boxes) {
      ClassicCandidate candidate;
      candidate.corners = corners;
      candidate.plain = rectified(gray, corners, kPlateSize * kPlainScale);
      cv::Mat small;
      cv::resize(candidate.plain, small, kPlateSize, 0, 0, cv::INTER_AREA);
      cv::blur(small, small, {3, 3});
      cv::equalizeHist(small, candidate.gray);
      if (debug != nullptr)
        outline(corners,
                &corners == &boxes.back() ? cv::Scalar(0, 160, 255) : cv::Scalar(0, 255, 0));
      result.push_back(std::move(candidate));
    }
  }
  if (debug != nullptr) debug->image("candidates", overlay);
  return result;
}

}  // namespace tarsier::plate
