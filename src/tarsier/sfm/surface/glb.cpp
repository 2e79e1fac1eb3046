// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/glb.h"

#include "tarsier/core/at.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/scene/little_endian.h"
#include "tarsier/sfm/surface/surface_corners.h"

#include <algorithm>
#include <bit>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>

namespace tarsier::sfm {
namespace {

using Json = nlohmann::ordered_json;

// Constants of the specification.
constexpr std::uint32_t kMagic = 0x46546C67;  // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;
constexpr std::uint32_t kBinaryChunk = 0x004E4942;
constexpr int kUnsignedByte = 5121;
constexpr int kUnsignedInt = 5125;
constexpr int kFloat = 5126;
constexpr int kVertices = 34962;
constexpr int kIndices = 34963;
constexpr int kLinear = 9729;
constexpr int kLinearMipmaps = 9987;
constexpr int kClamp = 33071;

class Writer {
 public:
  // Makes a view of the data put into `binary` after the previous view. Returns its index.
  int add_view(int target, int stride = 0) {
    Json view{{"buffer", 0}, {"byteOffset", begin_}, {"byteLength", binary.size() - begin_}};
    if (stride > 0) view["byteStride"] = stride;
    if (target > 0) view["target"] = target;
    views_.push_back(view);
    while (binary.size() % 4 != 0) binary.push_back(0);
    begin_ = binary.size();
    return static_cast<int>(views_.size()) - 1;
  }
  int add_accessor(int view, int type, std::size_t count, const char* shape) {
    accessors_.push_back(
        {{"bufferView", view}, {"componentType", type}, {"count", count}, {"type", shape}});
    return static_cast<int>(accessors_.size()) - 1;
  }
  Json& accessor(int index) { return accessors_[at(index)]; }

  [[nodiscard]] std::string file(Json json, const std::string& name) const {
    json["accessors"] = accessors_;
    json["bufferViews"] = views_;
    json["buffers"] = {{{"byteLength", binary.size()}}};
    std::string text = json.dump();
    while (text.size() % 4 != 0) text.push_back(' ');
    const std::size_t length = 12 + 8 + text.size() + 8 + binary.size();
    if (length > std::numeric_limits<std::uint32_t>::max())
      throw OutputError(name,
                        "a .glb file is limited to 4 GB: reduce the number of faces (option "
                        "'faces'), or write .ply");
    std::string bytes;
    bytes.reserve(length);
    put(bytes, kMagic);
    put(bytes, std::uint32_t{2});
    put(bytes, static_cast<std::uint32_t>(length));
    put(bytes, static_cast<std::uint32_t>(text.size()));
    put(bytes, kJsonChunk);
    bytes += text;
    put(bytes, static_cast<std::uint32_t>(binary.size()));
    put(bytes, kBinaryChunk);
    return bytes + binary;
  }

  std::string binary;

