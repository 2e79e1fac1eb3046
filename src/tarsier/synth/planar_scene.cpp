// SPDX-License-Identifier: MIT
#include "tarsier/synth/planar_scene.h"

#include "tarsier/core/require.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/print_texture.h"

#include <Eigen/LU>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace tarsier::synth {

struct PrintSheet {
  PrintTexture texture;
  Eigen::Matrix3d pixel_from_plane =
      Eigen::Matrix3d::Zero();  // from the print's frame, m, to px of the image
};

namespace {

constexpr int kMaxSamples = 8;  // per pixel, in each direction

cv::Rect2d part_of(const PlanarPrint& print) {
  return print.part.empty() ? cv::Rect2d(0, 0, print.image.cols, print.image.rows) : print.part;
}

// One sheet at one moment.
struct Layer {
  const PrintSheet* sheet = nullptr;
  Eigen::Matrix3d pixel_from_ray = Eigen::Matrix3d::Zero();  // its third row is 1 / depth
  cv::Rect bounds;                                           // px of the frame
  bool is_ground = false;
};

// The plane's points (x, y) are at R (x, y, 0) + t, on the rays through them.
Eigen::Matrix3d pixel_from_ray(const PrintSheet& sheet, const geometry::Rigid3& camera_from_print) {
  Eigen::Matrix3d ray_from_plane = camera_from_print.rotation;
  ray_from_plane.col(2) = camera_from_print.translation;
  return sheet.pixel_from_plane * ray_from_plane.inverse();
}

double facing_of(const geometry::Rigid3& camera_from_print) {
  const Eigen::Vector3d& t = camera_from_print.translation;
  return -camera_from_print.rotation.col(2).dot(t) / std::max(1e-12, t.norm());
}

// Accumulates what the pixels of one row of the frame see.
class RowPainter {
 public:
  RowPainter(const cv::Mat& rays, int y)
      : above_(rays.ptr<cv::Vec2f>(y)), below_(rays.ptr<cv::Vec2f>(y + 1)), y_(y) {}

  // `position` is empty for many samples per pixel; otherwise it is the position of the only sample
  // (+-0.5 px).
  void paint(const Layer& layer, const std::optional<cv::Vec2f>& position,
             std::vector<Pixel4>& row) {
    if (y_ < layer.bounds.y || y_ >= layer.bounds.y + layer.bounds.height) return;
    const int begin = layer.bounds.x;
    const int end = begin + layer.bounds.width;
    corners(layer, begin, end);
    for (int x = begin; x < end; ++x) {
      const auto i = static_cast<std::size_t>(x - begin);
      const float worst = std::min(std::min(top_[i][2], top_[i + 1][2]),
                                   std::min(bottom_[i][2], bottom_[i + 1][2]));
      if (!(worst > 0)) continue;  // behind the camera, or no ray
      const Pixel4 across = 0.5F * (top_[i + 1] - top_[i] + bottom_[i + 1] - bottom_[i]);
      const Pixel4 down = 0.5F * (bottom_[i] - top_[i] + bottom_[i + 1] - top_[i + 1]);
      const Pixel4 center = 0.25F * (top_[i] + top_[i + 1] + bottom_[i] + bottom_[i + 1]);
      // The ground has no ground truth, so one sample at the pixel's centre is enough.
      const Pixel4 seen = position          ? few(layer, center, across, down, *position)
                          : layer.is_ground ? few(layer, center, across, down, {0, 0})
                                            : many(layer, center, across, down);
      row[static_cast<std::size_t>(x)] = seen + (1 - seen[3]) * row[static_cast<std::size_t>(x)];
    }
  }

 private:
  // Positions of the row's pixel corners in the sheet's image; third: 1 / depth.
  void corners(const Layer& layer, int begin, int end) {
    const auto count = static_cast<std::size_t>(end - begin + 1);
    top_.resize(count);
    bottom_.resize(count);
    const Eigen::Matrix3d& m = layer.pixel_from_ray;
    const auto column = [&](int k) {
      return Pixel4{static_cast<float>(m(0, k)), static_cast<float>(m(1, k)),
                    static_cast<float>(m(2, k)), 0};
    };
    const Pixel4 along_x = column(0);
    const Pixel4 along_y = column(1);
    const Pixel4 origin = column(2);
    const auto put = [&](const cv::Vec2f* rays, std::vector<Pixel4>& out) {
      for (std::size_t i = 0; i < count; ++i) {
        const cv::Vec2f& ray = rays[static_cast<std::size_t>(begin) + i];
        const Pixel4 at = ray[0] * along_x + (ray[1] * along_y + origin);
        const float scale = 1 / at[2];
        out[i] = at * Pixel4{scale, scale, 1, 1};
      }
    };
    put(above_, top_);
    put(below_, bottom_);
  }

