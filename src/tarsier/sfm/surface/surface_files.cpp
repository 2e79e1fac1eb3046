// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_files.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/render/obj_io.h"
#include "tarsier/sfm/dense/ply_file.h"
#include "tarsier/sfm/scene/little_endian.h"
#include "tarsier/sfm/surface/glb.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxElements = 20'000'000;  // max vertices, faces of a file
constexpr std::int64_t kMaxObjBytes = 2'000'000'000;
constexpr int kMaxCorners = 1000;  // max per face, also for other lists

std::string with_extension(const std::string& path, const char* extension) {
  return fs::path(path).replace_extension(extension).string();
}

std::string ply_of(const TexturedSurface& surface, const std::string& image_name) {
  const SurfaceMesh& mesh = surface.mesh;
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment Tarsier\n";
  if (surface.texture) bytes += "comment TextureFile " + image_name + "\n";
  bytes += fmt::format(
      "element vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\n",
      mesh.vertices.size());
  if (!mesh.colors.empty())
    bytes += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
  bytes +=
      fmt::format("element face {}\nproperty list uchar int vertex_indices\n", mesh.faces.size());
  if (surface.texture) bytes += "property list uchar float texcoord\n";
  bytes += "end_header\n";
  const std::vector<Eigen::Vector3f> normals = vertex_normals(mesh);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    for (int k = 0; k < 3; ++k) put(bytes, mesh.vertices[v][k]);
    for (int k = 0; k < 3; ++k) put(bytes, normals[v][k]);
    if (mesh.colors.empty()) continue;
    for (int k = 2; k >= 0; --k) bytes.push_back(static_cast<char>(mesh.colors[v][k]));
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    bytes.push_back(3);
    for (const int v : mesh.faces[f]) put(bytes, static_cast<std::uint32_t>(v));
    if (!surface.texture) continue;
    bytes.push_back(6);
    for (const int corner : surface.texture->corners[f]) {
      const cv::Vec2f& uv = surface.texture->uvs[at(corner)];
      put(bytes, uv[0]);
      put(bytes, uv[1]);
    }
  }
  return bytes;
}

std::string obj_of(const TexturedSurface& surface, const std::string& library) {
  const SurfaceMesh& mesh = surface.mesh;
  std::string text = "# Tarsier\n";
  auto out = std::back_inserter(text);
  if (surface.texture) fmt::format_to(out, "mtllib {}\n", library);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3f& x = mesh.vertices[v];
    fmt::format_to(out, "v {:.7g} {:.7g} {:.7g}", x[0], x[1], x[2]);
    if (!mesh.colors.empty() && !surface.texture) {
      const cv::Vec3b& bgr = mesh.colors[v];
      fmt::format_to(out, " {:.4f} {:.4f} {:.4f}", bgr[2] / 255.0, bgr[1] / 255.0, bgr[0] / 255.0);
    }
    text += '\n';
  }
  for (const Eigen::Vector3f& n : vertex_normals(mesh))
    fmt::format_to(out, "vn {:.4f} {:.4f} {:.4f}\n", n[0], n[1], n[2]);
  if (surface.texture) {
    for (const cv::Vec2f& uv : surface.texture->uvs)
      fmt::format_to(out, "vt {:.6f} {:.6f}\n", uv[0], uv[1]);
    text += "usemtl surface\n";
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    text += 'f';
    for (std::size_t k = 0; k < 3; ++k) {
      const int v = mesh.faces[f][k] + 1;
      if (surface.texture) {
        fmt::format_to(out, " {}/{}/{}", v, surface.texture->corners[f][k] + 1, v);
      } else {
        fmt::format_to(out, " {}//{}", v, v);
      }
    }
    text += '\n';
  }
  return text;
}

SurfaceMesh mesh_of_obj(const std::string& path) {
  render::ObjLimits limits;
  limits.max_bytes = kMaxObjBytes;
  limits.max_faces = kMaxElements;
  const render::ObjFile file = render::read_obj(path, limits);
  SurfaceMesh mesh;
  for (const cv::Vec3f& x : file.mesh.positions) mesh.vertices.emplace_back(x[0], x[1], x[2]);
  for (const render::Triangle& triangle : file.mesh.triangles)
    mesh.faces.push_back(triangle.position);
  return mesh;
}

