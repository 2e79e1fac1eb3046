// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/features.h"

#include "tarsier/core/require.h"

#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace tarsier::sfm {
namespace {

constexpr int kGrid = 16;  // cells along the larger side
constexpr float kRootLength = 512;

// OpenCV doubles the image for SIFT's first octave by a resampling whose pixel centres lie a
// quarter of a pixel off, and does not take that back (measured; `enable_precise_upscale` of later
// versions is off unless asked for).
constexpr float kSiftShift = 0.25F;

// The strongest of each cell first, then the second of each .. until there are enough.
std::vector<int> spread(const std::vector<cv::KeyPoint>& points, cv::Size size, int most) {
  const double cell = std::max(size.width, size.height) / static_cast<double>(kGrid);
  const int across = static_cast<int>(size.width / cell) + 1;
  const int down = static_cast<int>(size.height / cell) + 1;
  std::vector<std::vector<int>> cells(static_cast<std::size_t>(across * down));
  for (std::size_t i = 0; i < points.size(); ++i) {
    const int x = std::clamp(static_cast<int>(points[i].pt.x / cell), 0, across - 1);
    const int y = std::clamp(static_cast<int>(points[i].pt.y / cell), 0, down - 1);
    cells[static_cast<std::size_t>(y * across + x)].push_back(static_cast<int>(i));
  }
  const auto stronger = [&](int a, int b) {
    const cv::KeyPoint& p = points[static_cast<std::size_t>(a)];
    const cv::KeyPoint& q = points[static_cast<std::size_t>(b)];
    return p.response != q.response ? p.response > q.response : a < b;
  };
  for (auto& members : cells) std::sort(members.begin(), members.end(), stronger);
  std::vector<int> chosen;
  for (std::size_t rank = 0; static_cast<int>(chosen.size()) < most; ++rank) {
    bool any = false;
    for (const auto& members : cells) {
      if (rank >= members.size()) continue;
      any = true;
      if (static_cast<int>(chosen.size()) < most) chosen.push_back(members[rank]);
    }
    if (!any) break;
  }
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

cv::Ptr<cv::Feature2D> detector_of(const FeatureOptions& options) {
  switch (options.kind) {
    case FeatureKind::kOrb:
      return cv::ORB::create(options.max_count, 1.2F, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, 10);
    case FeatureKind::kAkaze:
      return cv::AKAZE::create(cv::AKAZE::DESCRIPTOR_MLDB, 0, 3, 0.0005F);
    case FeatureKind::kSift:
      break;
  }
  // More than wanted, so that there is a choice for every place.
  return cv::SIFT::create(options.max_count * 4, 3, options.contrast, 10, 1.6);
}

// Square roots of the shares: distances between them are those of Hellinger.
cv::Mat root_sift(const cv::Mat& descriptors) {
  cv::Mat result(descriptors.size(), CV_8UC1);
  for (int r = 0; r < descriptors.rows; ++r) {
    const float* in = descriptors.ptr<float>(r);
    std::uint8_t* out = result.ptr(r);
    float sum = 1e-6F;
    for (int k = 0; k < descriptors.cols; ++k) sum += in[k];
    for (int k = 0; k < descriptors.cols; ++k)
      out[k] = cv::saturate_cast<std::uint8_t>(kRootLength * std::sqrt(in[k] / sum));
  }
  return result;
}

}  // namespace

Features find_features(const cv::Mat& image, const FeatureOptions& options) {
  options.check();
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of type {}", image.type());
  cv::Mat gray = image;
  if (image.channels() == 3) cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  const double scale =
      std::min(1.0, std::sqrt(options.max_pixels / static_cast<double>(gray.total())));
  if (scale < 1) {
    cv::Mat reduced;
    cv::resize(gray, reduced, {}, scale, scale, cv::INTER_AREA);
    gray = reduced;
  }
  const double scale_x = static_cast<double>(image.cols) / gray.cols;
  const double scale_y = static_cast<double>(image.rows) / gray.rows;

  // Both at once: alone, describing would build the pyramid again.
  std::vector<cv::KeyPoint> all;
  cv::Mat all_descriptors;
  detector_of(options)->detectAndCompute(gray, cv::noArray(), all, all_descriptors);
  std::vector<int> order(all.size());
  std::iota(order.begin(), order.end(), 0);
  const auto numbers = [&](int i) {
    const cv::KeyPoint& p = all[static_cast<std::size_t>(i)];
    return std::tuple(p.pt.y, p.pt.x, p.size, p.angle);
  };
  // In an order of their own, as OpenCV's depends on its threads; some are there twice.
  std::sort(order.begin(), order.end(), [&](int a, int b) { return numbers(a) < numbers(b); });
  order.erase(std::unique(order.begin(), order.end(),
                          [&](int a, int b) { return numbers(a) == numbers(b); }),
              order.end());
  std::vector<cv::KeyPoint> sorted;
  for (const int i : order) sorted.push_back(all[static_cast<std::size_t>(i)]);

  Features features;
  std::vector<cv::KeyPoint> chosen;
  cv::Mat descriptors;
  for (const int i : spread(sorted, gray.size(), options.max_count)) {
    chosen.push_back(sorted[static_cast<std::size_t>(i)]);
    descriptors.push_back(all_descriptors.row(order[static_cast<std::size_t>(i)]));
  }
  const bool sift = options.kind == FeatureKind::kSift;
  if (!descriptors.empty()) features.descriptors = sift ? root_sift(descriptors) : descriptors;
  const float shift = sift ? kSiftShift : 0;
  for (const cv::KeyPoint& point : chosen) {
    const cv::Point2f at(
        static_cast<float>((static_cast<double>(point.pt.x - shift) + 0.5) * scale_x - 0.5),
        static_cast<float>((static_cast<double>(point.pt.y - shift) + 0.5) * scale_y - 0.5));
    features.points.push_back(at);
    features.sizes.push_back(static_cast<float>(static_cast<double>(point.size) * scale_x));
    const int x = std::clamp(cvRound(at.x), 0, image.cols - 1);
    const int y = std::clamp(cvRound(at.y), 0, image.rows - 1);
    features.colors.push_back(image.channels() == 3 ? image.at<cv::Vec3b>(y, x)
                                                    : cv::Vec3b::all(image.at<std::uint8_t>(y, x)));
  }
  return features;
}

}  // namespace tarsier::sfm
