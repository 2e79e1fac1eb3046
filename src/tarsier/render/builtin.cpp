// SPDX-License-Identifier: MIT
#include "tarsier/render/builtin.h"

#include "tarsier/core/require.h"

#include <cmath>
#include <functional>

namespace tarsier::render {
namespace {

using Surface = std::function<cv::Vec3d(double around, double along)>;

void quad(Mesh& mesh, int a, int b, int c, int d, int material) {
  Triangle triangle;
  triangle.material = material;
  triangle.position = {a, b, c};
  mesh.triangles.push_back(triangle);
  triangle.position = {a, c, d};
  mesh.triangles.push_back(triangle);
}

// A grid of `around` x `along` cells over surface(0..1, 0..1), closed in the first direction. On
// its visible side, `around` runs to the right and `along` runs down.
void add_surface(Mesh& mesh, int around, int along, const Surface& surface, int material) {
  const int first = static_cast<int>(mesh.positions.size());
  for (int j = 0; j <= along; ++j) {
    for (int i = 0; i < around; ++i) {
      mesh.positions.push_back(
          cv::Vec3f(surface(static_cast<double>(i) / around, static_cast<double>(j) / along)));
    }
  }
  const auto at = [&](int i, int j) { return first + j * around + i % around; };
  for (int j = 0; j < along; ++j) {
    for (int i = 0; i < around; ++i) {
      quad(mesh, at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j), material);
    }
  }
}

int add_material(Mesh& mesh, const char* name, const cv::Vec3f& color) {
  Material material;
  material.name = name;
  material.color = color;
  mesh.materials.push_back(material);
  return static_cast<int>(mesh.materials.size()) - 1;
}

// A solid of revolution about the axis from `from` to `to`: radius r[k] at the fraction s[k].
void add_surface_of_revolution(Mesh& mesh, const cv::Vec3d& from, const cv::Vec3d& to,
                               const std::vector<cv::Vec2d>& profile, int around, int material) {
  const cv::Vec3d axis = to - from;
  const cv::Vec3d direction = axis / cv::norm(axis);
  const cv::Vec3d other = std::abs(direction[0]) < 0.9 ? cv::Vec3d(1, 0, 0) : cv::Vec3d(0, 1, 0);
  cv::Vec3d u = direction.cross(other);
  u /= cv::norm(u);
  const cv::Vec3d v = direction.cross(u);
  const int steps = static_cast<int>(profile.size()) - 1;
  add_surface(
      mesh, around, steps,
      [&](double a, double along) {
        const cv::Vec2d& p = profile[static_cast<std::size_t>(std::lround(along * steps))];
        const double angle = -2 * CV_PI * a;
        return from + axis * p[0] + (u * std::cos(angle) + v * std::sin(angle)) * p[1];
      },
      material);
}

// A tube along a closed curve.
void add_ring(Mesh& mesh, const std::function<cv::Vec3d(double)>& curve, double radius, int steps,
              int material) {
  const int sides = 8;
  add_surface(
      mesh, steps, sides,
      [&](double along, double side) {
        const cv::Vec3d center = curve(along);
        cv::Vec3d forward = curve(along + 1e-4) - curve(along - 1e-4);
        forward /= cv::norm(forward);
        const cv::Vec3d out(0, 0, 1);  // rims are nearly upright
        cv::Vec3d across = forward.cross(out);
        across /= cv::norm(across);
        const double angle = -2 * CV_PI * side;
        return center +
               (across * std::cos(angle) + across.cross(forward) * std::sin(angle)) * radius;
      },
      material);
}

void add_bar(Mesh& mesh, const cv::Vec3d& from, const cv::Vec3d& to, double radius, int material) {
  add_surface_of_revolution(mesh, from, to, {{0, 0}, {0, radius}, {1, radius}, {1, 0}}, 8,
                            material);
}

// Removes triangles without area (at the poles of solids of revolution).
void finish(Mesh& mesh) {
  std::erase_if(mesh.triangles, [&](const Triangle& t) {
    const auto p = [&](std::size_t k) {
      return mesh.positions[static_cast<std::size_t>(t.position[k])];
    };
    return cv::norm((p(1) - p(0)).cross(p(2) - p(0))) < 1e-9;
  });
  add_normals(mesh);
}

Mesh cube_of(bool textured) {
  Mesh mesh;
  for (int i = 0; i < 8; ++i) {
    mesh.positions.push_back(
        {(i & 1) != 0 ? 0.5F : -0.5F, (i & 2) != 0 ? 0.5F : -0.5F, (i & 4) != 0 ? 0.5F : -0.5F});
  }
  mesh.uvs = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  // Each face starts at the bottom left corner, counter-clockwise from outside; top and bottom are
  // oriented as if the cube were tilted.
  const int faces[6][4] = {{0, 1, 5, 4}, {1, 3, 7, 5}, {3, 2, 6, 7},
                           {2, 0, 4, 6}, {4, 5, 7, 6}, {2, 3, 1, 0}};
  const char* names[6] = {"front", "right", "back", "left", "top", "bottom"};
  const cv::Vec3f colors[6] = {{0.3F, 0.4F, 0.9F},  {0.35F, 0.8F, 0.4F}, {0.85F, 0.6F, 0.25F},
                               {0.3F, 0.8F, 0.95F}, {0.9F, 0.9F, 0.9F},  {0.6F, 0.35F, 0.7F}};
  for (int f = 0; f < 6; ++f) {
    const int material = add_material(mesh, names[f], textured ? cv::Vec3f(1, 1, 1) : colors[f]);
    const int* c = faces[f];
    quad(mesh, c[0], c[1], c[2], c[3], material);
    mesh.triangles[mesh.triangles.size() - 2].uv = {0, 1, 2};
    mesh.triangles.back().uv = {0, 2, 3};
  }
  return mesh;
}

}  // namespace