// Reads records of a PLY file, one number after the other.
class PlyRecords {
 public:
  PlyRecords(std::istream& stream, const std::string& path) : stream_(stream), path_(path) {}

  double number(PlyType type) {
    char bytes[8];
    read(bytes, type.bytes);
    return type.read(bytes);
  }
  void read(char* bytes, std::size_t count) {
    if (!stream_.read(bytes, static_cast<std::streamsize>(count)))
      throw InputError(path_, "is truncated before its last record");
  }

 private:
  std::istream& stream_;
  const std::string& path_;
};

void read_vertices(PlyRecords& records, const PlyElement& element, const std::string& path,
                   SurfaceMesh& mesh) {
  const PlyProperty* const coordinates[] = {element.find("x"), element.find("y"),
                                            element.find("z")};
  const PlyProperty* const color[] = {element.find("blue"), element.find("green"),
                                      element.find("red")};
  if (std::count(std::begin(coordinates), std::end(coordinates), nullptr) > 0)
    throw InputError(path, "has no vertices with x, y and z");
  const bool is_colored = std::count(std::begin(color), std::end(color), nullptr) == 0;
  std::vector<char> record(element.bytes);
  for (std::int64_t i = 0; i < element.count; ++i) {
    records.read(record.data(), record.size());
    const auto number = [&](const PlyProperty* property) {
      return property->type.read(record.data() + property->offset);
    };
    Eigen::Vector3f vertex;
    for (int k = 0; k < 3; ++k) vertex[k] = static_cast<float>(number(coordinates[k]));
    if (!vertex.allFinite())
      throw InputError(path, fmt::format("vertex {} has numbers that are not finite", i));
    mesh.vertices.push_back(vertex);
    if (!is_colored) continue;
    cv::Vec3b bgr;
    for (int k = 0; k < 3; ++k) bgr[k] = cv::saturate_cast<std::uint8_t>(number(color[k]));
    mesh.colors.push_back(bgr);
  }
}

void read_faces(PlyRecords& records, const PlyElement& element, const std::string& path,
                SurfaceMesh& mesh) {
  const PlyProperty* indices = element.find("vertex_indices");
  if (indices == nullptr) indices = element.find("vertex_index");
  if (indices == nullptr || !indices->is_list())
    throw InputError(path, "has faces without the list 'vertex_indices'");
  const auto vertices = static_cast<double>(mesh.vertices.size());
  std::vector<int> polygon;
  for (std::int64_t i = 0; i < element.count; ++i) {
    polygon.clear();
    for (const PlyProperty& property : element.properties) {
      const double count = property.is_list() ? records.number(property.count) : 1;
      if (!(count >= 0 && count <= kMaxCorners))
        throw InputError(path, fmt::format("face {} has a list of {} numbers", i, count));
      for (int k = 0; k < static_cast<int>(count); ++k) {
        const double value = records.number(property.type);
        if (&property != indices) continue;
        if (!(value >= 0 && value < vertices))
          throw InputError(path,
                           fmt::format("face {} refers to vertex {} of {}", i, value, vertices));
        polygon.push_back(static_cast<int>(value));
      }
    }
    for (std::size_t k = 2; k < polygon.size(); ++k)
      mesh.faces.push_back({polygon[0], polygon[k - 1], polygon[k]});
    if (mesh.faces.size() > kMaxElements)
      throw InputError(path, fmt::format("has more than {} triangles", kMaxElements));
  }
}

SurfaceMesh mesh_of_ply(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError(path, "cannot be read");
  const std::vector<PlyElement> elements = read_ply_header(stream, path);
  SurfaceMesh mesh;
  if (elements.size() < 2 || elements[1].name != "face") return mesh;
  for (const PlyElement& element : elements) {
    if (element.count > kMaxElements)
      throw InputError(path, fmt::format("has more than {} of '{}'", kMaxElements, element.name));
  }
  PlyRecords records(stream, path);
  read_vertices(records, elements[0], path, mesh);
  read_faces(records, elements[1], path, mesh);
  return mesh;
}

}  // namespace

SurfaceFormat surface_format_of(const std::string& path) {
  const std::string extension = lowercase_extension(path);
  if (extension == ".ply") return SurfaceFormat::kPly;
  if (extension == ".obj") return SurfaceFormat::kObj;
  if (extension == ".glb") return SurfaceFormat::kGlb;
  throw UsageError(fmt::format("'{}': a surface is written as .ply, .obj or .glb", path));
}

