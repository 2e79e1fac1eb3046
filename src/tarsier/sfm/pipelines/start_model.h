// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/pipelines/image_features.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <map>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Reconstruction that starts from a model of COLMAP or of an earlier run. Its poses and cameras are
// used; its points are triangulated again from the verified matches.
namespace tarsier::sfm {

// The use of a start model.
struct StartSummary {
  std::string folder;
  int images = 0;      // images in the model
  int in_inputs = 0;   // of these, among the inputs
  int registered = 0;  // of these, with poses that agree with the matches; mapping began with them
  bool fixed_poses = false;
};

// A model to start from (PipelineOptions::start_model), by the names of its images.
class StartModel {
 public:
  // Throws InputError: `folder` holds no model; fewer than two of its images are among the inputs;
  // one of these has a lens that is not a pinhole. Other images of the model are left out, with a
  // warning.
  StartModel(const std::string& folder, const std::vector<Input>& inputs);

  [[nodiscard]] bool has(const std::string& name) const { return index_.contains(name); }
  [[nodiscard]] const StartSummary& summary() const { return summary_; }
  // The size of an image in the model; empty where it has none of this name.
  [[nodiscard]] std::optional<cv::Size> size_of(const std::string& name) const;
  // Throws InputError where the image's size differs from that in the model.
  void check_size(const Input& input, cv::Size size) const;
  // Gives the model's images their cameras. Other images of the same lens get the model's camera
  // for it, unless their lens is given. Same lens means the same size, make and EXIF. Returns for
  // each image whether it now has a camera of the model.
  std::vector<char> set_lenses(const std::vector<Input>& inputs,
                               std::vector<ImageFeatures>& images) const;
  // The start poses of the images; cameras[k] is the camera of image k. `refines_lenses`: also
  // refine lenses of the model.
  [[nodiscard]] StartPoses poses(const std::vector<Input>& inputs,
                                 const std::vector<ImageFeatures>& images,
                                 const std::vector<int>& cameras, bool fixed,
                                 bool refines_lenses) const;

 private:
  [[nodiscard]] const Image* find(const std::string& name) const;

  std::string folder_;
  Model model_;
  std::map<std::string, int> index_;  // index of its images that are among the inputs
  StartSummary summary_;
};

}  // namespace tarsier::sfm
