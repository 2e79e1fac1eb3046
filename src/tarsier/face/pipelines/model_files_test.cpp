// SPDX-License-Identifier: MIT
// Reads the installed files and writes them again: they must be the same byte for byte.
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head_view/view_model.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

namespace tarsier::face {
namespace {

class ModelFiles : public FolderTest {
 protected:
  template <class Read, class Write>
  void expect_same(const std::string& name, const Read& read, const Write& write) const {
    constexpr std::int64_t kMaxBytes = 100'000'000;
    const std::string shipped = std::string(TARSIER_SOURCE_MODELS) + "/" + name;
    write(path(name), read(shipped), read_any_archive(shipped).provenance);
    // EXPECT_EQ would print megabytes.
    EXPECT_TRUE(read_file(path(name), kMaxBytes) == read_file(shipped, kMaxBytes)) << name;
  }
};

TEST_F(ModelFiles, RoundTripKeepsEachByte) {
  expect_same("aam68.json", appearance::read_appearance_model, appearance::write_appearance_model);
  expect_same("face-detector.json", read_face_networks, write_face_networks);
  expect_same("head.json", head::read_head_model, head::write_head_model);
  expect_same("head-view.json", head_view::read_view_model, head_view::write_view_model);
  expect_same("landmarks68.json", landmarks::read_landmark_model, landmarks::write_landmark_model);
  expect_same("people-background.json", recognition::read_background,
              recognition::write_background);
}

}  // namespace
}  // namespace tarsier::face
