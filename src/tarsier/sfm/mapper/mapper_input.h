// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/consistency/patch_evidence.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <opencv2/core.hpp>

#include <functional>
#include <optional>
#include <vector>

namespace tarsier::sfm {

// Poses to begin with, from another program or an earlier run. Poses that contradict the matches
// are left out (start_poses.h). Points are triangulated, everything is adjusted in the frame of
// these poses, and further images are added one after the other. There is only this one model.
// MapperOptions::choice is not used.
struct StartPoses {
  // camera_from_world of each image; at least two
  std::vector<std::optional<geometry::Rigid3>> poses;
  // the poses do not change; an image whose pose is left out is not added later
  bool fixed = false;
  std::vector<int> fixed_cameras;  // indices into MapperInput::cameras: not refined
};

// The input of a reconstruction. Refers to the named objects, which must outlive it.
struct MapperInput {
  const std::vector<geometry::Camera>& cameras;
  const std::vector<Image>& images;                   // their poses are not used
  const std::vector<std::vector<cv::Vec3b>>& colors;  // for the features of each image
  // For the features of each image. Without descriptors (flow), tracks are not extended.
  const std::vector<cv::Mat>& descriptors;
  // Called when descriptors and matches will not be needed for a while (mapped_store.h); may be
  // empty.
  std::function<void()> release_memory = {};
  FeatureKind kind = FeatureKind::kSift;  // of the descriptors
  const std::vector<Pair>& pairs;
  // Features were tracked from image to image, not detected in each. A missing feature then proves
  // nothing, and models are not searched for superimposed places (model_conflicts.h).
  bool tracked = false;
  // Places are known to look alike, so few contradicting images suffice to reject a model.
  bool is_repetitive = false;
  // Supplies the pixels for patch_evidence.h. Used where finished models have conflicts.
  GrayImages gray = {};
  std::optional<StartPoses> start = {};
};

}  // namespace tarsier::sfm
