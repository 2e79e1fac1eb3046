// SPDX-License-Identifier: MIT
#include "tarsier/face/detect/cascade.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/lazy_opencv.h"

#include <opencv2/objdetect.hpp>

#include <cstdlib>
#include <filesystem>

namespace tarsier::face {

std::string find_cascade(const std::string& name) {
  namespace fs = std::filesystem;
  std::vector<fs::path> folders;
  if (const char* own = std::getenv("TARSIER_CASCADES")) folders.emplace_back(own);
  for (const char* root : {"/usr/share", "/usr/local/share", "/opt/homebrew/share"}) {
    for (const char* package : {"opencv4", "opencv"}) {
      for (const char* kind : {"lbpcascades", "haarcascades"}) {
        folders.push_back(fs::path(root) / package / kind);
      }
    }
  }
  std::error_code error;
  for (const fs::path& folder : folders) {
    if (fs::is_regular_file(folder / name, error)) return (folder / name).string();
  }
  return "";
}

Cascade::Cascade(const std::string& name) {
  const std::string path = find_cascade(name);
  if (path.empty()) {
    throw ModelError(name, "not found; install the package opencv-data, or set TARSIER_CASCADES");
  }
  try {
    haar_ = HaarCascade::read(path);
    if (!haar_) classifier_ = lazy_opencv::load_cascade(path);
  } catch (const cv::Exception&) {
    classifier_ = nullptr;
  }
  if (!haar_ && classifier_ == nullptr)
    throw ModelError(path, "is not a cascade that this OpenCV reads");
}

cv::Size Cascade::window() const {
  return haar_ ? haar_->window() : classifier_->getOriginalWindowSize();
}

std::vector<cv::Rect> Cascade::detect(const cv::Mat& gray, const Search& search) {
  std::vector<cv::Rect> found;
  if (haar_) {
    found = grouped_boxes(haar_->find(gray, search.step, search.min, search.max), search.neighbors);
  } else {
    classifier_->detectMultiScale(gray, found, search.step, search.neighbors, 0, search.min,
                                  search.max);
  }
  for (cv::Rect& box : found) box &= cv::Rect({}, gray.size());
  std::erase_if(found, [](const cv::Rect& box) { return box.empty(); });
  return found;
}

}  // namespace tarsier::face
