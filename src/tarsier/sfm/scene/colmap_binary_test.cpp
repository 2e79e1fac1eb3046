// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/colmap_binary.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/testing_model.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

void expect_same(const Model& a, const Model& b) {
  ASSERT_EQ(a.cameras.size(), b.cameras.size());
  for (std::size_t c = 0; c < a.cameras.size(); ++c) {
    EXPECT_EQ(a.cameras[c].matrix(), b.cameras[c].matrix());
    EXPECT_EQ(a.cameras[c].distortion, b.cameras[c].distortion);
  }
  ASSERT_EQ(a.images.size(), b.images.size());
  for (std::size_t i = 0; i < a.images.size(); ++i) {
    EXPECT_EQ(a.images[i].name, b.images[i].name);
    EXPECT_EQ(a.images[i].camera, b.images[i].camera);
    EXPECT_LT((a.images[i].pose.rotation - b.images[i].pose.rotation).norm(), 1e-12);
    EXPECT_EQ(a.images[i].pose.translation, b.images[i].pose.translation);
    EXPECT_EQ(a.images[i].points, b.images[i].points);
    ASSERT_EQ(a.images[i].features.size(), b.images[i].features.size());
    for (std::size_t f = 0; f < a.images[i].features.size(); ++f)
      EXPECT_LT(cv::norm(a.images[i].features[f] - b.images[i].features[f]), 1e-4);
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t p = 0; p < a.points.size(); ++p) {
    EXPECT_EQ(a.points[p].position, b.points[p].position);
    EXPECT_EQ(a.points[p].color, b.points[p].color);
    EXPECT_EQ(a.points[p].error, b.points[p].error);
    EXPECT_EQ(a.points[p].track, b.points[p].track);
  }
}

TEST(ColmapBinary, AFullDiskLeavesTheEarlierModel) {
  const Model model = synthetic_model();
  Model moved = model;
  moved.cameras[0].fx += 1;
  using Writer = void (*)(const std::string&, const Model&);
  for (const auto& [write, extension] :
       {std::pair<Writer, std::string>(write_colmap, ".txt"), {write_colmap_binary, ".bin"}}) {
    SCOPED_TRACE(extension);
    const TemporaryFolder folder;
    write(folder / "", model);
    const auto bytes_of = [&](const char* name) {
      return read_file(folder / (name + extension), 1'000'000);
    };
    const std::string cameras = bytes_of("cameras");
    const std::string images = bytes_of("images");
    std::filesystem::remove(folder / ("points3D" + extension));
    std::filesystem::create_symlink("/dev/full", folder / ("points3D" + extension));
    EXPECT_THROW(write(folder / "", moved), OutputError);
    EXPECT_EQ(bytes_of("cameras"), cameras);
    EXPECT_EQ(bytes_of("images"), images);
  }
}

TEST(ColmapBinary, HasTheSameModelAsTheText) {
  const TemporaryFolder folder;
  const Model model = synthetic_model();
  write_colmap((folder / "text"), model);
  write_colmap_binary((folder / "binary"), model);
  EXPECT_TRUE(is_colmap_binary((folder / "binary")));
  EXPECT_FALSE(is_colmap_binary((folder / "text")));
  const Model text = read_colmap((folder / "text"));
  expect_same(read_colmap((folder / "binary")), text);
  const Model poses = read_colmap_poses((folder / "binary"));
  ASSERT_EQ(poses.images.size(), text.images.size());
  EXPECT_TRUE(poses.points.empty());
  EXPECT_TRUE(poses.images[0].features.empty());
}

TEST(ColmapBinary, TruncatedFilesAreRefused) {
  const TemporaryFolder folder;
  Model model = synthetic_model();
  write_colmap_binary((folder / "model"), model);
  for (const char* name : {"cameras.bin", "images.bin", "points3D.bin"}) {
    const std::string path = (folder / "model") + "/" + name;
    const std::string complete = read_file(path, 100'000'000);
    for (const double share : {0.0, 0.001, 0.3, 0.77, 0.9999}) {
      const auto length = static_cast<std::size_t>(share * static_cast<double>(complete.size()));
      write_file_atomically(path, complete.substr(0, length));
      EXPECT_THROW((void)read_colmap_binary((folder / "model")), InputError) << name << share;
    }
    write_file_atomically(path, complete + "x");
    EXPECT_THROW((void)read_colmap_binary((folder / "model")), InputError) << name;
    write_file_atomically(path, complete);
  }
  EXPECT_NO_THROW((void)read_colmap_binary((folder / "model")));
}

TEST(ColmapBinary, CountsBeyondTheFileSizeAreRefused) {
  const TemporaryFolder folder;
  write_colmap_binary((folder / "model"), synthetic_model());
  const auto error_of = [&](const char* name, std::size_t at, std::uint64_t number) {
    const std::string path = (folder / "model") + "/" + name;
    const std::string complete = read_file(path, 100'000'000);
    std::string changed = complete;
    std::memcpy(changed.data() + at, &number, sizeof number);
    write_file_atomically(path, changed);
    std::string what = "read";
    try {
      (void)read_colmap_binary((folder / "model"));
    } catch (const InputError& error) {
      what = error.what();
    }
    write_file_atomically(path, complete);
    return what;
  };
  EXPECT_THAT(error_of("cameras.bin", 0, std::uint64_t{1} << 60), HasSubstr("truncated"));
  EXPECT_THAT(error_of("images.bin", 0, 999'999), HasSubstr("truncated"));
  EXPECT_THAT(error_of("points3D.bin", 0, std::uint64_t{1} << 40), HasSubstr("truncated"));
  EXPECT_THAT(error_of("cameras.bin", 8, 1 | (std::uint64_t{77} << 32)),
              HasSubstr("model number 77"));
  EXPECT_THAT(error_of("images.bin", 12, 0x7ff8000000000000U), HasSubstr("not finite"));
}

}  // namespace
}  // namespace tarsier::sfm
