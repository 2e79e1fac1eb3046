// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"

#include <opencv2/core/mat.hpp>

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::test_support {

// Records the names of the stages that a session passes while it is watched.
class WatchedStages final : public DebugSink {
 public:
  void image(std::string_view name, const cv::Mat& image) override {
    are_images = are_images && !image.empty() && image.depth() == CV_8U;
    names.emplace_back(name);
  }
  [[nodiscard]] bool is_watched() const override { return watched; }

  bool watched = false;
  bool are_images = true;  // none was empty, all have 8 bits
  std::vector<std::string> names;
};

}  // namespace tarsier::test_support
