// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/frame_sampler.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::appearance {
namespace {

template <int kChannels>
void sample_run(const cv::Mat& image, float x0, float y0, float dx, float dy, int count,
                bool is_safe, float* out) {
  const int channels = kChannels > 0 ? kChannels : image.channels();
  const auto step = static_cast<std::ptrdiff_t>(image.step[0] / sizeof(float));
  const auto* data = image.ptr<float>();
  const auto max_x = static_cast<float>(image.cols - 1);
  const auto max_y = static_cast<float>(image.rows - 1);
  for (int k = 0; k < count; ++k) {
    float x = x0 + static_cast<float>(k) * dx;
    float y = y0 + static_cast<float>(k) * dy;
    int ix;
    int iy;
    if (is_safe) {
      ix = static_cast<int>(x);
      iy = static_cast<int>(y);
    } else {
      x = std::clamp(x, 0.0F, max_x);
      y = std::clamp(y, 0.0F, max_y);
      ix = std::min(static_cast<int>(x), image.cols - 2);
      iy = std::min(static_cast<int>(y), image.rows - 2);
    }
    const float fx = x - static_cast<float>(ix);
    const float fy = y - static_cast<float>(iy);
    const float* top = data + iy * step + static_cast<std::ptrdiff_t>(ix) * channels;
    const float* bottom = top + step;
    const float w11 = fx * fy;
    const float w01 = fx - w11;
    const float w10 = fy - w11;
    const float w00 = 1 - fx - w10;
    for (int c = 0; c < channels; ++c) {
      out[c] =
          w00 * top[c] + w01 * top[c + channels] + w10 * bottom[c] + w11 * bottom[c + channels];
    }
    out += channels;
  }
}

}  // namespace

FrameSampler::FrameSampler(const shape::PiecewiseWarp& warp)
    : frame_points_(warp.frame_points()), mesh_(warp.mesh()) {
  pixels_ = static_cast<int>(warp.pixels().size());
  for (const auto& pixel : warp.pixels()) {
    if (!runs_.empty() && runs_.back().triangle == pixel.triangle && runs_.back().y == pixel.y &&
        runs_.back().x + runs_.back().count == pixel.x) {
      ++runs_.back().count;
    } else {
      runs_.push_back({pixel.x, pixel.y, 1, pixel.triangle});
    }
  }
  std::vector<std::vector<int>> around(static_cast<std::size_t>(frame_points_.cols()));
  for (std::size_t t = 0; t < mesh_.size(); ++t) {
    const Eigen::Vector2d a = frame_points_.col(mesh_[t][0]);
    const Eigen::Vector2d u = frame_points_.col(mesh_[t][1]) - a;
    const Eigen::Vector2d v = frame_points_.col(mesh_[t][2]) - a;
    const double area = u.x() * v.y() - u.y() * v.x();  // > 0, ensured by PiecewiseWarp
    Inverse inverse{v.y() / area, -v.x() / area, 0, -u.y() / area, u.x() / area, 0};
    inverse.b0 = -(inverse.bx * a.x() + inverse.by * a.y());
    inverse.c0 = -(inverse.cx * a.x() + inverse.cy * a.y());
    inverse_.push_back(inverse);
    for (const int corner : mesh_[t])
      around[static_cast<std::size_t>(corner)].push_back(static_cast<int>(t));
  }
  first_of_vertex_.push_back(0);
  for (const auto& list : around) {
    triangles_of_vertex_.insert(triangles_of_vertex_.end(), list.begin(), list.end());
    first_of_vertex_.push_back(static_cast<int>(triangles_of_vertex_.size()));
  }
}

