// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/target.h"

#include "tarsier/core/image.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>

namespace tarsier::planar::image_targets {
namespace {

constexpr int kMinSide = 20;  // shorter side of the coarsest level, px
// Minimum distance of an anchor from the image's edge, px of a level.
constexpr int kAnchorEdge = 5;
constexpr std::size_t kMaxAnchors = 120;

// Corners by the smaller eigenvalue of the structure tensor. The strongest of each neighbourhood
// come first, so that the first n are spread (Brown, Szeliski and Winder, CVPR 2005).
std::vector<cv::Point2f> find_anchors(const Level& level) {
  std::vector<cv::Point2f> anchors;
  const cv::Mat inner = level.inner();
  if (std::min(inner.cols, inner.rows) < 2 * kAnchorEdge + 3) return anchors;
  cv::Mat strength;
  cv::cornerMinEigenVal(inner, strength, 7, 3);
  struct Corner {
    int x, y;
    float strength;
    float radius2;
  };
  std::vector<Corner> corners;
  for (int y = kAnchorEdge; y < inner.rows - kAnchorEdge; ++y) {
    for (int x = kAnchorEdge; x < inner.cols - kAnchorEdge; ++x) {
      const float v = strength.at<float>(y, x);
      bool is_maximum = v > 1e-7F;
      for (int dy = -1; dy <= 1 && is_maximum; ++dy)
        for (int dx = -1; dx <= 1; ++dx) {
          const float other = strength.at<float>(y + dy, x + dx);
          if (other > v || (other == v && (dy < 0 || (dy == 0 && dx < 0)))) is_maximum = false;
        }
      if (is_maximum) corners.push_back({x, y, v, 1e12F});
    }
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.strength > b.strength; });
  if (corners.size() > 20) {
    // Much weaker corners are lost in a camera's noise.
    const float min_strength = 0.03F * corners[20].strength;
    std::erase_if(corners, [&](const Corner& c) { return c.strength < min_strength; });
  }
  corners.resize(std::min<std::size_t>(corners.size(), 2000));
  for (std::size_t i = 1; i < corners.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (corners[i].strength > 0.9F * corners[j].strength) continue;
      const auto dx = static_cast<float>(corners[i].x - corners[j].x);
      const auto dy = static_cast<float>(corners[i].y - corners[j].y);
      corners[i].radius2 = std::min(corners[i].radius2, dx * dx + dy * dy);
    }
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const Corner& a, const Corner& b) { return a.radius2 > b.radius2; });
  for (const Corner& c : corners) {
    const cv::Point2d p = level.to_image({static_cast<double>(c.x), static_cast<double>(c.y)});
    anchors.emplace_back(static_cast<float>(p.x), static_cast<float>(p.y));
    if (anchors.size() == kMaxAnchors) break;
  }
  return anchors;
}

}  // namespace

std::array<cv::Point2d, 4> Target::corners() const {
  const double w = gray.cols - 0.5;
  const double h = gray.rows - 0.5;
  return {{{-0.5, -0.5}, {w, -0.5}, {w, h}, {-0.5, h}}};
}

cv::Matx33d Target::from_original_image(const cv::Matx33d& homography) const {
  const double x = static_cast<double>(gray.cols) / original_size.width;
  const double y = static_cast<double>(gray.rows) / original_size.height;
  const cv::Matx33d h = homography * cv::Matx33d(x, 0, 0.5 * x - 0.5, 0, y, 0.5 * y - 0.5, 0, 0, 1);
  return h * (1 / h(2, 2));
}

cv::Point2d Target::on_plane(const cv::Point2d& image) const {
  return {((image.x + 0.5) / gray.cols - 0.5) * width,
          (0.5 - (image.y + 0.5) / gray.rows) * height};
}

void compute_derived_members(Target& target) {
  require_gray(target.gray);
  target.pyramid = make_pyramid(target.gray, true, kMinSide);
  target.anchors.clear();
  for (const Level& level : target.pyramid.levels) target.anchors.push_back(find_anchors(level));
  target.sketches.assign((target.descriptors.size() + 15) / 16, SketchBlock{});
  for (std::size_t i = 0; i < target.sketches.size() * 16; ++i) {
    const std::size_t from = i < target.descriptors.size() ? i : i / 16 * 16;
    for (std::size_t w = 0; w < kSketchWords; ++w)
      target.sketches[i / 16].words[w][i % 16] = target.descriptors[from].sketch[w];
  }
}

}  // namespace tarsier::planar::image_targets
