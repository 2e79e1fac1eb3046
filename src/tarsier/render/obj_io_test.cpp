// SPDX-License-Identifier: MIT
#include "tarsier/render/obj_io.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

namespace tarsier::render {
namespace {

using testing::HasSubstr;

class Obj : public FolderTest {
 protected:
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(path(name), std::ios::binary) << text;
    return path(name);
  }
  ObjFile read(const std::string& text, const ObjLimits& limits = {}) const {
    return read_obj(write("thing.obj", text), limits);
  }
  // The error message; it names the file.
  std::string refusal(const std::string& text, const ObjLimits& limits = {}) const {
    try {
      (void)read(text, limits);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(folder_));
      return error.what();
    }
    ADD_FAILURE() << "was read: " << text.substr(0, 80);
    return {};
  }
};

constexpr const char* kSquare = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

TEST_F(Obj, ReadsEveryFormOfFaces) {
  const std::string head = std::string(kSquare) + "vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 2\n";
  for (const char* face : {"f 1 2 3", "f 1/1 2/2 3/3", "f 1//1 2//1 3//1", "f 1/1/1 2/2/1 3/3/1",
                           "f -4 -3 -2", "f -4/-3/-1 -3/-2/-1 -2/-1/-1", "f\t1 2  3 \r"}) {
    const Mesh mesh = read(head + "# a face\n" + face + "  # comment\n").mesh;
    ASSERT_EQ(mesh.triangles.size(), 1U) << face;
    EXPECT_EQ(mesh.triangles[0].position, (std::array<int, 3>{0, 1, 2})) << face;
    mesh.check();
    const std::string text(face);
    const bool has_uv = text.find('/') != std::string::npos && text.find("//") == std::string::npos;
    EXPECT_EQ(mesh.triangles[0].uv[2], has_uv ? 2 : -1) << face;
    // Missing normals are computed, with length 1.
    const int normal = mesh.triangles[0].normal[0];
    EXPECT_EQ(mesh.normals.at(static_cast<std::size_t>(normal)), cv::Vec3f(0, 0, 1)) << face;
  }
}

TEST_F(Obj, PolygonsAreTriangulatedAndNegativeIndicesAreRelative) {
  const Mesh mesh =
      read(std::string(kSquare) + "f 1 2 3 4\nv 9 9 9\nv 8 8 8\nv 9 0 0\nf -1 -2 -3\n").mesh;
  ASSERT_EQ(mesh.triangles.size(), 3U);
  EXPECT_EQ(mesh.triangles[1].position, (std::array<int, 3>{0, 2, 3}));
  EXPECT_EQ(mesh.triangles[2].position, (std::array<int, 3>{6, 5, 4}));
}

TEST_F(Obj, ReadsColoursAndTextures) {
  write("a.mtl", "newmtl red paint\nKd 1 0.25 0\nnewmtl pic\nKd 1 1 1\nmap_Kd sub/image one.png\n");
  std::filesystem::create_directory(path("sub"));
  write_image(path("sub/image one.png"), cv::Mat(2, 3, CV_8UC3, cv::Scalar(1, 2, 3)));
  const ObjFile file = read(std::string("mtllib a.mtl\ng box\n") + kSquare +
                            "vt 0 0\nusemtl red paint\nf 1 2 3\nusemtl pic\nf 1/1 2/1 3/1\n"
                            "usemtl unknown\nf 1 3 4\n");
  EXPECT_TRUE(file.notes.empty());
  const Mesh& mesh = file.mesh;
  mesh.check();
  const auto material = [&](std::size_t t) {
    return mesh.materials.at(static_cast<std::size_t>(mesh.triangles.at(t).material));
  };
  EXPECT_EQ(material(0).color, cv::Vec3f(0, 0.25F, 1));  // BGR
  EXPECT_EQ(material(0).texture, -1);
  ASSERT_EQ(material(1).texture, 0);
  EXPECT_EQ(mesh.textures.at(0).levels.at(0).size(), cv::Size(3, 2));
  EXPECT_EQ(material(2).name, "unknown");
}

TEST_F(Obj, MissingMaterialsAndTexturesAreNotedNotFatal) {
  write("b.mtl", "newmtl m\nmap_Kd none.png\n");
  const ObjFile file = read(std::string("mtllib gone.mtl\nmtllib b.mtl\n") + kSquare + "f 1 2 3\n");
  ASSERT_EQ(file.notes.size(), 2U);
  EXPECT_THAT(file.notes[0], HasSubstr("gone.mtl"));
  EXPECT_THAT(file.notes[1], HasSubstr("none.png"));
}

