// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/media/http_service.h"

#include <opencv2/core/mat.hpp>

#include <deque>
#include <memory>
#include <mutex>
#include <string>

namespace tarsier {

struct CropServerOptions {
  std::string url;  // "http://127.0.0.1:8090/"
  HttpAccess access;
  // Folder of the images; created so that only its owner can read it.
  std::string folder;
  int max_crops = 5000;

  [[nodiscard]] OptionFields fields() {
    return {{"max_crops", max_crops, range(1, 1'000'000), "--max-crops",
             "maximum number of crops; beyond, the oldest are dropped"}};
  }
  void check() const { check_fields(*this); }
};

// Serves small images to clients that know their hash; messages carry only the hash:
//   GET /crop/SHA256.jpg      the JPEG with that SHA-256, 64 hexadecimal digits
// The images are files with these names, so they outlive the program.
class CropServer {
 public:
  // Throws as HttpService does, and OutputError for the folder.
  explicit CropServer(const CropServerOptions& options);

  // Stores an image (CV_8UC3 or CV_8UC1) and returns its hash. Throws OutputError.
  [[nodiscard]] std::string add(const cv::Mat& image);
  [[nodiscard]] std::string url_of(const std::string& hash) const;

 private:
  bool respond(MHD_Connection* connection, std::string_view path) const;

  CropServerOptions options_;
  std::mutex mutex_;
  std::deque<std::string> hashes_;       // oldest first
  std::unique_ptr<HttpService> server_;  // last: its threads use the members above
};

}  // namespace tarsier
