// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/text_files.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <fstream>

namespace tarsier::face::shape {
namespace {

class TextFiles : public testing::Test {
 protected:
  std::string file(const std::string& text) {
    const std::string path = folder_ / "shapes.txt";
    std::ofstream(path) << text;
    return path;
  }
  TemporaryFolder folder_;
};

TEST_F(TextFiles, ReadsShapesInOrder) {
  const auto shapes = read_text_shapes(file("# two triangles\n2 6\n0 0 1 0 0 1\n1.5 2 3 4 5 -6\n"));
  ASSERT_EQ(shapes.size(), 2U);
  EXPECT_EQ(shapes[0].cols(), 3);
  EXPECT_EQ(shapes[1](0, 0), 1.5);
  EXPECT_EQ(shapes[1](1, 2), -6);
}

TEST_F(TextFiles, DistinguishesShapesFromImageLists) {
  EXPECT_TRUE(is_text_shapes(file("2 6\n0 0 1 0 0 1\n1 2 3 4 5 6\n")));
  EXPECT_FALSE(is_text_shapes(file("a.jpg\nb.jpg\n")));
  EXPECT_FALSE(is_text_shapes(folder_ / "none.txt"));
}

TEST_F(TextFiles, RejectsInvalidShapesWithTheLine) {
  for (const char* text :
       {"", "2 5\n", "1 6\n1 2 3 4 5\n", "2 6\n1 2 3 4 5 6\n", "1 6\n1 2 3 4 5 nan\n",
        "1 6\n1 2 3 4 5 6\n1 2 3 4 5 6\n", "1 6\n1 2 3 4 5 1e9\n", "1e6 6 7\n"}) {
    EXPECT_THROW(static_cast<void>(read_text_shapes(file(text))), InputError) << text;
  }
  try {
    static_cast<void>(read_text_shapes(file("1 6\n\n1 2 3 x 5 6\n")));
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("line 3"), std::string::npos) << error.what();
  }
}

TEST_F(TextFiles, ReadsTriangles) {
  const auto triangles = read_triangles(file("0 1 2\n2 1 3 # the other\n"), 4);
  ASSERT_EQ(triangles.size(), 2U);
  EXPECT_EQ(triangles[1], (Triangle{2, 1, 3}));
  for (const char* text : {"", "0 1\n", "0 1 4\n", "0 1 1\n", "0 1 2.5\n", "-1 0 1\n"})
    EXPECT_THROW(static_cast<void>(read_triangles(file(text), 4)), InputError) << text;
}

}  // namespace
}  // namespace tarsier::face::shape