TEST_F(Obj, RefusesBrokenNumbersAndIndices) {
  const std::string head = kSquare;
  EXPECT_THAT(refusal(head + "f 1 2 5\n"), HasSubstr("line 5"));
  EXPECT_THAT(refusal(head + "f 1 2 0\n"), HasSubstr("vertex 0 of 4"));
  EXPECT_THAT(refusal(head + "f 1 2 -5\n"), HasSubstr("vertex -5"));
  EXPECT_THAT(refusal(head + "f 1/1 2/1 3/1\n"), HasSubstr("texture coordinate 1 of 0"));
  EXPECT_THAT(refusal(head + "f 1//7 2//7 3//7\n"), HasSubstr("normal 7 of 0"));
  EXPECT_THAT(refusal(head + "f 1 2\n"), HasSubstr("fewer than three"));
  EXPECT_THAT(refusal(head + "f 1 2 99999999999999999999\n"), HasSubstr("is not an index"));
  EXPECT_THAT(refusal(head + "f 1 2 3x\n"), HasSubstr("'3x'"));
  EXPECT_THAT(refusal(head + "v nan 0 0\n"), HasSubstr("not finite"));
  EXPECT_THAT(refusal(head + "v 1e300 0 0\n"), HasSubstr("beyond 1e9"));
  EXPECT_THAT(refusal(head + "v 1e999 0 0\n"), HasSubstr("'1e999' is not a number"));
  EXPECT_THAT(refusal(head + "v 1" + std::string(400, '0') + " 0 0\n"),
              HasSubstr("is not a number"));
  EXPECT_THAT(refusal(head + "v 1 2\n"), HasSubstr("'' is not a number"));
  EXPECT_THAT(refusal(head), HasSubstr("has no faces"));
  EXPECT_THAT(refusal(""), HasSubstr("has no faces"));
  EXPECT_THAT(refusal(std::string("v 0 0 0\0", 8)), HasSubstr("is not an OBJ file"));
  EXPECT_THROW((void)read_obj(path("none.obj")), InputError);
  EXPECT_THROW((void)read_obj(folder_), InputError);
}

TEST_F(Obj, UnderflowingNumbersAreZero) {
  std::ofstream(path("thing.obj"))
      << "v 1e-999 -0." << std::string(400, '0') << "1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  EXPECT_EQ(read_obj(path("thing.obj")).mesh.positions[0], cv::Vec3f(0, 0, 0));
}

TEST_F(Obj, RefusesWhatIsTooLarge) {
  ObjLimits limits;
  limits.max_bytes = 1000;
  EXPECT_THAT(refusal(std::string(1001, '\n'), limits), HasSubstr("thing.obj"));
  limits = {};
  limits.max_faces = 5;
  std::string fan = std::string(kSquare) + "f";
  for (int i = 0; i < 8; ++i) fan += " 1";
  EXPECT_THAT(refusal(fan, limits), HasSubstr("more than 5 triangles"));
  EXPECT_THAT(refusal(std::string(kSquare) + "v 1 1 1\nv 1 1 1\nv 1 1 1\n", limits),
              HasSubstr("more than 5 vertices"));
  // A texture with a huge size in its header and no pixels is refused before it is decoded.
  limits = {};
  limits.max_texture_pixels = 4;
  write("c.mtl", "newmtl m\nmap_Kd big.png\n");
  write_image(path("big.png"), cv::Mat(3, 3, CV_8UC3, cv::Scalar(1, 2, 3)));
  EXPECT_THAT(refusal(std::string("mtllib c.mtl\n") + kSquare + "f 1 2 3\n", limits),
              HasSubstr("big.png"));
}

TEST_F(Obj, ReadsNothingOutsideItsFolder) {
  const TemporaryFolder elsewhere;
  std::ofstream(elsewhere / "x.mtl") << "newmtl m\n";
  const std::string rest = std::string("\n") + kSquare + "f 1 2 3\n";
  EXPECT_THAT(refusal("mtllib " + (elsewhere / "x.mtl") + rest),
              HasSubstr("not the name of a file"));
  EXPECT_THAT(refusal("mtllib ../x.mtl" + rest), HasSubstr("outside the folder"));
  EXPECT_THAT(refusal("mtllib a/../../x.mtl" + rest), HasSubstr("outside the folder"));
  std::filesystem::create_symlink(elsewhere / "x.mtl", path("link.mtl"));
  EXPECT_THAT(refusal("mtllib link.mtl" + rest), HasSubstr("outside the folder"));
  write("d.mtl", "newmtl m\nmap_Kd ../../etc/passwd\n");
  EXPECT_THAT(refusal("mtllib d.mtl" + rest), HasSubstr("outside the folder"));
  // A texture that is no image.
  write("e.mtl", "newmtl m\nmap_Kd e.mtl\n");
  EXPECT_THAT(refusal("mtllib e.mtl" + rest), HasSubstr("e.mtl"));
  // A file with more than 16 mtllib lines is refused.
  EXPECT_THAT(refusal([&] {
                std::string many;
                for (int i = 0; i < 20; ++i) many += "mtllib e2.mtl\n";
                write("e2.mtl", "newmtl m\n");
                return many;
              }() + rest),
              HasSubstr("more than 16"));
}

}  // namespace
}  // namespace tarsier::render