 private:
  Json views_ = Json::array();
  Json accessors_ = Json::array();
  std::size_t begin_ = 0;
};

int add_positions(Writer& writer, const SurfaceMesh& mesh, const SurfaceCorners& corners) {
  Eigen::Vector3f low = mesh.vertices[at(corners.vertex[0])];
  Eigen::Vector3f high = low;
  for (const int v : corners.vertex) {
    const Eigen::Vector3f& x = mesh.vertices[at(v)];
    for (int k = 0; k < 3; ++k) put(writer.binary, x[k]);
    low = low.cwiseMin(x);
    high = high.cwiseMax(x);
  }
  const int accessor =
      writer.add_accessor(writer.add_view(kVertices), kFloat, corners.vertex.size(), "VEC3");
  writer.accessor(accessor)["min"] = {low[0], low[1], low[2]};
  writer.accessor(accessor)["max"] = {high[0], high[1], high[2]};
  return accessor;
}

int add_normals(Writer& writer, const SurfaceMesh& mesh, const SurfaceCorners& corners) {
  const std::vector<Eigen::Vector3f> normals = vertex_normals(mesh);
  for (const int v : corners.vertex) {
    const Eigen::Vector3f& given = normals[at(v)];
    const Eigen::Vector3f normal =
        given.squaredNorm() > 0 ? given : Eigen::Vector3f(Eigen::Vector3f::UnitZ());
    for (int k = 0; k < 3; ++k) put(writer.binary, normal[k]);
  }
  return writer.add_accessor(writer.add_view(kVertices), kFloat, corners.vertex.size(), "VEC3");
}

int add_uvs(Writer& writer, const SurfaceTexture& texture, const SurfaceCorners& corners) {
  for (const int uv : corners.uv) {
    put(writer.binary, texture.uvs[at(uv)][0]);
    put(writer.binary, 1 - texture.uvs[at(uv)][1]);  // glTF counts from the top
  }
  return writer.add_accessor(writer.add_view(kVertices), kFloat, corners.vertex.size(), "VEC2");
}

// glTF's colours are linear, those of images are sRGB.
int add_colors(Writer& writer, const SurfaceMesh& mesh, const SurfaceCorners& corners) {
  for (const int v : corners.vertex) {
    for (int k = 2; k >= 0; --k) {
      const double value = mesh.colors[at(v)][k] / 255.0;
      const double linear =
          value <= 0.04045 ? value / 12.92 : std::pow((value + 0.055) / 1.055, 2.4);
      writer.binary.push_back(static_cast<char>(std::lround(linear * 255)));
    }
    writer.binary.push_back(static_cast<char>(255));
  }
  const int accessor = writer.add_accessor(writer.add_view(kVertices, 4), kUnsignedByte,
                                           corners.vertex.size(), "VEC4");
  writer.accessor(accessor)["normalized"] = true;
  return accessor;
}

}  // namespace

std::string glb_of(const TexturedSurface& surface, const Eigen::Matrix3d& upright,
                   const std::string& name) {
  Json json{{"asset", {{"version", "2.0"}, {"generator", "Tarsier"}}},
            {"scene", 0},
            {"scenes", {{{"nodes", Json::array()}}}}};
  if (surface.mesh.faces.empty()) {
    json["scenes"] = Json::array({Json::object()});
    return Writer().file(json, name);
  }
  const SurfaceCorners corners = corners_of(surface);
  Writer writer;
  Json attributes{{"POSITION", add_positions(writer, surface.mesh, corners)},
                  {"NORMAL", add_normals(writer, surface.mesh, corners)}};
  Json material{{"name", "surface"},
                {"doubleSided", true},
                {"pbrMetallicRoughness", {{"metallicFactor", 0}, {"roughnessFactor", 1}}}};
  const bool colored = surface.texture || !surface.mesh.colors.empty();
  if (surface.texture) {
    attributes["TEXCOORD_0"] = add_uvs(writer, *surface.texture, corners);
    const std::vector<std::uint8_t> jpeg = encode_image(".jpg", surface.texture->image, name, 95);
    writer.binary.append(jpeg.begin(), jpeg.end());
    json["images"] = {{{"mimeType", "image/jpeg"}, {"bufferView", writer.add_view(0)}}};
    json["samplers"] = {{{"magFilter", kLinear},
                         {"minFilter", kLinearMipmaps},
                         {"wrapS", kClamp},
                         {"wrapT", kClamp}}};
    json["textures"] = {{{"sampler", 0}, {"source", 0}}};
    material["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", 0}};
  } else if (colored) {
    attributes["COLOR_0"] = add_colors(writer, surface.mesh, corners);
  }
  if (colored) {
    material["extensions"] = {{"KHR_materials_unlit", Json::object()}};
    json["extensionsUsed"] = {"KHR_materials_unlit"};
  }
  json["materials"] = {material};
  for (const std::uint32_t index : corners.indices) put(writer.binary, index);
  const int indices = writer.add_accessor(writer.add_view(kIndices), kUnsignedInt,
                                          corners.indices.size(), "SCALAR");
  json["meshes"] = {
      {{"primitives", {{{"attributes", attributes}, {"indices", indices}, {"material", 0}}}}}};
  Json matrix = Json::array();  // column-major
  for (int column = 0; column < 4; ++column) {
    for (int row = 0; row < 4; ++row)
      matrix.push_back(row < 3 && column < 3 ? upright(row, column) : row == column ? 1.0 : 0.0);
  }
  json["nodes"] = {{{"mesh", 0}, {"matrix", matrix}}};
  json["scenes"][0]["nodes"] = {0};
  return writer.file(json, name);
}

}  // namespace tarsier::sfm