  static bool is_inside(const Layer& layer, float u, float v, float margin) {
    const PrintTexture& texture = layer.sheet->texture;
    return layer.is_ground ||
           (u > margin && v > margin && u < static_cast<float>(texture.width()) - margin &&
            v < static_cast<float>(texture.height()) - margin);
  }

  struct Footprint {
    float length = 0;  // px of the image, of the longer side
    float width = 0;   // of the parallelogram, perpendicular to the longer side
    float reach = 0;   // from its centre, in each direction
  };
  static Footprint footprint(const Pixel4& across, const Pixel4& down) {
    const float a = std::sqrt(across[0] * across[0] + across[1] * across[1]);
    const float b = std::sqrt(down[0] * down[0] + down[1] * down[1]);
    const float length = std::max(std::max(a, b), 1e-6F);
    const float area = std::abs(across[0] * down[1] - across[1] * down[0]);
    const float reach = 0.5F * std::max(std::abs(across[0]) + std::abs(down[0]),
                                        std::abs(across[1]) + std::abs(down[1]));
    return {length, area / length, reach};
  }
  // The level whose pixels are at most as large as `size` px of the image.
  static int level_for(const Layer& layer, float size) {
    const int level = size > 1 ? std::ilogb(size) : 0;
    return std::min(level, layer.sheet->texture.levels() - 1);
  }

  static Pixel4 grid(const Layer& layer, const Pixel4& center, const Pixel4& across,
                     const Pixel4& down, int level, int n, bool at_border) {
    Pixel4 sum{};
    const float step = 1.0F / static_cast<float>(n);
    for (int j = 0; j < n; ++j) {
      const float b = (static_cast<float>(j) + 0.5F) * step - 0.5F;
      for (int i = 0; i < n; ++i) {
        const float a = (static_cast<float>(i) + 0.5F) * step - 0.5F;
        const float u = center[0] + a * across[0] + b * down[0];
        const float v = center[1] + a * across[1] + b * down[1];
        if (at_border && !is_inside(layer, u, v, 0)) continue;
        sum += layer.sheet->texture.sample(level, u, v);
      }
    }
    return sum * (step * step);
  }

  static Pixel4 many(const Layer& layer, const Pixel4& center, const Pixel4& across,
                     const Pixel4& down) {
    const Footprint size = footprint(across, down);
    const bool at_border = !is_inside(layer, center[0], center[1], size.reach);
    if (at_border && !is_inside(layer, center[0], center[1], -size.reach)) return Pixel4{};
    const int sharp = level_for(layer, 0.5F * size.width);
    // Width of the blur by the level's own pixels.
    const float blur = static_cast<float>(1 << std::min(sharp, 20));
    if (!at_border && layer.sheet->texture.is_flat(center[0], center[1], size.reach + blur))
      return layer.sheet->texture.sample(0, center[0], center[1]);
    // As many samples as the level has pixels; if these are too many, a coarser level.
    const int level =
        std::max(sharp, level_for(layer, 2 * size.length / static_cast<float>(kMaxSamples)));
    const float pixel = static_cast<float>(1 << std::min(level, 20));
    const int n = std::clamp(static_cast<int>(std::ceil(size.length / pixel)), at_border ? 4 : 2,
                             kMaxSamples);
    return grid(layer, center, across, down, level, n, at_border);
  }

  static Pixel4 few(const Layer& layer, const Pixel4& center, const Pixel4& across,
                    const Pixel4& down, const cv::Vec2f& position) {
    const Footprint size = footprint(across, down);
    const bool at_border = !is_inside(layer, center[0], center[1], size.reach);
    if (at_border && !is_inside(layer, center[0], center[1], -size.reach)) return Pixel4{};
    const int level = level_for(layer, 0.7F * size.length);
    if (at_border) return grid(layer, center, across, down, level, 2, true);
    return layer.sheet->texture.sample(level,
                                       center[0] + position[0] * across[0] + position[1] * down[0],
                                       center[1] + position[0] * across[1] + position[1] * down[1]);
  }

