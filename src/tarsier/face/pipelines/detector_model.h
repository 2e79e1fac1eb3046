// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/landmarks/face_finder.h"
#include "tarsier/media/model_store.h"

#include <memory>
#include <string>

namespace tarsier::face::landmarks {
struct HogDetector;
}

namespace tarsier::face {

// The installed face detector of a store: file name, and whether it is there.
inline constexpr const char* kAnchorDetectorFile = "face-anchors.json";
[[nodiscard]] bool has_anchor_detector(const ModelStore& models);

// What finds faces, read once and shared: a FaceFinder has state and belongs to one thread, this is
// const and makes as many of them as are needed.
class DetectorModel {
 public:
  // `which`: a file of either kind of face detector (face_networks.h, hog_detector.h); "cascades":
  // those of OpenCV; empty: face-detector.json of the store, and where that is missing the
  // cascades, with a warning. Beside face-detector.json of the store its face-anchors.json is used
  // where it is installed (scripts/get-model.sh face-detector); "own": not. Nothing is read where
  // `options` have a network of the user's own. Throws ModelError, std::invalid_argument for bad options.
  [[nodiscard]] static DetectorModel load(const ModelStore& models, const std::string& which = {},
                                          const landmarks::FaceFinderOptions& options = {});
  // The cascades of OpenCV.
  explicit DetectorModel(const landmarks::FaceFinderOptions& options = {});

  // Throws ModelError where the cascades are missing (Debian: opencv-data).
  [[nodiscard]] landmarks::FaceFinder make_finder() const;
  // Null where something else finds the faces.
  [[nodiscard]] const std::shared_ptr<const FaceNetworks>& networks() const { return networks_; }
  // Null where it is not installed, or not asked for.
  [[nodiscard]] const std::shared_ptr<const AnchorDetector>& anchors() const { return anchors_; }

 private:
  landmarks::FaceFinderOptions options_;
  std::shared_ptr<const FaceNetworks> networks_;
  std::shared_ptr<const AnchorDetector> anchors_;
  std::shared_ptr<const landmarks::HogDetector> hog_;
};

}  // namespace tarsier::face
