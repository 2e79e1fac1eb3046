// SPDX-License-Identifier: MIT
#include "tarsier/render/render.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/render/screen_triangles.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::render {
namespace {

constexpr int kTile_px = 64;        // px
constexpr int kMaxSide_px = 16384;  // px, side of an image

// An item to draw in a tile, in order.
struct Layer {
  Role role;
  std::vector<ScreenTriangle> triangles;
  std::vector<std::vector<int>> of_tile;  // indices of the triangles that may touch each tile
};

struct Frame {
  cv::Mat& bgr;
  const Scene& scene;
  const geometry::Camera& camera;
  Eigen::Vector3d to_light = Eigen::Vector3d::Zero();
  int per_px;  // samples per pixel and axis: 1 or 2
  int tiles_x;
  int tiles_y;
};

cv::Vec3f texel(const cv::Mat& level, int x, int y) {
  const cv::Vec3b& c = level.ptr<cv::Vec3b>(y)[x];
  return {static_cast<float>(c[0]), static_cast<float>(c[1]), static_cast<float>(c[2])};
}

// Bilinear, repeating; 0..255.
cv::Vec3f sample(const cv::Mat& level, float u, float v) {
  if (!(std::abs(u) < 1e6F)) u = 0;  // also for NaN
  if (!(std::abs(v) < 1e6F)) v = 0;
  const float x = (u - std::floor(u)) * static_cast<float>(level.cols) - 0.5F;
  const float y = (1 - (v - std::floor(v))) * static_cast<float>(level.rows) - 0.5F;
  const float fx = std::floor(x);
  const float fy = std::floor(y);
  const auto wrap = [](int i, int n) { return i < 0 ? i + n : i >= n ? i - n : i; };
  const int x0 = wrap(static_cast<int>(fx), level.cols);
  const int y0 = wrap(static_cast<int>(fy), level.rows);
  const int x1 = wrap(x0 + 1, level.cols);
  const int y1 = wrap(y0 + 1, level.rows);
  const float ax = x - fx;
  const float ay = y - fy;
  const cv::Vec3f upper = texel(level, x0, y0) * (1 - ax) + texel(level, x1, y0) * ax;
  const cv::Vec3f lower = texel(level, x0, y1) * (1 - ax) + texel(level, x1, y1) * ax;
  return upper * (1 - ay) + lower * ay;
}

std::uint8_t to_byte(float value) {  // NaN becomes 0
  return value > 0 ? static_cast<std::uint8_t>(std::min(value, 255.0F) + 0.5F) : std::uint8_t{0};
}

std::int64_t floor_divide(std::int64_t a, std::int64_t b) {  // b > 0
  return a >= 0 ? a / b : -((b - 1 - a) / b);
}

// The samples of one tile. Sample i is at (i - (per_px - 1) / 2) / per_px px.
class Tile {
 public:
  Tile(const Frame& frame, const cv::Rect& box) : frame_(frame), box_(box) {
    const int n = frame.per_px;
    left_ = box.x * n;
    top_ = box.y * n;
    width_ = box.width * n;
    height_ = box.height * n;
    step_ = kGrid / n;
    first_ = n == 1 ? 0 : -kGrid / 4;
    depth_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), 0.0);
    color_.create(height_, width_, CV_8UC3);
    for (int y = 0; y < height_; ++y) {
      const cv::Vec3b* from = frame.bgr.ptr<cv::Vec3b>(box.y + y / n) + box.x;
      auto* to = color_.ptr<cv::Vec3b>(y);
      for (int x = 0; x < width_; ++x) to[x] = from[x / n];
    }
  }

  void draw(const Layer& layer, const std::vector<int>& indices) {
    if (layer.role == Role::kShadow && shaded_.empty()) shaded_.assign(depth_.size(), 0);
    for (const int index : indices) {
      draw(layer.triangles[static_cast<std::size_t>(index)], layer.role);
    }
  }

  void darken() {
    if (shaded_.empty()) return;
    const auto brightness = static_cast<float>(1 - frame_.scene.darkness);
    for (int y = 0; y < height_; ++y) {
      auto* row = color_.ptr<cv::Vec3b>(y);
      for (int x = 0; x < width_; ++x) {
        if (shaded_[at(x, y)] == 0) continue;
        for (int k = 0; k < 3; ++k) row[x][k] = to_byte(static_cast<float>(row[x][k]) * brightness);
      }
    }
  }

  // Stores the mean of each pixel's samples.
  void store() const {
    const int n = frame_.per_px;
    for (int y = 0; y < box_.height; ++y) {
      cv::Vec3b* to = frame_.bgr.ptr<cv::Vec3b>(box_.y + y) + box_.x;
      for (int x = 0; x < box_.width; ++x) {
        cv::Vec3i sum(0, 0, 0);
        for (int j = 0; j < n; ++j) {
          const cv::Vec3b* row = color_.ptr<cv::Vec3b>(y * n + j) + x * n;
          for (int i = 0; i < n; ++i) sum += cv::Vec3i(row[i]);
        }
        for (int k = 0; k < 3; ++k)
          to[x][k] = static_cast<std::uint8_t>((sum[k] + n * n / 2) / (n * n));
      }
    }
  }

 private:
  struct Edge {
    std::int64_t at_row = 0;  // at the first sample of the row
    std::int64_t along_x = 0;
    std::int64_t along_y = 0;
  };

  [[nodiscard]] std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }
  [[nodiscard]] double px(int sample_index) const {
    return static_cast<double>(sample_index * step_ + first_) / kGrid;
  }
  void draw(const ScreenTriangle& triangle, Role role);
  void draw_row(const ScreenTriangle& triangle, Role role, int y, int begin, int end);
  [[nodiscard]] cv::Vec3b shade(const ScreenTriangle& triangle, double x, double y, float z) const;

  const Frame& frame_;
  cv::Rect box_;
  int left_ = 0;  // samples
  int top_ = 0;
  int width_ = 0;
  int height_ = 0;
  int step_ = 0;  // 1/256 px from sample to sample
  int first_ = 0;
  std::vector<double> depth_;  // 1 / z; 0: empty
  std::vector<std::uint8_t> shaded_;
  cv::Mat color_;
};

