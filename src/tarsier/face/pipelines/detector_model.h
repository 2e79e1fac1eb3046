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

// The face detector that can be installed into a store: its file name, and whether it is installed.
inline constexpr const char* kAnchorDetectorFile = "face-anchors.json";
[[nodiscard]] bool has_anchor_detector(const ModelStore& models);

// The face detector, loaded once and shared. A FaceFinder has state and belongs to one thread; this
// class is const and makes any number of finders.
class DetectorModel {
 public:
  // `which`: a file of either kind of face detector (face_networks.h, hog_detector.h), "cascades"
  // (those of OpenCV), "own", or empty.
  // - Empty: face-detector.json of the store, together with its face-anchors.json if that is
  //   installed (scripts/get-model.sh face-detector). If face-detector.json is missing, the
  //   cascades with a warning.
  // - "own": face-detector.json without face-anchors.json.
  // Nothing is read if `options` contain the user's own network. Throws ModelError,
  // std::invalid_argument for bad options.
  [[nodiscard]] static DetectorModel load(const ModelStore& models, const std::string& which = {},
                                          const landmarks::FaceFinderOptions& options = {});
  // Uses the cascades of OpenCV.
  explicit DetectorModel(landmarks::FaceFinderOptions options = {});

  // Throws ModelError if the cascades are missing (Debian: opencv-data).
  [[nodiscard]] landmarks::FaceFinder make_finder() const;
  // Null if another detector is used.
  [[nodiscard]] const std::shared_ptr<const FaceNetworks>& networks() const { return networks_; }
  // Null if not installed or not requested.
  [[nodiscard]] const std::shared_ptr<const AnchorDetector>& anchors() const { return anchors_; }

 private:
  landmarks::FaceFinderOptions options_;
  std::shared_ptr<const FaceNetworks> networks_;
  std::shared_ptr<const AnchorDetector> anchors_;
  std::shared_ptr<const landmarks::HogDetector> hog_;
};

}  // namespace tarsier::face
