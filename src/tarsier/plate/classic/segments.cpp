// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/segments.h"

#include "tarsier/core/require.h"
#include "tarsier/plate/classic/character_reader.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::plate {

void SegmentOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(min_height < max_height, "heights {}..{}", min_height, max_height);
}

std::vector<Segment> find_segments(const cv::Mat& plate, int threshold,
                                   const SegmentOptions& options) {
  options.check();
  TARSIER_REQUIRE(plate.type() == CV_8UC1 && !plate.empty(), "a plate of type {}", plate.type());
  const cv::Mat ink = plate < threshold;
  std::vector<std::vector<cv::Point>> contours;
  cv::findContours(ink.clone(), contours, cv::RETR_EXTERNAL, cv::CHAIN_APPROX_NONE);
  std::vector<Segment> segments;
  for (const std::vector<cv::Point>& contour : contours) {
    const cv::Rect box = cv::boundingRect(contour);
    const double aspect = static_cast<double>(box.width) / box.height;
    const double fill =
        static_cast<double>(cv::countNonZero(ink(box))) / static_cast<double>(box.area());
    if (box.height < options.min_height * plate.rows ||
        box.height > options.max_height * plate.rows || aspect < options.min_aspect ||
        aspect > options.aspect * (1 + options.aspect_error)) {
      continue;
    }
    // A 1 fills its narrow box.
    const bool narrow = aspect < options.aspect * (1 - options.aspect_error);
    if (fill > options.max_fill && !narrow) continue;
    Segment segment;
    segment.box = box;
    cv::Mat alone = cv::Mat::zeros(plate.size(), CV_8UC1);
    cv::drawContours(alone, std::vector<std::vector<cv::Point>>{contour}, 0, cv::Scalar(255),
                     cv::FILLED);
    cv::Mat character;
    ink.copyTo(character, alone);
    segment.character = normalized_character(character(box).clone());
    segments.push_back(segment);
  }
  std::sort(segments.begin(), segments.end(),
            [](const Segment& a, const Segment& b) { return a.box.x < b.box.x; });
  return segments;
}

}  // namespace tarsier::plate