void Tile::draw(const ScreenTriangle& t, Role role) {
  const auto [left, right] = std::minmax_element(t.x.begin(), t.x.end());
  const auto [top, bottom] = std::minmax_element(t.y.begin(), t.y.end());
  const auto first_sample = [this](int v) {
    return static_cast<int>(-floor_divide(-(v - first_), step_));
  };
  const auto last_sample = [this](int v) {
    return static_cast<int>(floor_divide(v - first_, step_));
  };
  const int x0 = std::max(left_, first_sample(*left));
  const int x1 = std::min(left_ + width_ - 1, last_sample(*right));
  const int y0 = std::max(top_, first_sample(*top));
  const int y1 = std::min(top_ + height_ - 1, last_sample(*bottom));
  if (x0 > x1 || y0 > y1) return;
  std::array<Edge, 3> edges;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    const std::int64_t dx = t.x[next] - t.x[k];
    const std::int64_t dy = t.y[next] - t.y[k];
    const std::int64_t px0 = std::int64_t{x0} * step_ + first_ - t.x[k];
    const std::int64_t py0 = std::int64_t{y0} * step_ + first_ - t.y[k];
    const bool owns_its_points = dy < 0 || (dy == 0 && dx > 0);  // a left or top edge
    edges[k] = {dx * py0 - dy * px0 - (owns_its_points ? 0 : 1), -dy * step_, dx * step_};
  }
  for (int y = y0; y <= y1; ++y) {
    std::int64_t begin = 0;
    std::int64_t end = x1 - x0 + 1;
    for (Edge& edge : edges) {  // samples i with at_row + i along_x >= 0
      if (edge.along_x > 0) {
        begin = std::max(begin, -floor_divide(edge.at_row, edge.along_x));
      } else if (edge.along_x < 0) {
        end = std::min(end, floor_divide(edge.at_row, -edge.along_x) + 1);
      } else if (edge.at_row < 0) {
        end = 0;
      }
      edge.at_row += edge.along_y;
    }
    if (begin < end) {
      draw_row(t, role, y, x0 + static_cast<int>(begin), x0 + static_cast<int>(end));
    }
  }
}

void Tile::draw_row(const ScreenTriangle& t, Role role, int y, int begin, int end) {
  const double y_px = px(y);
  const double row = t.inverse_depth + (y_px - t.origin_y) * t.inverse_along_y;
  double* depth = depth_.data() + at(0, y - top_);
  auto* color = color_.ptr<cv::Vec3b>(y - top_);
  for (int x = begin; x < end; ++x) {
    const double x_px = px(x);
    const double inverse = row + (x_px - t.origin_x) * t.inverse_along_x;
    const int i = x - left_;
    if (!(inverse > depth[i])) continue;
    if (role == Role::kShadow) {
      shaded_[at(i, y - top_)] = 1;
      continue;
    }
    depth[i] = inverse;
    if (role == Role::kSolid) color[i] = shade(t, x_px, y_px, static_cast<float>(1 / inverse));
  }
}

