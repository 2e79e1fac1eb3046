// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_files.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cstdint>
#include <string>

namespace tarsier::sfm {
namespace {

using SurfaceFiles = FolderTest;
using testing::HasSubstr;

SurfaceMesh two_triangles() {
  SurfaceMesh mesh;
  mesh.vertices = {{0, 0, 0.25F}, {1, 0, 0.5F}, {1, 1, -2}, {0, 1, 3}};
  mesh.colors = {{1, 2, 3}, {40, 50, 60}, {0, 0, 255}, {255, 255, 255}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  return mesh;
}

std::string error_of_reading(const std::string& path) {
  try {
    (void)read_surface(path);
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

SurfaceMesh written_and_read(const std::string& path) {
  write_surface(path, {two_triangles(), std::nullopt});
  return read_surface(path);
}

TEST_F(SurfaceFiles, PlyRoundTrips) {
  const SurfaceMesh read = written_and_read(path("mesh.ply"));
  EXPECT_EQ(read.vertices, two_triangles().vertices);
  EXPECT_EQ(read.colors, two_triangles().colors);
  EXPECT_EQ(read.faces, two_triangles().faces);
}

TEST_F(SurfaceFiles, ExtensionsMayBeCapitals) {
  EXPECT_EQ(written_and_read(path("mesh.PLY")).faces, two_triangles().faces);
  EXPECT_EQ(written_and_read(path("mesh.Obj")).faces, two_triangles().faces);
}

TEST_F(SurfaceFiles, ObjRoundTripsWithoutColours) {
  const SurfaceMesh read = written_and_read(path("mesh.obj"));
  EXPECT_EQ(read.vertices, two_triangles().vertices);
  EXPECT_EQ(read.faces, two_triangles().faces);
}

void put(std::string& bytes, float value) {
  const auto word = std::bit_cast<std::uint32_t>(value);
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>(word >> shift));
}

// Four vertices, and a face of four corners with a property before its list and a list after it.
std::string other_layout(const std::string& corners = std::string("\x04\0\x01\x02\x03", 5),
                         const std::string& header = "element face 1\n") {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\n"
      "property float y\nproperty float z\n" +
      header +
      "property short label\nproperty list uchar uchar vertex_index\n"
      "property list uchar float texcoord\nend_header\n";
  for (const Eigen::Vector3f& vertex : two_triangles().vertices)
    for (int k = 0; k < 3; ++k) put(bytes, vertex[k]);
  bytes.append("ab");
  bytes += corners;
  bytes.push_back(1);
  put(bytes, 0.5F);
  return bytes;
}

TEST_F(SurfaceFiles, PolygonsAreTriangulated) {
  write_file_atomically(path("other.ply"), other_layout());
  const SurfaceMesh read = read_surface(path("other.ply"));
  EXPECT_EQ(read.vertices, two_triangles().vertices);
  EXPECT_TRUE(read.colors.empty());
  EXPECT_EQ(read.faces, two_triangles().faces);
}

TEST_F(SurfaceFiles, ErrorsNameTheFault) {
  const auto error_with = [&](const std::string& content) {
    write_file_atomically(path("bad.ply"), content);
    return error_of_reading(path("bad.ply"));
  };
  const std::string complete = other_layout();
  EXPECT_THAT(error_with(complete.substr(0, complete.size() - 1)), HasSubstr("truncated"));
  EXPECT_THAT(error_with(other_layout(std::string("\x03\0\x01\x04", 4))),
              HasSubstr("vertex 4 of 4"));
  EXPECT_THAT(error_with(other_layout(std::string("\x03\0\x01\x01", 4))), HasSubstr("no faces"));
  EXPECT_THAT(error_with(other_layout("", "element face 2000000000\n")), HasSubstr("more than"));
  EXPECT_THAT(error_with("ply\nformat binary_little_endian 1.0\nelement vertex 0\nend_header\n"),
              HasSubstr("no faces"));
  EXPECT_THAT(error_of_reading(path("none.ply")), HasSubstr("cannot be read"));
  EXPECT_THAT(error_of_reading(path("mesh.glb")), HasSubstr("not a .ply or .obj"));
}

}  // namespace
}  // namespace tarsier::sfm