  const cv::Vec2f* above_;
  const cv::Vec2f* below_;
  int y_;
  std::vector<Pixel4> top_;
  std::vector<Pixel4> bottom_;
};

// Sample positions of `count` moments. Together they fill the pixel evenly, and their mean is its
// centre, so that nothing is shifted. With few moments, each takes many samples.
std::vector<std::optional<cv::Vec2f>> sample_positions(int count) {
  std::vector<std::optional<cv::Vec2f>> positions(static_cast<std::size_t>(count));
  if (count <= 2) return positions;
  const auto ranks = [&](double step) {
    std::vector<std::pair<double, int>> order;
    order.reserve(count);
    for (int k = 0; k < count; ++k) order.emplace_back(std::fmod(step * (k + 1), 1.0), k);
    std::sort(order.begin(), order.end());
    std::vector<float> rank(order.size());
    for (int i = 0; i < count; ++i)
      rank[static_cast<std::size_t>(order[static_cast<std::size_t>(i)].second)] =
          (static_cast<float>(i) + 0.5F) / static_cast<float>(count) - 0.5F;
    return rank;
  };
  const std::vector<float> a = ranks(0.618034);  // golden ratio
  const std::vector<float> b = ranks(0.754878);  // the plastic number's inverse
  for (std::size_t k = 0; k < positions.size(); ++k) positions[k] = cv::Vec2f(a[k], b[k]);
  return positions;
}

// Light at every eighth pixel, enlarged: it has no detail.
cv::Mat light_of(const ImagingConditions& imaging, cv::Size size) {
  constexpr int kGridStep = 8;
  const cv::Size small(size.width / kGridStep + 2, size.height / kGridStep + 2);
  cv::Mat light(small, CV_32FC1);
  const double half = 0.5 * std::max(size.width, size.height);
  const double diagonal = 0.5 * std::hypot(size.width, size.height);
  for (int j = 0; j < small.height; ++j) {
    for (int i = 0; i < small.width; ++i) {
      const double x = i * kGridStep - 0.5 * size.width;
      const double y = j * kGridStep - 0.5 * size.height;
      const double along =
          (x * std::cos(imaging.slope_angle) + y * std::sin(imaging.slope_angle)) / half;
      const double beyond = x * std::cos(imaging.shadow_angle) +
                            y * std::sin(imaging.shadow_angle) - imaging.shadow_offset;
      const double out = std::hypot(x, y) / diagonal;
      light.at<float>(j, i) = static_cast<float>(
          imaging.gain * std::max(0.0, 1 + 0.5 * imaging.slope * along) *
          (1 - imaging.vignette * out * out) *
          (1 - imaging.shadow /
                   (1 + std::exp(-std::clamp(4 * beyond / imaging.shadow_width, -50.0, 50.0)))));
    }
  }
  cv::Mat full;
  cv::resize(light, full, {}, kGridStep, kGridStep, cv::INTER_LINEAR);
  // cv::resize puts the first sample at (kGridStep - 1) / 2.
  return full(cv::Rect(cv::Point(kGridStep / 2, kGridStep / 2), size));
}

}  // namespace

void PlanarPrint::check() const {
  TARSIER_REQUIRE(!image.empty() && image.depth() == CV_8U && image.channels() != 2,
                  "image of type {}", image.type());
  TARSIER_REQUIRE(width > 0 && std::isfinite(width), "width {}", width);
  TARSIER_REQUIRE(part.width >= 0 && part.height >= 0, "part of {}x{} px", part.width, part.height);
}

void ImagingConditions::check() const {
  const auto within = [](double value, double low, double high, const char* name) {
    TARSIER_REQUIRE(value >= low && value <= high, "{} {} is not in {}..{}", name, value, low,
                    high);
  };
  within(gain, 0, 4, "gain");
  within(slope, 0, 1, "slope");
  within(vignette, 0, 1, "vignette");
  within(shadow, 0, 1, "shadow");
  within(shadow_width, 1e-3, 1e5, "shadow_width");
  within(haze, 0, 255, "haze");
  within(defocus_px, 0, 20, "defocus_px");
  within(noise, 0, 64, "noise");
  within(slope_angle, -100, 100, "slope_angle");
  within(shadow_angle, -100, 100, "shadow_angle");
  within(shadow_offset, -1e5, 1e5, "shadow_offset");
}