cv::Vec3b Tile::shade(const ScreenTriangle& t, double x, double y, float z) const {
  const auto dx = static_cast<float>(x - t.origin_x);
  const auto dy = static_cast<float>(y - t.origin_y);
  const auto attribute = [&](std::size_t k) {
    const Plane& plane = t.attributes[k];
    return (plane.value + plane.along_x * dx + plane.along_y * dy) * z;
  };
  cv::Vec3f base = t.color;
  if (t.texture != nullptr) {
    const cv::Vec3f c =
        sample(t.texture->levels[static_cast<std::size_t>(t.level)], attribute(3), attribute(4));
    base = base.mul(c) * (1 / 255.0F);
  }
  float light = attribute(0);
  float highlight = 0;
  if (frame_.scene.shading == Shading::kPhong) {
    const Light& lamp = frame_.scene.light;
    Eigen::Vector3d normal(attribute(0), attribute(1), attribute(2));
    const double length = normal.norm();
    if (length > 0) normal /= length;
    light = static_cast<float>(lamp.ambient +
                               lamp.diffuse * std::max(0.0, normal.dot(frame_.to_light)));
    if (lamp.specular > 0) {
      const geometry::Camera& camera = frame_.camera;
      const Eigen::Vector3d ray((x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, 1);
      const Eigen::Vector3d half = frame_.to_light - ray.normalized();
      const double half_length = half.norm();
      if (half_length > 0) {
        highlight = static_cast<float>(
            lamp.specular *
            std::pow(std::max(0.0, normal.dot(half) / half_length), lamp.shininess));
      }
    }
  } else {
    highlight = attribute(1);
  }
  const float add = 255 * highlight;
  return {to_byte(base[0] * light + add), to_byte(base[1] * light + add),
          to_byte(base[2] * light + add)};
}

void sort_into_tiles(Layer& layer, const Frame& frame) {
  layer.of_tile.resize(static_cast<std::size_t>(frame.tiles_x) *
                       static_cast<std::size_t>(frame.tiles_y));
  // A sample lies up to half a pixel before its pixel's centre.
  const auto tile_of = [](int v, int tiles) {
    const int tile = static_cast<int>(floor_divide(v + kGrid / 2, std::int64_t{kGrid} * kTile_px));
    return std::clamp(tile, 0, tiles - 1);
  };
  for (std::size_t i = 0; i < layer.triangles.size(); ++i) {
    const ScreenTriangle& t = layer.triangles[i];
    const auto [left, right] = std::minmax_element(t.x.begin(), t.x.end());
    const auto [top, bottom] = std::minmax_element(t.y.begin(), t.y.end());
    for (int y = tile_of(*top, frame.tiles_y); y <= tile_of(*bottom, frame.tiles_y); ++y) {
      for (int x = tile_of(*left, frame.tiles_x); x <= tile_of(*right, frame.tiles_x); ++x) {
        layer
            .of_tile[static_cast<std::size_t>(y) * static_cast<std::size_t>(frame.tiles_x) +
                     static_cast<std::size_t>(x)]
            .push_back(static_cast<int>(i));
      }
    }
  }
}

std::vector<Layer> layers_of(const Scene& scene, const Projector& project, const Frame& frame) {
  std::vector<Layer> layers;
  for (const Role role : {Role::kOccluder, Role::kShadow, Role::kSolid}) {
    for (const Item& item : scene.items) {
      if (item.role != role) continue;
      layers.push_back({role, screen_triangles(item, scene, project, frame.bgr.size()), {}});
      sort_into_tiles(layers.back(), frame);
    }
  }
  return layers;
}

void draw_tile(const Frame& frame, const std::vector<Layer>& layers, int number) {
  const auto is_empty = [&](const Layer& layer) {
    return layer.role == Role::kOccluder || layer.of_tile[static_cast<std::size_t>(number)].empty();
  };
  if (std::all_of(layers.begin(), layers.end(), is_empty)) return;
  const cv::Rect box = cv::Rect(number % frame.tiles_x * kTile_px,
                                number / frame.tiles_x * kTile_px, kTile_px, kTile_px) &
                       cv::Rect(0, 0, frame.bgr.cols, frame.bgr.rows);
  Tile tile(frame, box);
  bool is_darkened = false;
  for (const Layer& layer : layers) {
    if (layer.role == Role::kSolid && !is_darkened) {
      tile.darken();
      is_darkened = true;
    }
    tile.draw(layer, layer.of_tile[static_cast<std::size_t>(number)]);
  }
  if (!is_darkened) tile.darken();
  tile.store();
}

}  // namespace

