// SPDX-License-Identifier: MIT
#include "tarsier/face/head/point_file.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

namespace tarsier::face::head {
namespace {

using testing::HasSubstr;

class PointFile : public FolderTest {
 protected:
  std::string write(const std::string& text) const {
    std::ofstream(path("points.txt"), std::ios::binary) << text;
    return path("points.txt");
  }
  std::string refusal(const std::string& text, int dimensions = 2) const {
    try {
      (void)read_point_file(write(text), dimensions);
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("points.txt"));
      return error.what();
    }
    ADD_FAILURE() << "was read: " << text;
    return {};
  }
};

TEST_F(PointFile, ReadsNumbersWithBlanksCommasAndComments) {
  const Eigen::MatrixXd points =
      read_point_file(write("# object\n1 2 3\r\n\n  +4,\t-5.5 , 6e1 # the second\n0 0 0"), 3);
  ASSERT_EQ(points.cols(), 3);
  EXPECT_EQ(points.col(0), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(points.col(1), Eigen::Vector3d(4, -5.5, 60));
}

TEST_F(PointFile, RejectsInvalidLines) {
  EXPECT_THAT(refusal("1 2\n3\n"), HasSubstr("line 2: 1 numbers where a point has 2"));
  EXPECT_THAT(refusal("1 2 3\n"), HasSubstr("line 1"));
  EXPECT_THAT(refusal("1 nan\n"), HasSubstr("not finite"));
  EXPECT_THAT(refusal("1 1e10\n"), HasSubstr("beyond 1e9"));
  EXPECT_THAT(refusal("1 2x\n"), HasSubstr("expected a number, got '2x'"));
  EXPECT_THAT(refusal("# nothing\n"), HasSubstr("has no points"));
  std::string line;
  for (int i = 0; i < 1000; ++i) line += "1 ";
  EXPECT_THAT(refusal(line), HasSubstr("too long"));
  EXPECT_THROW((void)read_point_file(path("gone.txt"), 2), InputError);
  EXPECT_THROW((void)read_point_file(folder_, 2), InputError);
}

TEST_F(PointFile, LandmarkFilesMayStateTheirCount) {
  EXPECT_EQ(read_landmarks3d(write("2 100\n1 2 3\n4 5 6\n7 8 9\nmore words\n")).cols(), 2);
  EXPECT_EQ(read_landmarks3d(write("1 2 3\n4 5 6\n")).cols(), 2);
  EXPECT_THROW((void)read_landmarks3d(write("-4 2\n1 2 3\n")), InputError);
}

}  // namespace
}  // namespace tarsier::face::head
