// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/piecewise_warp.h"

#include "tarsier/core/require.h"
#include "tarsier/face/shape/markup_check.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>

namespace tarsier::face::shape {
namespace {

// Barycentric coordinates down to this value count as on the edge.
constexpr double kEdgeTolerance = -1e-9;

// Barycentric coordinates of a triangle as affine functions of the position: the second is bx x +
// by y + b0, the third cx x + cy y + c0, the first 1 minus both.
struct Barycentric {
  double bx, by, b0, cx, cy, c0;

  // Empty for a triangle without area.
  static std::optional<Barycentric> of(const Eigen::Matrix2Xd& points, const Triangle& triangle) {
    const Eigen::Vector2d a = points.col(triangle[0]);
    const Eigen::Vector2d u = points.col(triangle[1]) - a;
    const Eigen::Vector2d v = points.col(triangle[2]) - a;
    const double area = u.x() * v.y() - u.y() * v.x();
    if (!(std::abs(area) > 1e-12 * (u.squaredNorm() + v.squaredNorm()))) return std::nullopt;
    Barycentric result{v.y() / area, -v.x() / area, 0, -u.y() / area, u.x() / area, 0};
    result.b0 = -(result.bx * a.x() + result.by * a.y());
    result.c0 = -(result.cx * a.x() + result.cy * a.y());
    return result;
  }
  [[nodiscard]] double second(double x, double y) const { return bx * x + by * y + b0; }
  [[nodiscard]] double third(double x, double y) const { return cx * x + cy * y + c0; }
};

struct Affine {
  double xx, xy, x0, yx, yy, y0;