void Scene::check() const {
  for (const double value : {light.ambient, light.diffuse, light.specular, light.shininess}) {
    TARSIER_REQUIRE(value >= 0 && value < 1e6, "a number {} of the light", value);
  }
  const double length = light.direction.norm();
  TARSIER_REQUIRE(length > 0 && std::isfinite(length), "light of no direction");
  TARSIER_REQUIRE(near > 0 && std::isfinite(near), "near of {}", near);
  TARSIER_REQUIRE(darkness >= 0 && darkness <= 1, "darkness of {}: 0..1", darkness);
  for (const Item& item : items) {
    TARSIER_REQUIRE(item.mesh != nullptr, "an item without a mesh");
    TARSIER_REQUIRE(item.scale > 0 && std::isfinite(item.scale), "scale of {}", item.scale);
    TARSIER_REQUIRE(item.camera_from_mesh.rotation.allFinite(),
                    "the rotation of an item is not finite");
    TARSIER_REQUIRE(item.camera_from_mesh.translation.allFinite(),
                    "the translation of an item is not finite");
    item.mesh->check();
  }
}

void render(cv::Mat& bgr, const Scene& scene, const geometry::Camera& camera) {
  require_bgr(bgr);
  TARSIER_REQUIRE(bgr.cols <= kMaxSide_px && bgr.rows <= kMaxSide_px, "an image of {} x {} px",
                  bgr.cols, bgr.rows);
  camera.check();
  scene.check();
  const Frame frame{bgr,
                    scene,
                    camera,
                    -scene.light.direction.normalized(),
                    scene.antialias ? 2 : 1,
                    (bgr.cols + kTile_px - 1) / kTile_px,
                    (bgr.rows + kTile_px - 1) / kTile_px};
  const std::vector<Layer> layers = layers_of(scene, Projector(camera), frame);
  cv::parallel_for_(cv::Range(0, frame.tiles_x * frame.tiles_y), [&](const cv::Range& range) {
    for (int number = range.start; number < range.end; ++number) draw_tile(frame, layers, number);
  });
}

Mesh planar_shadow(const Mesh& mesh, const geometry::Rigid3& plane_from_mesh, double scale,
                   const Eigen::Vector3d& light_in_plane) {
  TARSIER_REQUIRE(light_in_plane[2] < 0 && light_in_plane.allFinite(),
                  "the light of a shadow must come from above: z < 0");
  TARSIER_REQUIRE(scale > 0 && std::isfinite(scale), "scale of {}", scale);
  mesh.check();
  Mesh shadow;
  const auto flat = [&](const Eigen::Vector3d& x) {
    const Eigen::Vector3d moved = x - light_in_plane * (x[2] / light_in_plane[2]);
    return cv::Vec3f(static_cast<float>(moved[0]), static_cast<float>(moved[1]), 0.0F);
  };
  for (const Triangle& triangle : mesh.triangles) {
    std::vector<Eigen::Vector3d> above;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto in_plane = [&](std::size_t corner) {
        const auto p = static_cast<std::size_t>(triangle.position[corner % 3]);
        return plane_from_mesh * (geometry::to_eigen(mesh.positions[p]) * scale);
      };
      const Eigen::Vector3d from = in_plane(k);
      const Eigen::Vector3d to = in_plane(k + 1);
      if (from[2] >= 0) above.push_back(from);
      if ((from[2] >= 0) != (to[2] >= 0)) {
        above.emplace_back(from + (to - from) * (from[2] / (from[2] - to[2])));
      }
    }
    const int first = static_cast<int>(shadow.positions.size());
    if (above.size() < 3) continue;
    for (const Eigen::Vector3d& x : above) shadow.positions.push_back(flat(x));
    for (int i = 2; i < static_cast<int>(above.size()); ++i) {
      Triangle part;
      part.position = {first, first + i - 1, first + i};
      shadow.triangles.push_back(part);
    }
  }
  return shadow;
}

}  // namespace tarsier::render
