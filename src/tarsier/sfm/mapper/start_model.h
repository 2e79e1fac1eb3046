// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/image_features.h"
#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <map>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Reconstruction that goes on from a model: of COLMAP, or of an earlier run. Its poses and cameras are
// the start; its points are not used, they are triangulated again from the verified matches.
namespace tarsier::sfm {

// What a start model is used for.
struct StartSummary {
  std::string folder;
  int images = 0;      // of the model
  int here = 0;        // of these among the inputs
  int registered = 0;  // of these with poses that agree with the matches: what mapping began with
  bool fixed_poses = false;
};

// A model to go on from (PipelineOptions::start_model), by the names of its images.
class StartModel {
 public:
  // Throws InputError: `folder` holds no model; fewer than two of its images are among the inputs; a
  // lens of one of these is not a pinhole one. Images of the model that are not among the inputs are
  // left out, with a warning.
  StartModel(const std::string& folder, const std::vector<Input>& inputs);

  [[nodiscard]] bool has(const std::string& name) const { return index_.contains(name); }
  [[nodiscard]] const StartSummary& summary() const { return summary_; }
  // Throws InputError where the image has another size than in the model.
  void check_size(const Input& input, cv::Size size) const;
  // Gives the images of the model its cameras; and others of the same lens, as far as images themselves
  // tell (size, make and EXIF), the camera that the model has for these, unless their lens is given. Returns of each image
  // whether it has one of these cameras now.
  std::vector<char> set_lenses(const std::vector<Input>& inputs,
                               std::vector<ImageFeatures>& images) const;
  // Of the images, of which cameras[k] is that of image k. `refines_lenses`: also those of the model.
  [[nodiscard]] StartPoses poses(const std::vector<Input>& inputs,
                                 const std::vector<ImageFeatures>& images,
                                 const std::vector<int>& cameras, bool fixed,
                                 bool refines_lenses) const;

 private:
  [[nodiscard]] const Image* find(const std::string& name) const;

  std::string folder_;
  Model model_;
  std::map<std::string, int> index_;  // of its images that are among the inputs
  StartSummary summary_;
};

// Whether start poses agree with what the images show.
struct StartCheck {
  std::vector<char> fits;            // of each image: it has a pose that agrees
  std::vector<std::string> reasons;  // of each image with a pose that does not; else ""
  int given = 0;                     // poses
  int kept = 0;                      // that fit
  std::size_t matches = 0;           // of pairs of images that fit and agree
  double near_share = 0;             // of these, that lie near their epipolar lines
  std::string refusal;               // why mapping cannot begin with them; or ""
};

// A pair agrees with the poses of its images where its own relative pose does (pair_agreement.h). Epipolar lines alone do
// not tell: of a camera that moves across the scene, those of mirrored poses are nearly the same. A pose fits where pairs with 0.3 of the matches of its image agree, and with 16 or
// more; the worst one is left out until all fit. Refused where less than half of the poses fit that
// have pairs, as those of a mirrored model, of one of another scene, or with names mixed up. `is_refused`: of
// each pair, that it is not used. Throws Interrupted.
[[nodiscard]] StartCheck check_start(const StartPoses& start, const MapperInput& input,
                                     const std::vector<char>& is_refused, double reprojection_px,
                                     const std::stop_token& stop);

}  // namespace tarsier::sfm