Mesh make_cube() {
  Mesh mesh = cube_of(false);
  add_normals(mesh);
  return mesh;
}

Mesh make_cube(const Texture& texture) {
  Mesh mesh = cube_of(true);
  mesh.textures.push_back(texture);
  for (Material& material : mesh.materials) material.texture = 0;
  add_normals(mesh);
  return mesh;
}

Mesh make_axes(double thickness) {
  TARSIER_REQUIRE(thickness > 0 && thickness < 1, "thickness of {}", thickness);
  Mesh mesh;
  const cv::Vec3f colors[3] = {{0.15F, 0.15F, 0.95F}, {0.2F, 0.75F, 0.2F}, {0.95F, 0.35F, 0.2F}};
  const char* names[3] = {"x", "y", "z"};
  const double r = thickness / 2;
  for (int k = 0; k < 3; ++k) {
    cv::Vec3d to(0, 0, 0);
    to[k] = 1;
    add_surface_of_revolution(mesh, {0, 0, 0}, to,
                              {{0, 0}, {0, r}, {0.8, r}, {0.8, 2.6 * r}, {1, 0}}, 20,
                              add_material(mesh, names[k], colors[k]));
  }
  finish(mesh);
  return mesh;
}

Mesh make_sphere(int rings, const cv::Vec3f& color) {
  TARSIER_REQUIRE(rings >= 2 && rings <= 2000, "a sphere of {} rings", rings);
  Mesh mesh;
  std::vector<cv::Vec2d> profile;
  for (int i = 0; i <= rings; ++i) {
    const double angle = CV_PI * i / rings;
    profile.push_back({(1 - std::cos(angle)) / 2, i == 0 || i == rings ? 0 : std::sin(angle)});
  }
  add_surface_of_revolution(mesh, {0, 0, -1}, {0, 0, 1}, profile, 2 * rings,
                            add_material(mesh, "ball", color));
  finish(mesh);
  return mesh;
}

Mesh make_glasses() {
  Mesh mesh;
  const int frame = add_material(mesh, "frame", {0.18F, 0.12F, 0.55F});
  const int metal = add_material(mesh, "temples", {0.25F, 0.22F, 0.22F});
  const double z = -24;
  for (const double side : {-1.0, 1.0}) {
    // A rim: a rounded square around the eye, slightly bent back at the temple.
    add_ring(
        mesh,
        [&](double t) {
          const double a = 2 * CV_PI * t;
          const double c = std::cos(a);
          const double s = std::sin(a);
          const double x = 25 * std::copysign(std::pow(std::abs(c), 0.75), c);
          const double y = 20 * std::copysign(std::pow(std::abs(s), 0.75), s);
          return cv::Vec3d(side * 33 + x, 5 + y, z + 0.004 * (33 + side * x) * (33 + side * x));
        },
        2.6, 48, frame);
    add_bar(mesh, {side * 57, -4, z + 13}, {side * 74, -4, z + 20}, 2.6, frame);
    add_bar(mesh, {side * 74, -4, z + 18}, {side * 78, -2, 92}, 2.0, metal);
    add_bar(mesh, {side * 78, -2, 91}, {side * 77, 22, 108}, 2.0, metal);
    add_bar(mesh, {0, -2, z - 3}, {side * 9.5, 1, z + 1}, 2.6, frame);
  }
  finish(mesh);
  return mesh;
}

Mesh make_hat() {
  Mesh mesh;
  const int felt = add_material(mesh, "felt", {0.23F, 0.2F, 0.2F});
  const int band = add_material(mesh, "band", {0.2F, 0.2F, 0.75F});
  // Tilted back with the skull; the brim has a small thickness.
  const cv::Vec3d base(0, -62, 62);
  const cv::Vec3d top = base + cv::Vec3d(0, -128, 22);
  add_surface_of_revolution(
      mesh, base, top, {{0.0, 78}, {-0.02, 126}, {0.01, 128}, {0.04, 126}, {0.04, 90}, {0.24, 89}},
      64, felt);
  add_surface_of_revolution(mesh, base, top, {{0.04, 91.5}, {0.24, 90.5}}, 64, band);
  add_surface_of_revolution(mesh, base, top, {{0.24, 89}, {0.97, 84}, {1, 80}, {1, 0}}, 64, felt);
  finish(mesh);
  return mesh;
}

const std::vector<std::string>& builtin_names() {
  static const std::vector<std::string> names{"cube", "axes", "sphere", "glasses", "hat"};
  return names;
}

std::optional<Mesh> builtin_mesh(std::string_view name) {
  if (name == "cube") return make_cube();
  if (name == "axes") return make_axes();
  if (name == "sphere") return make_sphere(32, {0.3F, 0.5F, 0.9F});
  if (name == "glasses") return make_glasses();
  if (name == "hat") return make_hat();
  return std::nullopt;
}

}  // namespace tarsier::render