struct PlanarScene::Parts {
  geometry::Camera camera;
  std::vector<PlanarPrint> prints;
  std::vector<PrintSheet> sheets;
  PrintSheet ground;
  double largest_radius = 0;  // of normalised rays in the frame
  Pixel4 beyond_ground{};     // colour beyond the ground
  cv::Mat rays;               // CV_32FC2, through the corners of all pixels; NaN if there is none

  [[nodiscard]] std::vector<Layer> layers(const PlanarShot& shot) const;
  [[nodiscard]] cv::Rect bounds(const PrintSheet& sheet,
                                const geometry::Rigid3& camera_from_print) const;
  [[nodiscard]] double visible(std::size_t index, const PlanarShot& shot,
                               const std::vector<Layer>& order) const;
};

// The bounding box of the sheet's (curved) outline; the whole frame if a part of the sheet is
// behind the camera.
cv::Rect PlanarScene::Parts::bounds(const PrintSheet& sheet,
                                    const geometry::Rigid3& camera_from_print) const {
  const cv::Rect all(0, 0, camera.width, camera.height);
  const Eigen::Matrix3d plane_from_pixel = sheet.pixel_from_plane.inverse();
  const double w = sheet.texture.width();
  const double h = sheet.texture.height();
  double left = 1e9;
  double top = 1e9;
  double right = -1e9;
  double bottom = -1e9;
  constexpr int kSteps = 8;
  for (int k = 0; k < 4 * kSteps; ++k) {
    const double s = static_cast<double>(k % kSteps) / kSteps;
    const int side = k / kSteps;
    const Eigen::Vector3d pixel(side == 0   ? s * w
                                : side == 1 ? w
                                : side == 2 ? (1 - s) * w
                                            : 0,
                                side == 0   ? 0
                                : side == 1 ? s * h
                                : side == 2 ? h
                                            : (1 - s) * h,
                                1);
    const Eigen::Vector3d plane = plane_from_pixel * pixel;
    const Eigen::Vector3d at = camera_from_print * Eigen::Vector3d(plane[0], plane[1], 0);
    // Behind the camera, or where the lens model folds back.
    if (at[2] < 1e-6 || std::hypot(at[0], at[1]) > largest_radius * at[2]) return all;
    const cv::Point2d p = camera.pixel_of({at[0] / at[2], at[1] / at[2]});
    left = std::min(left, p.x);
    right = std::max(right, p.x);
    top = std::min(top, p.y);
    bottom = std::max(bottom, p.y);
  }
  const auto clipped = [](double value) { return cvFloor(std::clamp(value, -1e6, 1e6)); };
  const cv::Rect box(cv::Point(clipped(left) - 2, clipped(top) - 2),
                     cv::Point(clipped(right) + 4, clipped(bottom) + 4));
  return box & all;
}

// Sorted from the farthest to the nearest.
std::vector<Layer> PlanarScene::Parts::layers(const PlanarShot& shot) const {
  std::vector<Layer> order;
  Layer base;
  base.sheet = &ground;
  base.is_ground = true;
  base.pixel_from_ray = pixel_from_ray(ground, shot.camera_from_world);
  base.bounds = {0, 0, camera.width, camera.height};
  if (shot.camera_from_world.center()[2] > 0) order.push_back(base);
  // Covers last; they are nearer than the prints they cover.
  std::vector<std::pair<double, std::size_t>> by_distance;
  constexpr double kCover = 1e6;
  for (std::size_t i = 0; i < sheets.size(); ++i) {
    const geometry::Rigid3 pose = shot.camera_from_world * shot.world_from_print[i];
    const double nearer = prints[i].id < 0 ? kCover : 0;
    if (facing_of(pose) > 1e-6) by_distance.emplace_back(nearer - pose.translation.norm(), i);
  }
  std::sort(by_distance.begin(), by_distance.end());
  for (const auto& [distance, i] : by_distance) {
    const geometry::Rigid3 pose = shot.camera_from_world * shot.world_from_print[i];
    Layer layer;
    layer.sheet = &sheets[i];
    layer.pixel_from_ray = pixel_from_ray(sheets[i], pose);
    layer.bounds = bounds(sheets[i], pose);
    if (!layer.bounds.empty()) order.push_back(layer);
  }
  return order;
}

