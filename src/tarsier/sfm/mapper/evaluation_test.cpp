// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

namespace tarsier::sfm {
namespace {

class PoseTruthFile : public FolderTest {
 protected:
  PoseTruth read(const std::string& text) {
    std::ofstream(path("truth.jsonl")) << text;
    return read_pose_truth(path("truth.jsonl"));
  }
  std::string refusal(const std::string& text) {
    try {
      (void)read(text);
    } catch (const InputError& error) {
      return error.what();
    }
    return "it was read";
  }
};

constexpr const char* kLine = R"({"name":"a.jpg","R":[0,-1,0,1,0,0,0,0,1],"C":[1,2,3]})";
constexpr const char* kLines = R"({"name":"a.jpg","R":[0,-1,0,1,0,0,0,0,1],"C":[1,2,3]}

{"name":"b.jpg","R":[1,0,0,0,1,0,0,0,1],"t":[4,5,6]})";

TEST_F(PoseTruthFile, ConvertsCentresToTranslations) {
  const PoseTruth truth = read(kLines);
  ASSERT_EQ(truth.size(), 2U);
  EXPECT_EQ(truth.at("a.jpg").translation, Eigen::Vector3d(2, -1, -3));
  EXPECT_EQ(truth.at("b.jpg").translation, Eigen::Vector3d(4, 5, 6));
}

TEST_F(PoseTruthFile, ErrorsNameLine) {
  for (const char* bad : {"{", "[]"})
    EXPECT_THAT(refusal(fmt::format("{}\n{}", kLine, bad)), testing::HasSubstr("line 2")) << bad;
  EXPECT_THAT(refusal(R"({"name":"a","R":[2,0,0,0,1,0,0,0,1],"t":[0,0,0]})"),
              testing::HasSubstr("is not a rotation"));
  EXPECT_THAT(refusal(""), testing::HasSubstr("no poses"));
}

TEST_F(PoseTruthFile, RefusesDeeplyNestedLine) {
  std::string line = kLine;
  line.back() = ',';
  line += "\"x\":" + std::string(500, '[') + std::string(500, ']') + "}";
  EXPECT_THAT(refusal(line), testing::HasSubstr("line 1"));
}

}  // namespace
}  // namespace tarsier::sfm
