// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/gray_images.h"

#include <opencv2/imgproc.hpp>

namespace tarsier::sfm {

cv::Mat1b GrayImages::get(int index) {
  const auto found = images_.find(index);
  if (found != images_.end()) {
    order_.remove(index);
    order_.push_back(index);
    return found->second;
  }
  cv::Mat1b gray;
  cv::cvtColor(workspace_.read_image(index), gray, cv::COLOR_BGR2GRAY);
  const cv::Size size = sizes_[static_cast<std::size_t>(index)];
  if (size != gray.size()) {
    cv::Mat1b smaller;
    cv::resize(gray, smaller, size, 0, 0, cv::INTER_AREA);
    gray = smaller;
  }
  bytes_ += static_cast<std::int64_t>(gray.total());
  images_[index] = gray;
  order_.push_back(index);
  while (bytes_ > memory_ && order_.size() > 1) {
    bytes_ -= static_cast<std::int64_t>(images_[order_.front()].total());
    images_.erase(order_.front());
    order_.pop_front();
  }
  return gray;
}

}  // namespace tarsier::sfm