double PlanarScene::Parts::visible(std::size_t index, const PlanarShot& shot,
                                   const std::vector<Layer>& order) const {
  constexpr int kGrid = 32;
  const cv::Rect2d part = part_of(prints[index]);
  const geometry::Rigid3 pose = shot.camera_from_world * shot.world_from_print[index];
  const Eigen::Matrix3d back = sheets[index].pixel_from_plane.inverse();
  int seen = 0;
  for (int k = 0; k < kGrid * kGrid; ++k) {
    const double u = part.x + (k % kGrid + 0.5) / kGrid * part.width;
    const double v = part.y + (k / kGrid + 0.5) / kGrid * part.height;
    const Eigen::Vector3d plane = back * Eigen::Vector3d(u, v, 1);
    const Eigen::Vector3d at = pose * Eigen::Vector3d(plane[0], plane[1], 0);
    const auto pixel = camera.project(at);
    if (!pixel || pixel->x < -0.5 || pixel->y < -0.5 || pixel->x > camera.width - 0.5 ||
        pixel->y > camera.height - 0.5)
      continue;
    bool is_hidden = false;
    bool is_nearer = false;
    for (const Layer& layer : order) {
      if (is_nearer) {
        const Eigen::Vector3d q =
            layer.pixel_from_ray * Eigen::Vector3d(at[0] / at[2], at[1] / at[2], 1);
        const double x = q[0] / q[2];
        const double y = q[1] / q[2];
        const PrintTexture& texture = layer.sheet->texture;
        if (q[2] > 0 && x >= 0 && y >= 0 && x < texture.width() && y < texture.height())
          is_hidden = is_hidden ||
                      texture.sample(0, static_cast<float>(x), static_cast<float>(y))[3] > 0.5F;
      }
      is_nearer = is_nearer || layer.sheet == &sheets[index];
    }
    if (!is_hidden) ++seen;
  }
  return static_cast<double>(seen) / (kGrid * kGrid);
}

PlanarScene::PlanarScene(const geometry::Camera& camera, std::vector<PlanarPrint> prints,
                         const cv::Mat& ground, double ground_width) {
  camera.check();
  TARSIER_REQUIRE(ground.type() == CV_8UC3, "ground of type {}", ground.type());
  TARSIER_REQUIRE(ground_width > 0 && std::isfinite(ground_width), "ground {} m wide",
                  ground_width);
  auto parts = std::make_shared<Parts>();
  parts->camera = camera;
  parts->largest_radius = camera.is_distorted() ? camera.largest_radius(100) : 1e9;
  const auto sheet_of = [](const cv::Mat& image, const cv::Rect2d& part, double width,
                           bool mirrored) {
    const double scale = part.width / width;  // px per m
    return PrintSheet{PrintTexture(image, mirrored),
                      Eigen::Matrix3d{{scale, 0, part.x + 0.5 * part.width},
                                      {0, -scale, part.y + 0.5 * part.height},
                                      {0, 0, 1}}};
  };
  for (const PlanarPrint& print : prints) {
    print.check();
    parts->sheets.push_back(sheet_of(print.image, part_of(print), print.width, false));
  }
  parts->ground = sheet_of(ground, cv::Rect2d(0, 0, ground.cols, ground.rows), ground_width, true);
  parts->beyond_ground = parts->ground.texture.sample(parts->ground.texture.levels() - 1, 0, 0);
  parts->prints = std::move(prints);
  parts->rays.create(camera.height + 1, camera.width + 1, CV_32FC2);
  cv::parallel_for_(cv::Range(0, parts->rays.rows), [&](const cv::Range& range) {
    for (int y = range.start; y < range.end; ++y) {
      auto* row = parts->rays.ptr<cv::Vec2f>(y);
      for (int x = 0; x < parts->rays.cols; ++x) {
        constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
        const auto ray = camera.normalized_of({x - 0.5, y - 0.5});
        row[x] = ray ? cv::Vec2f(static_cast<float>(ray->x), static_cast<float>(ray->y))
                     : cv::Vec2f(kNone, kNone);
      }
    }
  });
  parts_ = std::move(parts);
}

const geometry::Camera& PlanarScene::camera() const { return parts_->camera; }
const std::vector<PlanarPrint>& PlanarScene::prints() const { return parts_->prints; }

