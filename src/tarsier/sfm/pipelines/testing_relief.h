// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/image_file.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/synth/sfm_scene.h"

#include <fmt/format.h>

#include <vector>

namespace tarsier::sfm {

// Writes five images of a relief, 240 x 180 px, to images/0.png .. 4.png of each test's folder.
// They are rendered once for all tests.
class ReliefFolderTest : public FolderTest {
 protected:
  static constexpr int kImages = 5;

  static void SetUpTestSuite() {
    synth::SceneOptions options;
    options.size = {240, 180};
    options.images = kImages;
    scene_ = new synth::SfmScene(options);
    images_ = new std::vector<cv::Mat>();
    for (int i = 0; i < kImages; ++i) images_->push_back(scene_->render(i));
  }
  static void TearDownTestSuite() {
    delete images_;
    delete scene_;
  }
  void SetUp() override {
    make_folder(path("images"));
    for (int i = 0; i < kImages; ++i)
      write_image(path(fmt::format("images/{}.png", i)), (*images_)[static_cast<std::size_t>(i)]);
  }

  inline static synth::SfmScene* scene_ = nullptr;
  inline static std::vector<cv::Mat>* images_ = nullptr;
};

}  // namespace tarsier::sfm
