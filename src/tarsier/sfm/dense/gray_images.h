// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/workspace.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <list>
#include <map>
#include <utility>
#include <vector>

namespace tarsier::sfm {

// The grey images of a workspace at working size. Keeps the most recently used ones within a memory
// limit. Internal to this module.
class GrayImages {
 public:
  GrayImages(const Workspace& workspace, std::vector<cv::Size> sizes, std::int64_t memory)
      : workspace_(workspace), sizes_(std::move(sizes)), memory_(memory) {}

  // Throws InputError.
  [[nodiscard]] cv::Mat1b get(int index);

 private:
  const Workspace& workspace_;
  std::vector<cv::Size> sizes_;
  std::int64_t memory_;
  std::int64_t bytes_ = 0;
  std::map<int, cv::Mat1b> images_;
  std::list<int> order_;  // the most recently used is the last
};

}  // namespace tarsier::sfm