  // The map from a triangle with these coordinates to the same triangle of `target`.
  static Affine to(const Barycentric& from, const Eigen::Matrix2Xd& target,
                   const Triangle& triangle) {
    const Eigen::Vector2d a = target.col(triangle[0]);
    const Eigen::Vector2d u = target.col(triangle[1]) - a;
    const Eigen::Vector2d v = target.col(triangle[2]) - a;
    return {u.x() * from.bx + v.x() * from.cx,         u.x() * from.by + v.x() * from.cy,
            u.x() * from.b0 + v.x() * from.c0 + a.x(), u.y() * from.bx + v.y() * from.cx,
            u.y() * from.by + v.y() * from.cy,         u.y() * from.b0 + v.y() * from.c0 + a.y()};
  }
};

// Pixels whose centre may be in the triangle.
cv::Rect bounds_of(const Eigen::Matrix2Xd& points, const Triangle& triangle, cv::Size size) {
  Eigen::Vector2d low = points.col(triangle[0]);
  Eigen::Vector2d high = low;
  for (const int corner : triangle) {
    low = low.cwiseMin(points.col(corner));
    high = high.cwiseMax(points.col(corner));
  }
  constexpr double kSlack = 1e-6;
  const int left = static_cast<int>(std::clamp(std::ceil(low.x() - kSlack), 0.0, 1e6));
  const int top = static_cast<int>(std::clamp(std::ceil(low.y() - kSlack), 0.0, 1e6));
  const int right = static_cast<int>(std::clamp(std::floor(high.x() + kSlack), -1.0, 1e6));
  const int bottom = static_cast<int>(std::clamp(std::floor(high.y() + kSlack), -1.0, 1e6));
  return cv::Rect(left, top, std::max(0, right - left + 1), std::max(0, bottom - top + 1)) &
         cv::Rect({0, 0}, size);
}

// Limits [first, last] to the pixels x of a row where a + b x >= kEdgeTolerance.
void narrow(double a, double b, double& first, double& last) {
  if (b > 0)
    first = std::max(first, (kEdgeTolerance - a) / b);
  else if (b < 0)
    last = std::min(last, (kEdgeTolerance - a) / b);
  else if (a < kEdgeTolerance)
    last = first - 1;
}

// Calls visit(y, first x, last x + 1) for each row of pixels with centres in the triangle.
template <typename Visit>
void for_rows(const Barycentric& inside, const cv::Rect& bounds, const Visit& visit) {
  for (int y = bounds.y; y < bounds.y + bounds.height; ++y) {
    double first = bounds.x;
    double last = bounds.x + bounds.width - 1;
    const double b = inside.by * y + inside.b0;
    const double c = inside.cy * y + inside.c0;
    narrow(b, inside.bx, first, last);
    narrow(c, inside.cx, first, last);
    narrow(1 - b - c, -inside.bx - inside.cx, first, last);
    const int begin = static_cast<int>(std::ceil(first));
    const int end = static_cast<int>(std::floor(last)) + 1;
    if (begin < end) visit(y, begin, end);
  }
}

// Bilinear interpolation between four pixels with `channels` channels.
template <typename T, int kChannels>
inline void interpolate(const T* top, const T* bottom, std::ptrdiff_t right, float fx, float fy,
                        int channels, float* out, std::size_t stride) {
  const int count = kChannels > 0 ? kChannels : channels;
  for (int c = 0; c < count; ++c) {
    const auto t0 = static_cast<float>(top[c]);
    const auto t1 = static_cast<float>(top[c + right]);
    const auto b0 = static_cast<float>(bottom[c]);
    const auto b1 = static_cast<float>(bottom[c + right]);
    const float t = t0 + fx * (t1 - t0);
    const float b = b0 + fx * (b1 - b0);
    out[static_cast<std::size_t>(c) * stride] = t + fy * (b - t);
  }
}

// Samples a run of pixels along a line of the image. Returns how many are inside it.
template <typename T, int kChannels>
int sample_run(const cv::Mat& image, double x0, double y0, double dx, double dy, int count,
               float* out, std::size_t stride) {
  const int channels = image.channels();
  const auto max_x = static_cast<float>(image.cols - 1);
  const auto max_y = static_cast<float>(image.rows - 1);
  const auto step = static_cast<std::ptrdiff_t>(image.step[0] / sizeof(T));
  const T* data = image.ptr<T>();
  const auto start_x = static_cast<float>(x0);
  const auto start_y = static_cast<float>(y0);
  const auto step_x = static_cast<float>(dx);
  const auto step_y = static_cast<float>(dy);
  // If both ends are inside, all pixels between them are.
  const auto is_safe = [&](double k) {
    const double x = x0 + k * dx;
    const double y = y0 + k * dy;
    return x >= 0.01 && y >= 0.01 && x <= image.cols - 1.01 && y <= image.rows - 1.01;
  };
  if (is_safe(0) && is_safe(count - 1)) {
    for (int k = 0; k < count; ++k) {
      const float x = start_x + static_cast<float>(k) * step_x;
      const float y = start_y + static_cast<float>(k) * step_y;
      const int ix = static_cast<int>(x);
      const int iy = static_cast<int>(y);
      const T* top = data + iy * step + static_cast<std::ptrdiff_t>(ix) * channels;
      interpolate<T, kChannels>(top, top + step, channels, x - static_cast<float>(ix),
                                y - static_cast<float>(iy), channels, out + k, stride);
    }
    return count;
  }
  int inside = 0;
  for (int k = 0; k < count; ++k) {
    const float ox = start_x + static_cast<float>(k) * step_x;
    const float oy = start_y + static_cast<float>(k) * step_y;
    inside += ox >= -0.5F && oy >= -0.5F && ox <= max_x + 0.5F && oy <= max_y + 0.5F ? 1 : 0;
    const float x = std::clamp(ox, 0.0F, max_x);
    const float y = std::clamp(oy, 0.0F, max_y);
    const int ix = std::min(static_cast<int>(x), std::max(0, image.cols - 2));
    const int iy = std::min(static_cast<int>(y), std::max(0, image.rows - 2));
    const T* top = data + iy * step + static_cast<std::ptrdiff_t>(ix) * channels;
    const T* bottom = image.rows > 1 ? top + step : top;
    interpolate<T, kChannels>(top, bottom, image.cols > 1 ? channels : 0,
                              x - static_cast<float>(ix), y - static_cast<float>(iy), channels,
                              out + k, stride);
  }
  return inside;
}

// Samples one pixel of the texture using only pixels of the mask. False if none is near.
bool sample_masked(const cv::Mat& texture, const cv::Mat& mask, double x, double y,
                   std::uint8_t* out) {
  const int channels = texture.channels();
  const int ix = std::clamp(static_cast<int>(std::floor(x)), 0, texture.cols - 1);
  const int iy = std::clamp(static_cast<int>(std::floor(y)), 0, texture.rows - 1);
  const int jx = std::min(ix + 1, texture.cols - 1);
  const int jy = std::min(iy + 1, texture.rows - 1);
  const auto fx = static_cast<float>(std::clamp(x - ix, 0.0, 1.0));
  const auto fy = static_cast<float>(std::clamp(y - iy, 0.0, 1.0));
  const auto* top = texture.ptr<std::uint8_t>(iy);
  const auto* bottom = texture.ptr<std::uint8_t>(jy);
  const auto* mask_top = mask.ptr<std::uint8_t>(iy);
  const auto* mask_bottom = mask.ptr<std::uint8_t>(jy);
  if ((mask_top[ix] & mask_top[jx] & mask_bottom[ix] & mask_bottom[jx]) != 0) {
    for (int c = 0; c < channels; ++c) {
      const auto t0 = static_cast<float>(top[ix * channels + c]);
      const auto b0 = static_cast<float>(bottom[ix * channels + c]);
      const float t = t0 + fx * (static_cast<float>(top[jx * channels + c]) - t0);
      const float b = b0 + fx * (static_cast<float>(bottom[jx * channels + c]) - b0);
      out[c] = static_cast<std::uint8_t>(t + fy * (b - t) + 0.5F);
    }
    return true;
  }
  float w00 = mask_top[ix] > 0 ? (1 - fx) * (1 - fy) : 0;
  float w01 = mask_top[jx] > 0 ? fx * (1 - fy) : 0;
  float w10 = mask_bottom[ix] > 0 ? (1 - fx) * fy : 0;
  float w11 = mask_bottom[jx] > 0 ? fx * fy : 0;
  const float sum = w00 + w01 + w10 + w11;
  if (!(sum > 1e-6F)) return false;
  w00 /= sum;
  w01 /= sum;
  w10 /= sum;
  w11 /= sum;
  for (int c = 0; c < channels; ++c) {
    const float value = w00 * static_cast<float>(top[ix * channels + c]) +
                        w01 * static_cast<float>(top[jx * channels + c]) +
                        w10 * static_cast<float>(bottom[ix * channels + c]) +
                        w11 * static_cast<float>(bottom[jx * channels + c]);
    out[c] = static_cast<std::uint8_t>(std::min(255.0F, value + 0.5F));
  }
  return true;
}

void require_points(const Eigen::Matrix2Xd& points, Eigen::Index count) {
  TARSIER_REQUIRE(points.cols() == count, "{} points, the frame has {}", points.cols(), count);
  TARSIER_REQUIRE(points.allFinite() && points.cwiseAbs().maxCoeff() <= kMaxCoordinate,
                  "a point is not finite, or far outside any image");
}

}  // namespace

PiecewiseWarp::PiecewiseWarp(Eigen::Matrix2Xd frame_points, std::vector<Triangle> mesh,
                             cv::Size size)
    : frame_points_(std::move(frame_points)), mesh_(std::move(mesh)), size_(size) {
  TARSIER_REQUIRE(size.width >= 1 && size.height >= 1 && size.width <= 20000 &&
                      size.height <= 20000 && static_cast<double>(size.width) * size.height <= 1e8,
                  "a frame of {} x {}", size.width, size.height);
  TARSIER_REQUIRE(!mesh_.empty() && frame_points_.cols() >= 3, "{} triangles of {} points",
                  mesh_.size(), frame_points_.cols());
  require_points(frame_points_, frame_points_.cols());
  TARSIER_REQUIRE(count_folded(mesh_, frame_points_) == 0, "the mesh folds in its frame");

  // Triangle of each pixel: the first one that contains it.
  cv::Mat owner(size_, CV_32S, cv::Scalar(-1));
  std::vector<Barycentric> inside;
  for (std::size_t t = 0; t < mesh_.size(); ++t) {
    const auto barycentric = Barycentric::of(frame_points_, mesh_[t]);
    TARSIER_REQUIRE(barycentric.has_value(), "triangle {} has no area in its frame", t);
    inside.push_back(*barycentric);
    for_rows(*barycentric, bounds_of(frame_points_, mesh_[t], size_),
             [&](int y, int begin, int end) {
               int* row = owner.ptr<int>(y);
               for (int x = begin; x < end; ++x)
                 if (row[x] < 0) row[x] = static_cast<int>(t);
             });
  }
  mask_ = cv::Mat::zeros(size_, CV_8UC1);
  for (int y = 0; y < size_.height; ++y) {
    const int* row = owner.ptr<int>(y);
    for (int x = 0; x < size_.width; ++x) {
      if (row[x] < 0) continue;
      mask_.at<std::uint8_t>(y, x) = 255;
      const Barycentric& weights = inside[static_cast<std::size_t>(row[x])];
      const double b = weights.second(x, y);
      const double c = weights.third(x, y);
      pixels_.push_back(
          {x,
           y,
           row[x],
           {static_cast<float>(1 - b - c), static_cast<float>(b), static_cast<float>(c)}});
      if (x > 0 && row[x - 1] == row[x])
        ++runs_.back().count;
      else
        runs_.push_back({x, y, 1, row[x]});
    }
  }
}

double PiecewiseWarp::sample(const cv::Mat& image, const Eigen::Matrix2Xd& points,
                             std::vector<float>& out) const {
  TARSIER_REQUIRE(
      !image.empty() && image.dims == 2 &&
          (image.type() == CV_8UC1 || image.type() == CV_8UC3 || image.depth() == CV_32F),
      "an image of OpenCV's type {}", image.type());
  require_points(points, frame_points_.cols());
  std::vector<Affine> maps;
  maps.reserve(mesh_.size());
  for (const Triangle& triangle : mesh_) {
    const auto inside = Barycentric::of(frame_points_, triangle);
    maps.push_back(Affine::to(*inside, points, triangle));  // the constructor has checked its area
  }
  const std::size_t stride = pixels_.size();
  out.resize(stride * static_cast<std::size_t>(image.channels()));
  const auto all = [&](auto run) {
    std::int64_t in_image = 0;
    std::size_t at = 0;
    for (const Run& r : runs_) {
      const Affine& map = maps[static_cast<std::size_t>(r.triangle)];
      in_image += run(map.xx * r.x + map.xy * r.y + map.x0, map.yx * r.x + map.yy * r.y + map.y0,
                      map.xx, map.yx, r.count, out.data() + at);
      at += static_cast<std::size_t>(r.count);
    }
    return in_image;
  };
  const auto with = [&](auto function) {
    return all([&](double x, double y, double dx, double dy, int count, float* to) {
      return function(image, x, y, dx, dy, count, to, stride);
    });
  };
  std::int64_t in_image = 0;
  if (image.type() == CV_8UC1)
    in_image = with(sample_run<std::uint8_t, 1>);
  else if (image.type() == CV_8UC3)
    in_image = with(sample_run<std::uint8_t, 3>);
  else if (image.type() == CV_32FC1)
    in_image = with(sample_run<float, 1>);
  else
    in_image = with(sample_run<float, 0>);
  return stride == 0 ? 0.0 : static_cast<double>(in_image) / static_cast<double>(stride);
}

cv::Mat PiecewiseWarp::to_frame(const cv::Mat& image, const Eigen::Matrix2Xd& points) const {
  TARSIER_REQUIRE(image.type() == CV_8UC1 || image.type() == CV_8UC3,
                  "an image of OpenCV's type {}", image.type());
  std::vector<float> values;
  (void)sample(image, points, values);
  cv::Mat frame = cv::Mat::zeros(size_, image.type());
  const int channels = image.channels();
  for (std::size_t k = 0; k < pixels_.size(); ++k) {
    std::uint8_t* to = frame.ptr<std::uint8_t>(pixels_[k].y) + pixels_[k].x * channels;
    for (int c = 0; c < channels; ++c)
      to[c] = static_cast<std::uint8_t>(values[static_cast<std::size_t>(c) * pixels_.size() + k] +
                                        0.5F);
  }
  return frame;
}

void PiecewiseWarp::from_frame(const cv::Mat& texture, const Eigen::Matrix2Xd& points,
                               cv::Mat& image) const {
  TARSIER_REQUIRE(texture.size() == size_, "a texture of {} x {}, the frame has {} x {}",
                  texture.cols, texture.rows, size_.width, size_.height);
  TARSIER_REQUIRE((texture.type() == CV_8UC1 || texture.type() == CV_8UC3) &&
                      image.type() == texture.type() && !image.empty(),
                  "a texture of OpenCV's type {}, an image of {}", texture.type(), image.type());
  require_points(points, frame_points_.cols());
  const int channels = image.channels();
  for (const Triangle& triangle : mesh_) {
    const auto inside = Barycentric::of(points, triangle);
    if (!inside) continue;
    const Affine map = Affine::to(*inside, frame_points_, triangle);
    for_rows(*inside, bounds_of(points, triangle, image.size()), [&](int y, int begin, int end) {
      auto* row = image.ptr<std::uint8_t>(y);
      for (int x = begin; x < end; ++x) {
        (void)sample_masked(texture, mask_, map.xx * x + map.xy * y + map.x0,
                            map.yx * x + map.yy * y + map.y0,
                            row + static_cast<std::ptrdiff_t>(x) * channels);
      }
    });
  }
}

}  // namespace tarsier::face::shape
