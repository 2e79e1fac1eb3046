// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/detector_model.h"

#include "tarsier/core/log.h"
#include "tarsier/face/landmarks/hog_detector.h"
#include "tarsier/media/archive.h"

#include <utility>

namespace tarsier::face {
namespace {

constexpr const char* kShipped = "face-detector.json";
constexpr const char* kOwn = "own";

}  // namespace

bool has_anchor_detector(const ModelStore& models) { return models.has(kAnchorDetectorFile); }

DetectorModel::DetectorModel(landmarks::FaceFinderOptions options) : options_(std::move(options)) {
  options_.detector.check();
}

DetectorModel DetectorModel::load(const ModelStore& models, const std::string& which,
                                  const landmarks::FaceFinderOptions& options) {
  DetectorModel model(options);
  if (which == "cascades" || options.external_detector) return model;
  const bool shipped = which.empty() || which == kOwn;
  if (shipped && !models.has(kShipped)) {
    log_warning("{}: not there; faces are found by the cascades of opencv-data instead",
                models.expected_path(kShipped));
    return model;
  }
  const std::string path = models.path_or(shipped ? "" : which, kShipped);
  if (which.empty() && has_anchor_detector(models)) {
    model.anchors_ = std::make_shared<const AnchorDetector>(
        read_anchor_detector(models.path(kAnchorDetectorFile)));
  }
  if (shipped || read_any_archive(path).type == kFaceNetworksType) {
    model.networks_ = std::make_shared<const FaceNetworks>(read_face_networks(path));
  } else {
    model.hog_ = std::make_shared<const landmarks::HogDetector>(landmarks::read_hog_detector(path));
  }
  return model;
}

landmarks::FaceFinder DetectorModel::make_finder() const {
  if (networks_ != nullptr) return {networks_, options_, anchors_};
  if (hog_ != nullptr) return {*hog_, options_};
  return landmarks::FaceFinder(options_);
}

}  // namespace tarsier::face
