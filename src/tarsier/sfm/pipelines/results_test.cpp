// SPDX-License-Identifier: MIT
#include "tarsier/sfm/pipelines/results.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

namespace tarsier::sfm {
namespace {

namespace fs = std::filesystem;

class Results : public FolderTest {
 protected:
  void write(const std::string& name, const std::string& text) {
    const fs::path path = fs::path(folder_) / name;
    make_folder(path.parent_path().string());
    write_file_atomically(path.string(), text);
  }
  void write_report(int models) {
    std::string list;
    for (int m = 0; m < models; ++m) list += std::string(m > 0 ? "," : "") + "{\"images\":7}";
    write("report.json", "{\"models\":[" + list + "],\"images\":[],\"stages\":[],\"log\":[]}");
  }
  void write_model(const std::string& name) {
    write_colmap(folder_ + "/" + name, synthetic_model());
    write(name + "/points.ply", "ply");
  }
  [[nodiscard]] bool has(const std::string& name) const {
    return fs::exists(fs::path(folder_) / name);
  }
};

TEST_F(Results, AnEarlierRunIsRecognisedByItsReport) {
  EXPECT_FALSE(earlier_run(folder_));
  write("report.json", "{\"models\": 3}");
  EXPECT_FALSE(earlier_run(folder_));
  write("report.json", "not JSON");
  EXPECT_FALSE(earlier_run(folder_));
  write_report(3);
  const auto run = earlier_run(folder_);
  ASSERT_TRUE(run);
  EXPECT_EQ(run->models, 3);
  EXPECT_EQ(run->registered, 7);
  EXPECT_FALSE(run->partial);
  // A report with the key names of an older program.
  write("report.json", R"({"models":[{"photographs":5}],"photographs":[],"stages":[],"story":[]})");
  ASSERT_TRUE(earlier_run(folder_));
  EXPECT_EQ(earlier_run(folder_)->registered, 5);
}

TEST_F(Results, ImagesAreFoundByTheirFolderOrTheReport) {
  write("elsewhere/a.jpg", "a");
  write("images/b.jpg", "b");
  write("report.json", R"({"images":[{"name":"a.jpg","file":")" + folder_ +
                           R"(/elsewhere/a.jpg"},{"name":"c.jpg"},7]})");
  const auto files = image_files(folder_, "", {"a.jpg", "b.jpg"});
  EXPECT_EQ(files.at("a.jpg"), folder_ + "/elsewhere/a.jpg");
  const std::string list = R"([{"name":"a.jpg","file":")" + folder_ + R"(/elsewhere/a.jpg"}])";
  write("report.json", R"({"photographs":)" + list + "}");  // of an older program
  EXPECT_EQ(image_files(folder_, "", {"a.jpg"}).at("a.jpg"), folder_ + "/elsewhere/a.jpg");
  write("report.json", R"({"images":)" + list + "}");
  EXPECT_EQ(fs::path(files.at("b.jpg")), fs::path(folder_) / "images" / "b.jpg");
  EXPECT_THROW((void)image_files(folder_, "", {"c.jpg"}), InputError);
  // A report from another source may name any file.
  EXPECT_THROW((void)image_files(folder_, "", {"a.jpg"}, false), InputError);
  EXPECT_EQ(image_files(folder_, "", {"b.jpg"}, false), image_files(folder_, "", {"b.jpg"}));
  // If a folder is given, only that folder is searched.
  EXPECT_THROW((void)image_files(folder_, folder_ + "/elsewhere", {"b.jpg"}), InputError);
}

TEST_F(Results, ReplacedFilesOfOtherProgramsAreKept) {
  const std::vector<std::string> names{"cameras.bin", "images.bin", "points3D.bin", "rigs.bin",
                                       "frames.bin",  "rigs.txt",   "frames.txt"};
  for (const std::string& name : names) write(name, "earlier");
  write("points.ply", "ply");
  remove_replaced_files(folder_);
  for (const std::string& name : names) EXPECT_TRUE(has(name)) << name;
  write_report(1);
  remove_replaced_files(folder_);
  for (const std::string& name : names) EXPECT_FALSE(has(name)) << name;
  EXPECT_TRUE(has("points.ply"));
}

TEST_F(Results, ModelsOfAnEarlierRunAreRemoved) {
  write_report(4);
  for (const char* name : {"model-1", "model-2", "model-3"}) write_model(name);
  write("model-2/notes.txt", "mine");
  // The output of export_undistorted, and an image of another origin.
  write_colmap(folder_ + "/model-3/undistorted/sparse", synthetic_model());
  for (const Image& image : synthetic_model().images)
    if (image.registered) write("model-3/undistorted/images/" + image.name, "image");
  EXPECT_EQ(remove_old_models(folder_, 2, earlier_run(folder_)), 2);
  EXPECT_TRUE(has("model-1/images.txt"));
  EXPECT_TRUE(has("model-2/notes.txt"));
  EXPECT_FALSE(has("model-2/images.txt"));
  EXPECT_FALSE(has("model-2/points.ply"));
  EXPECT_FALSE(has("model-3"));
}

TEST_F(Results, FoldersOfOthersAreNotRemoved) {
  write_report(2);
  for (const char* name : {"model-1", "model-5", "model-07", "model-x"}) write_model(name);
  write("model-5/report.json", "{\"models\":[]}");
  fs::create_directory_symlink(folder_ + "/model-5", folder_ + "/model-6");
  EXPECT_EQ(remove_old_models(folder_, 1, earlier_run(folder_)), 1);
  EXPECT_FALSE(has("model-1"));
  for (const char* name : {"model-5", "model-07", "model-x", "model-6"})
    EXPECT_TRUE(has(std::string(name) + "/images.txt")) << name;
}

// A run that was killed before its report was written. Its folders themselves mark their origin.
TEST_F(Results, AReportMarksAFolderAsThatOfARun) {
  begin_model_folder(folder_, 2);
  write_model("model-2");
  EXPECT_EQ(remove_old_models(folder_, 3, {}), 0);
  EXPECT_EQ(remove_old_models(folder_, 1, {}), 1);
  EXPECT_FALSE(has("model-2"));
}

}  // namespace
}  // namespace tarsier::sfm