std::vector<std::string> surface_files(const std::string& path, bool textured) {
  std::vector<std::string> files;
  const SurfaceFormat format = surface_format_of(path);
  if (textured && format != SurfaceFormat::kGlb) files.push_back(with_extension(path, ".png"));
  if (textured && format == SurfaceFormat::kObj) files.push_back(with_extension(path, ".mtl"));
  files.push_back(path);
  return files;
}

void write_surface(const std::string& path, const TexturedSurface& surface,
                   const Eigen::Matrix3d& upright) {
  surface.mesh.check();
  if (surface.texture)
    TARSIER_REQUIRE(surface.texture->corners.size() == surface.mesh.faces.size(),
                    "the texture belongs to another surface");
  const SurfaceFormat format = surface_format_of(path);
  if (format == SurfaceFormat::kGlb) {
    write_file_atomically(path, glb_of(surface, upright, path));
    return;
  }
  const std::string image = with_extension(path, ".png");
  const std::string image_name = fs::path(image).filename().string();
  if (surface.texture) write_image(image, surface.texture->image);
  if (format == SurfaceFormat::kPly) {
    write_file_atomically(path, ply_of(surface, image_name));
    return;
  }
  const std::string library = with_extension(path, ".mtl");
  if (surface.texture) {
    write_file_atomically(
        library, fmt::format("newmtl surface\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 1\nmap_Kd {}\n",
                             image_name));
  }
  write_file_atomically(path, obj_of(surface, fs::path(library).filename().string()));
}

SurfaceMesh read_surface(const std::string& path) {
  const std::string extension = lowercase_extension(path);
  SurfaceMesh mesh;
  if (extension == ".obj") {
    mesh = mesh_of_obj(path);
  } else if (extension == ".ply") {
    mesh = mesh_of_ply(path);
  } else {
    throw InputError(path, "is not a .ply or .obj file: write one with sfm mesh -o NAME.ply");
  }
  std::erase_if(mesh.faces, [](const Face& face) {
    return face[0] == face[1] || face[1] == face[2] || face[2] == face[0];
  });
  if (mesh.faces.empty()) throw InputError(path, "has no faces: expected a surface");
  return mesh;
}

render::Mesh render_mesh(const TexturedSurface& surface) {
  const SurfaceMesh& mesh = surface.mesh;
  render::Mesh result;
  for (const Eigen::Vector3f& x : mesh.vertices) result.positions.emplace_back(x[0], x[1], x[2]);
  for (const Eigen::Vector3f& n : vertex_normals(mesh))
    result.normals.emplace_back(n[0], n[1], n[2]);
  const bool colored = !mesh.colors.empty() && !mesh.faces.empty();
  // For coloured faces, each face has its own pixel.
  const int across =
      std::max(1, static_cast<int>(std::ceil(std::sqrt(static_cast<double>(mesh.faces.size())))));
  cv::Mat pixels;
  if (surface.texture) {
    result.textures.push_back(render::make_texture(surface.texture->image));
    result.uvs = surface.texture->uvs;
  } else if (colored) {
    pixels = cv::Mat(across, across, CV_8UC3, cv::Scalar::all(0));
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    render::Triangle triangle;
    triangle.position = mesh.faces[f];
    triangle.normal = mesh.faces[f];
    if (surface.texture) {
      triangle.uv = surface.texture->corners[f];
      triangle.material = 0;
    } else if (colored) {
      cv::Vec3f sum(0, 0, 0);
      for (const int v : mesh.faces[f]) sum += cv::Vec3f(mesh.colors[at(v)]) / 3;
      const int x = static_cast<int>(f) % across;
      const int y = static_cast<int>(f) / across;
      pixels.at<cv::Vec3b>(y, x) = cv::Vec3b(sum);
      triangle.uv.fill(static_cast<int>(f));
      result.uvs.emplace_back((static_cast<float>(x) + 0.5F) / static_cast<float>(across),
                              1 - (static_cast<float>(y) + 0.5F) / static_cast<float>(across));
      triangle.material = 0;
    }
    result.triangles.push_back(triangle);
  }
  if (surface.texture || colored) {
    if (!surface.texture) result.textures.push_back({{pixels}});
    result.materials.push_back({"surface", {1, 1, 1}, 0});
  }
  return result;
}

}  // namespace tarsier::sfm
