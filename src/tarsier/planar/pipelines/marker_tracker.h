// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/media/frame.h"
#include "tarsier/planar/markers/pose.h"

#include <opencv2/core/mat.hpp>

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::planar {

enum class MarkerDetector {
  kTarsier,  // markers/detector.h
  kOpencv    // OpenCV's aruco module, to compare with
};

struct MarkerTrackerOptions {
  // At least one; names as markers::find_dictionary() takes them. Each takes its own search.
  std::vector<std::string> families{"36h11"};
  double side = 0.05;  // m, of the markers over their black frame; 0: unknown, there are no poses
  MarkerDetector detector = MarkerDetector::kTarsier;
  markers::DetectOptions detect;           // of kTarsier
  geometry::PlanarTrackOptions track;      // of videos
  std::optional<geometry::Camera> camera;  // width 0: of any size. Empty: guessed from the image
  double focal_px = 0;                     // of the guessed camera; 0: the image's larger side

  [[nodiscard]] OptionFields fields() {
    return {{"side", side, at_least(0)}, {"focal_px", focal_px, at_least(0)}};
  }
  // Throws std::invalid_argument that names the value, UsageError for an unknown family.
  void check() const;
};

// A marker of one frame.
struct TrackedMarker {
  std::string family;  // the full name
  markers::Marker marker;
  std::optional<markers::MarkerPose> pose;  // empty where the corners have none, or side is 0
};

struct MarkerResult {
  std::vector<TrackedMarker> markers;  // by family as in the options, then by id
  geometry::Camera camera;             // that the poses are in, for images of this size
  double ms = 0;                       // to find and to pose, milliseconds
  bool names_families = false;         // several were searched: to_json() names them
};

// {"markers": [{"id", "corners", "rvec", "tvec", "errors", "ambiguity", "margin"}], "ms"}: errors
// are those of the pose and, where there is one, of the other (px, rms). Without a pose only id,
// corners and margin; of several families each marker has "family" after its id. The line of
// `tarsier ar markers --json` without the image's name.
[[nodiscard]] nlohmann::ordered_json to_json(const MarkerResult& result);

// What is known from earlier frames of a video, and buffers: one for each stream of frames, always
// of the same tracker.
struct MarkerState {
  markers::DetectWorkspace workspace;
  std::vector<markers::PoseTracks> tracks;  // of each family
  std::string source;                       // that the frames are from
  cv::Mat gray;
};

// Finds square markers in images, and their poses over videos:
//
//   planar::MarkerTrackerOptions options;
//   options.side = 0.05;
//   options.camera = geometry::read_camera_file("camera.yaml");
//   const auto tracker = planar::MarkerTracker::load(options);
//   planar::MarkerState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const planar::TrackedMarker& m : tracker.process(*frame, state).markers)
//       if (m.pose)
//         fmt::print("{}: {:.3f} m away\n", m.marker.id,
//                    m.pose->camera_from_marker.translation.norm());
//
// Const: any number of threads may use it, each with a state of its own.
class MarkerTracker {
 public:
  // Throws as MarkerTrackerOptions::check().
  [[nodiscard]] static MarkerTracker load(const MarkerTrackerOptions& options = {});

  [[nodiscard]] const MarkerTrackerOptions& options() const { return options_; }
  [[nodiscard]] const std::vector<const markers::Dictionary*>& families() const {
    return families_;
  }

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. The markers of a still are posed for themselves; those
  // of a video are tracked until another source begins. `debug`, which may be null, takes the
  // stages of kTarsier. Throws InputError where the camera is that of images of another shape.
  [[nodiscard]] MarkerResult process(const Frame& frame, MarkerState& state,
                                     DebugSink* debug = nullptr) const;

 private:
  explicit MarkerTracker(const MarkerTrackerOptions& options);

  MarkerTrackerOptions options_;
  std::vector<const markers::Dictionary*> families_;
};

}  // namespace tarsier::planar
