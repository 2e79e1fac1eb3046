// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/model_store.h"

#include <gtest/gtest.h>
#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <string>

// Helpers for tests: the shipped models, and one face of the package opencv-doc.
namespace tarsier::face {

inline constexpr const char* kMessi = "/usr/share/doc/opencv-doc/examples/data/messi5.jpg";

inline const ModelStore& models() {
  static const ModelStore store(TARSIER_SOURCE_MODELS);
  return store;
}

inline Frame frame_of(const cv::Mat& image, int index, bool still,
                      const std::string& name = "a.mp4") {
  Frame frame;
  frame.image = image;
  frame.index = index;
  frame.time = 0.04 * index;
  frame.name = name;
  frame.still = still;
  return frame;
}

class MessiTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(kMessi)) GTEST_SKIP() << "needs the package opencv-doc";
    image_ = read_image(kMessi);
  }
  [[nodiscard]] Frame frame(int index, bool still, const std::string& name = "a.mp4") const {
    return frame_of(image_, index, still, name);
  }
  cv::Mat image_;
};

}  // namespace tarsier::face
