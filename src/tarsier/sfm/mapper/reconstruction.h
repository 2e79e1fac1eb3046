// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/mapper/center_uncertainty.h"
#include "tarsier/sfm/mapper/model_join.h"
#include "tarsier/sfm/mapper/model_shape.h"
#include "tarsier/sfm/scene/model.h"

#include <optional>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct RefusedPair {
  int first = 0;  // indices of the images
  int second = 0;
  int inliers = 0;
  std::string reason;
  // kNone: rejected by its few inliers or by its patches (reconstruction/strong_pairs.h)
  PairRejection rejection = PairRejection::kNone;
  bool patches_differ = false;  // see PatchRejection
};

// The result for an image.
struct Outcome {
  bool registered = false;
  int model = -1;    // index of its model; 0 is the largest
  double trust = 0;  // trust.h
  // why it is not registered: "12 of 40 points agree on a pose, 16 are needed"; or ""
  std::string reason;
};

struct Reconstruction {
  // Largest first. Each contains all images; those that are not registered have no features.
  std::vector<Model> models;
  std::vector<Outcome> outcomes;  // for each image
  std::vector<std::string> log;   // log lines: steps and warnings
  // for each model: mean over its images; for scenes that repeat, times shape_trust() and with the
  // removed images (contradicted_images.h)
  std::vector<double> trust;
  std::vector<ModelShape> shapes;  // for each model
  // For each model; empty: not computed.
  std::vector<std::optional<CenterUncertainty>> uncertainties;
  std::vector<RefusedPair> refused;
  // Nearby images of a model lack points that they should show (model_conflicts.h).
  bool has_conflicts = false;
  std::string no_model;  // why there is no model; else ""
  int start_images = 0;  // images whose start poses agree with their matches (MapperInput::start)
  bool interrupted = false;  // the models are those made before the interruption
  int resumed = 0;           // images that a checkpoint had in models
  // Where models of parts were joined (joining/joined_mapper.h): names of the parts, and the
  // results of joining.
  std::vector<std::string> parts;
  std::vector<ModelJoin> joins;
};

}  // namespace tarsier::sfm
