// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/colmap_database.h"
#include "tarsier/sfm/pipelines/image_features.h"

#include <opencv2/core/mat.hpp>

#include <map>
#include <string>
#include <vector>

// Features and matches that another program has computed.
namespace tarsier::sfm {

// The content of a COLMAP database about the images.
class KnownFeatures {
 public:
  explicit KnownFeatures(const std::string& path);

  // Throws InputError where the database does not contain the image, or another image under its
  // name. With an empty image there is no file, and the data come from the database alone.
  void fill(const Input& input, const cv::Mat& image, ImageFeatures& features,
            const PipelineOptions& options);
  // The pairs of these images, by their indices. Their matches are not verified yet. Called once.
  [[nodiscard]] std::vector<Pair> pairs(const std::vector<ImageFeatures>& images,
                                        const std::vector<Input>& inputs);

 private:
  ColmapDatabase database_;
  std::string sum_;
  std::string path_;
  std::map<std::string, int> index_;
  std::vector<int> images_of_camera_;  // the number of images of each camera
};

}  // namespace tarsier::sfm
