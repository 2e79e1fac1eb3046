// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/inputs.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <string>
#include <vector>

namespace tarsier::sfm {
namespace {

class Inputs : public FolderTest {
 protected:
  void SetUp() override {
    for (const char* folder : {"one", "two"}) {
      make_folder(path(folder));
      for (const char* name : {"a.png", "b.png"})
        write_image(path(std::string(folder) + "/" + name), cv::Mat(20, 30, CV_8UC3, {9, 9, 9}));
    }
  }
  [[nodiscard]] static std::vector<Input> find(const std::vector<std::string>& sources) {
    NoProgress progress;
    return find_inputs(sources, {}, "", progress, {});
  }
  [[nodiscard]] static std::vector<std::string> names(const std::vector<Input>& inputs) {
    std::vector<std::string> result;
    std::transform(inputs.begin(), inputs.end(), std::back_inserter(result),
                   [](const Input& input) { return input.name; });
    return result;
  }
};

TEST_F(Inputs, AreFoundInFoldersImagesGlobsAndLists) {
  using Names = std::vector<std::string>;
  EXPECT_EQ(names(find({path("one")})), (Names{"a.png", "b.png"}));
  EXPECT_EQ(names(find({path("one/b.png"), path("two/a.png")})), (Names{"b.png", "a.png"}));
  EXPECT_EQ(names(find({path("one/b*.png")})), (Names{"b.png"}));
  write_file_atomically(path("list.txt"), path("two/b.png") + "\n" + path("one/a.png") + "\n");
  const auto listed = find({"@" + path("list.txt")});
  EXPECT_EQ(names(listed), (Names{"b.png", "a.png"}));
  EXPECT_EQ(listed[0].path, path("two/b.png"));
}

TEST_F(Inputs, ImagesInSubfoldersAreNamedByTheirPath) {
  using Names = std::vector<std::string>;
  const auto put = [&](const std::string& name) {
    make_folder(std::filesystem::path(path(name)).parent_path().string());
    write_image(path(name), cv::Mat(20, 30, CV_8UC3, {9, 9, 9}));
  };
  for (const char* name :
       {"rig/cam10/1.png", "rig/cam2/10.png", "rig/cam2/9.png", "rig/top.png", "rig/.hidden/1.png",
        "rig/model/view.png", "rig/out/frames/f.png", "rig/colmap/images/1.png"})
    put(name);
  write_file_atomically(path("rig/model/report.json"), "{}");
  make_folder(path("rig/colmap/sparse"));
  std::filesystem::create_directory_symlink(path("one"), path("rig/link"));
  std::filesystem::create_directory_symlink("..", path("rig/cam2/up"));
  NoProgress progress;
  const auto inputs = find_inputs({path("rig")}, {}, path("rig/out/frames"), progress, {});
  EXPECT_EQ(names(inputs), (Names{"cam2/9.png", "cam2/10.png", "cam10/1.png", "top.png"}));
  EXPECT_EQ(inputs[2].path, path("rig/cam10/1.png"));
  EXPECT_NO_THROW(require_names(inputs));
  // The images of two such folders get different names.
  EXPECT_EQ(names(find({path("rig/cam2"), path("rig/out"), path("rig/out/")})),
            (Names{"9.png", "10.png", "frames/f.png", "frames/f-2.png"}));
  // A folder with results is used if it is given itself.
  EXPECT_EQ(names(find({path("rig/model")})), (Names{"view.png"}));
}

TEST_F(Inputs, DuplicateNamesAreMadeUnique) {
  const auto inputs = find({path("one"), path("two"), path("one/a.png")});
  EXPECT_EQ(names(inputs),
            (std::vector<std::string>{"a.png", "b.png", "a-2.png", "b-2.png", "a-3.png"}));
  EXPECT_EQ(inputs[2].path, path("two/a.png"));
}

TEST_F(Inputs, MissingFilesCamerasAndVideosAreRefused) {
  EXPECT_THROW((void)find({path("missing")}), InputError);
  EXPECT_THROW((void)find({"7"}), InputError) << "a camera";
  // The start of an AVI file. Without a folder for its key frames it is not opened.
  write_file_atomically(path("video.avi"), std::string("RIFF\x10\0\0\0AVI LIST", 16));
  try {
    (void)find({path("video.avi")});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("key frames"), std::string::npos) << error.what();
  }
}

TEST_F(Inputs, AReconstructionNeedsTwoImages) {
  const auto inputs = find({path("one")});
  EXPECT_NO_THROW(require_two_images(inputs, "one"));
  try {
    require_two_images({inputs[0]}, "one");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "one: 1 image; a reconstruction needs two or more");
  }
}

TEST(KeyFrames, ArePathsWithTheirFrameNumber) {
  Keyframe frame;
  frame.index = 12;
  EXPECT_EQ(key_frame_path("frames", frame), "frames/frame-000012.png");
}

}  // namespace
}  // namespace tarsier::sfm
