// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/features.h"

#include "tarsier/core/require.h"
#include "tarsier/media/gray_image.h"
#include "tarsier/sfm/features/sift.h"
#include "tarsier/sfm/features/simulated_views.h"

#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

namespace tarsier::sfm {
namespace {

// Features of OpenCV's ORB or AKAZE in a defined order and without duplicates: OpenCV's order
// depends on the number of threads.
struct Found {
  std::vector<cv::Point2f> points;
  std::vector<float> sizes;
  cv::Mat descriptors;
  std::vector<std::int32_t> owners;
};

Found found_by_opencv(const cv::Mat& gray, const FeatureOptions& options) {
  cv::Ptr<cv::Feature2D> detector;
  if (options.kind == FeatureKind::kOrb)
    detector = cv::ORB::create(options.max_count, 1.2F, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, 10);
  else
    detector = cv::AKAZE::create(cv::AKAZE::DESCRIPTOR_MLDB, 0, 3, 0.0005F);
  // Together: computing descriptors separately would build the pyramid again.
  std::vector<cv::KeyPoint> all;
  cv::Mat all_descriptors;
  detector->detectAndCompute(gray, cv::noArray(), all, all_descriptors);
  std::vector<int> order(all.size());
  std::iota(order.begin(), order.end(), 0);
  const auto numbers = [&](int i) {
    const cv::KeyPoint& p = all[static_cast<std::size_t>(i)];
    return std::tuple(p.pt.y, p.pt.x, p.size, p.angle);
  };
  std::sort(order.begin(), order.end(), [&](int a, int b) { return numbers(a) < numbers(b); });
  order.erase(std::unique(order.begin(), order.end(),
                          [&](int a, int b) { return numbers(a) == numbers(b); }),
              order.end());
  std::vector<cv::Point2f> points;
  std::vector<float> responses;
  for (const int i : order) {
    points.push_back(all[static_cast<std::size_t>(i)].pt);
    responses.push_back(all[static_cast<std::size_t>(i)].response);
  }
  std::vector<int> chosen = select_by_cells(points, responses, gray.size(), options.max_count);
  std::sort(chosen.begin(), chosen.end());
  Found found;
  for (const int k : chosen) {
    const int i = order[static_cast<std::size_t>(k)];
    found.points.push_back(points[static_cast<std::size_t>(k)]);
    found.sizes.push_back(all[static_cast<std::size_t>(i)].size);
    found.descriptors.push_back(all_descriptors.row(i));
  }
  return found;
}

Found found_in(const cv::Mat& gray, const FeatureOptions& options) {
  if (options.kind != FeatureKind::kSift) return found_by_opencv(gray, options);
  const SiftOptions sift_options{.max_count = options.max_count, .contrast = options.contrast};
  SiftFeatures sift = find_sift(gray, sift_options);
  std::vector<std::int32_t> owners;
  if (options.wide) owners = add_simulated_views(gray, sift_options, sift);
  return {std::move(sift.points), std::move(sift.sizes), std::move(sift.descriptors),
          std::move(owners)};
}

}  // namespace

Features find_features(const cv::Mat& image, const FeatureOptions& options) {
  options.check();
  TARSIER_REQUIRE(!options.wide || options.kind == FeatureKind::kSift,
                  "option 'wide' needs SIFT features");
  cv::Mat gray = gray_of(image);
  const double scale =
      std::min(1.0, std::sqrt(options.max_pixels / static_cast<double>(gray.total())));
  if (scale < 1) {
    cv::Mat reduced;
    cv::resize(gray, reduced, {}, scale, scale, cv::INTER_AREA);
    gray = reduced;
  }
  const double scale_x = static_cast<double>(image.cols) / gray.cols;
  const double scale_y = static_cast<double>(image.rows) / gray.rows;

  Found found = found_in(gray, options);
  Features features;
  features.descriptors = std::move(found.descriptors);
  features.owners = std::move(found.owners);
  for (std::size_t i = 0; i < found.points.size(); ++i) {
    const cv::Point2f at(
        static_cast<float>((static_cast<double>(found.points[i].x) + 0.5) * scale_x - 0.5),
        static_cast<float>((static_cast<double>(found.points[i].y) + 0.5) * scale_y - 0.5));
    features.points.push_back(at);
    features.sizes.push_back(static_cast<float>(static_cast<double>(found.sizes[i]) * scale_x));
    const int x = std::clamp(cvRound(at.x), 0, image.cols - 1);
    const int y = std::clamp(cvRound(at.y), 0, image.rows - 1);
    features.colors.push_back(image.channels() == 3 ? image.at<cv::Vec3b>(y, x)
                                                    : cv::Vec3b::all(image.at<std::uint8_t>(y, x)));
  }
  return features;
}

}  // namespace tarsier::sfm