void FrameSampler::maps(const Eigen::Matrix2Xd& points, std::vector<Affine>& out) const {
  TARSIER_REQUIRE(points.cols() == frame_points_.cols(), "{} points, the frame has {}",
                  points.cols(), frame_points_.cols());
  out.resize(mesh_.size());
  for (std::size_t t = 0; t < mesh_.size(); ++t) {
    const Inverse& from = inverse_[t];
    const Eigen::Vector2d a = points.col(mesh_[t][0]);
    const Eigen::Vector2d u = points.col(mesh_[t][1]) - a;
    const Eigen::Vector2d v = points.col(mesh_[t][2]) - a;
    out[t] = {u.x() * from.bx + v.x() * from.cx,         u.x() * from.by + v.x() * from.cy,
              u.x() * from.b0 + v.x() * from.c0 + a.x(), u.y() * from.bx + v.y() * from.cx,
              u.y() * from.by + v.y() * from.cy,         u.y() * from.b0 + v.y() * from.c0 + a.y()};
  }
}

void FrameSampler::sample(const cv::Mat& values, const std::vector<Affine>& maps,
                          float* out) const {
  TARSIER_REQUIRE(values.depth() == CV_32F && values.cols >= 2 && values.rows >= 2,
                  "a crop of {} x {}, OpenCV's type {}", values.cols, values.rows, values.type());
  const int channels = values.channels();
  // If both ends are inside, all points between them are.
  const auto is_safe = [&](double x, double y) {
    return x >= 0.01 && y >= 0.01 && x <= values.cols - 1.01 && y <= values.rows - 1.01;
  };
  for (const Run& run : runs_) {
    const Affine& map = maps[static_cast<std::size_t>(run.triangle)];
    const Eigen::Vector2d at = map(run.x, run.y);
    const double last = run.count - 1;
    const bool safe =
        is_safe(at.x(), at.y()) && is_safe(at.x() + last * map.xx, at.y() + last * map.yx);
    const auto x = static_cast<float>(at.x());
    const auto y = static_cast<float>(at.y());
    const auto dx = static_cast<float>(map.xx);
    const auto dy = static_cast<float>(map.yx);
    switch (channels) {
      case 1:
        sample_run<1>(values, x, y, dx, dy, run.count, safe, out);
        break;
      case 2:
        sample_run<2>(values, x, y, dx, dy, run.count, safe, out);
        break;
      case 3:
        sample_run<3>(values, x, y, dx, dy, run.count, safe, out);
        break;
      case 8:
        sample_run<8>(values, x, y, dx, dy, run.count, safe, out);
        break;
      default:
        sample_run<0>(values, x, y, dx, dy, run.count, safe, out);
        break;
    }
    out += static_cast<std::ptrdiff_t>(run.count) * channels;
  }
}

int FrameSampler::look_up(const cv::Mat& inside, const std::vector<Affine>& maps,
                          std::vector<std::uint8_t>& out) const {
  out.resize(static_cast<std::size_t>(pixels_));
  std::size_t k = 0;
  int count = 0;
  for (const Run& run : runs_) {
    const Affine& map = maps[static_cast<std::size_t>(run.triangle)];
    for (int i = 0; i < run.count; ++i, ++k) {
      const Eigen::Vector2d at = map(run.x + i, run.y);
      const double x = std::floor(at.x() + 0.5);
      const double y = std::floor(at.y() + 0.5);
      const bool is_in = x >= 0 && y >= 0 && x < inside.cols && y < inside.rows &&
                         inside.ptr<std::uint8_t>(static_cast<int>(y))[static_cast<int>(x)] != 0;
      out[k] = is_in ? 1 : 0;
      count += is_in ? 1 : 0;
    }
  }
  return count;
}

void FrameSampler::compose(const std::vector<Affine>& maps, const Eigen::Matrix2Xd& step,
                           Eigen::Matrix2Xd& out) const {
  for (Eigen::Index i = 0; i < out.cols(); ++i) {
    const Eigen::Vector2d from = frame_points_.col(i) + step.col(i);
    Eigen::Vector2d sum(0, 0);
    const int first = first_of_vertex_[static_cast<std::size_t>(i)];
    const int last = first_of_vertex_[static_cast<std::size_t>(i) + 1];
    for (int k = first; k < last; ++k) {
      const int t = triangles_of_vertex_[static_cast<std::size_t>(k)];
      sum += maps[static_cast<std::size_t>(t)](from.x(), from.y());
    }
    out.col(i) = sum / static_cast<double>(last - first);
  }
}

}  // namespace tarsier::face::appearance