cv::Mat PlanarScene::render(std::span<const PlanarShot> shots,
                            const ImagingConditions& imaging) const {
  imaging.check();
  TARSIER_REQUIRE(!shots.empty() && shots.size() <= 64, "{} shots", shots.size());
  std::vector<std::vector<Layer>> moments;
  for (const PlanarShot& shot : shots) {
    TARSIER_REQUIRE(shot.world_from_print.size() == parts_->prints.size(), "{} poses for {} prints",
                    shot.world_from_print.size(), parts_->prints.size());
    moments.push_back(parts_->layers(shot));
  }
  const cv::Size size(parts_->camera.width, parts_->camera.height);
  const cv::Mat light = light_of(imaging, size);
  const auto haze = static_cast<float>(imaging.haze);
  const int count = static_cast<int>(moments.size());
  const std::vector<std::optional<cv::Vec2f>> positions = sample_positions(count);
  cv::Mat image(size, CV_8UC3);
  cv::parallel_for_(cv::Range(0, size.height), [&](const cv::Range& range) {
    std::vector<Pixel4> row(static_cast<std::size_t>(size.width));
    std::vector<Pixel4> sum(row.size());
    for (int y = range.start; y < range.end; ++y) {
      RowPainter painter(parts_->rays, y);
      std::fill(sum.begin(), sum.end(), Pixel4{});
      for (int k = 0; k < count; ++k) {
        std::fill(row.begin(), row.end(), parts_->beyond_ground);
        for (const Layer& layer : moments[static_cast<std::size_t>(k)])
          painter.paint(layer, positions[static_cast<std::size_t>(k)], row);
        for (std::size_t x = 0; x < row.size(); ++x) sum[x] += row[x];
      }
      const auto* bright = light.ptr<float>(y);
      auto* out = image.ptr<cv::Vec3b>(y);
      for (int x = 0; x < size.width; ++x) {
        const Pixel4 value =
            sum[static_cast<std::size_t>(x)] * (bright[x] / static_cast<float>(count)) +
            (haze + 0.5F);
        for (int c = 0; c < 3; ++c)
          out[x][c] = static_cast<uchar>(std::clamp(value[c], 0.0F, 255.0F));
      }
    }
  });
  if (imaging.defocus_px > 0.05) cv::GaussianBlur(image, image, {}, imaging.defocus_px);
  if (!imaging.color) cv::cvtColor(image, image, cv::COLOR_BGR2GRAY);
  add_noise(image, imaging.noise, imaging.seed);
  return image;
}

std::vector<PrintTruth> PlanarScene::truth(const PlanarShot& shot) const {
  TARSIER_REQUIRE(shot.world_from_print.size() == parts_->prints.size(), "{} poses for {} prints",
                  shot.world_from_print.size(), parts_->prints.size());
  const std::vector<Layer> order = parts_->layers(shot);
  std::vector<PrintTruth> all;
  for (std::size_t i = 0; i < parts_->prints.size(); ++i) {
    const PlanarPrint& print = parts_->prints[i];
    if (print.id < 0) continue;
    PrintTruth truth;
    truth.id = print.id;
    truth.name = print.name;
    truth.width = print.width;
    truth.camera_from_print = shot.camera_from_world * shot.world_from_print[i];
    truth.facing = facing_of(truth.camera_from_print);
    const cv::Rect2d part = part_of(print);
    const double x = 0.5 * print.width;
    const double y = x * part.height / part.width;
    const std::array<Eigen::Vector3d, 4> corners{
        Eigen::Vector3d(-x, y, 0), Eigen::Vector3d(x, y, 0), Eigen::Vector3d(x, -y, 0),
        Eigen::Vector3d(-x, -y, 0)};
    bool is_before = truth.facing > 0;
    for (std::size_t k = 0; k < 4; ++k) {
      const auto pixel = parts_->camera.project(truth.camera_from_print * corners[k]);
      is_before = is_before && pixel.has_value();
      if (pixel) truth.corners[k] = *pixel;
    }
    if (!is_before) continue;
    for (std::size_t k = 0; k < 4; ++k)
      truth.side_px += 0.25 * cv::norm(truth.corners[(k + 1) % 4] - truth.corners[k]);
    truth.visible = parts_->visible(i, shot, order);
    all.push_back(std::move(truth));
  }
  return all;
}

}  // namespace tarsier::synth
