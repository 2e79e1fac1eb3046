// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/media/frame.h"
#include "tarsier/planar/markers/board.h"

#include <opencv2/core/mat.hpp>

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::planar {

enum class MarkerDetector {
  kTarsier,  // markers/detector.h
  kOpencv    // OpenCV's aruco module, for comparison
};

struct MarkerTrackerOptions {
  // At least one name that markers::find_dictionary() accepts. Each family needs a search of its
  // own.
  std::vector<std::string> families{"36h11"};
  double side = 0.05;  // m, outer side of the markers' black frame; 0 disables the poses
  // One pose of all its markers in place of a pose for each. `families` is then its family.
  std::optional<markers::MarkerBoard> board;
  MarkerDetector detector = MarkerDetector::kTarsier;
  markers::DetectOptions detect;       // for kTarsier
  geometry::PlanarTrackOptions track;  // for videos
  // Width 0 means any image size. If empty, the camera is guessed from the image.
  std::optional<geometry::Camera> camera;
  double focal_px = 0;  // of the guessed camera; 0 means the larger side of the image

  [[nodiscard]] OptionFields fields() {
    return {{"side", side, at_least(0)}, {"focal_px", focal_px, at_least(0)}};
  }
  // Throws std::invalid_argument, which names the value, and UsageError for an unknown family.
  void check() const;
};

// A marker in one frame.
struct TrackedMarker {
  std::string family;  // the full name
  markers::Marker marker;
  std::optional<markers::MarkerPose> pose;  // empty if the corners give no pose or if side is 0
};

struct MarkerResult {
  std::vector<TrackedMarker> markers;        // in the order of the options' families, then by id
  std::optional<markers::MarkerPose> board;  // camera from board; empty if none of it is visible
  int board_markers = 0;                     // detected markers of the board
  geometry::Camera camera;      // the camera of the poses, scaled to images of this size
  double ms = 0;                // time spent on detection and poses, milliseconds
  bool names_families = false;  // several families were searched, so to_json() names them
};

// {"markers": [{"id", "corners", "rvec", "tvec", "errors", "ambiguity", "margin"}], "ms"}. "errors"
// holds the error of the pose and, if it exists, that of the second solution (px, rms). A marker
// without a pose has only id, corners and margin. With several families each marker has "family"
// after its id. With a visible board it also has "board": {"markers": number, "rvec", "tvec",
// "errors", "ambiguity"}, and the markers have no poses. This is a line of `tarsier ar markers
// --json`, without the image name.
[[nodiscard]] nlohmann::ordered_json to_json(const MarkerResult& result);

// State carried from frame to frame of a video, and buffers. Use one state for each stream of
// frames, always with the same tracker.
struct MarkerState {
  markers::DetectWorkspace workspace;
  std::vector<markers::PoseTracks> tracks;  // one for each family
  markers::BoardTrack board;
  std::string source;  // source of the frames
  cv::Mat gray;
};

// Finds square markers in images, and their poses in images and videos:
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
// The object is const. Any number of threads may use it, each with its own state.
class MarkerTracker {
 public:
  // Throws the same exceptions as MarkerTrackerOptions::check().
  [[nodiscard]] static MarkerTracker load(const MarkerTrackerOptions& options = {});

  [[nodiscard]] const MarkerTrackerOptions& options() const { return options_; }
  [[nodiscard]] const std::vector<const markers::Dictionary*>& families() const {
    return families_;
  }

  // `frame.image` is CV_8UC3 (BGR) or CV_8UC1. A still is posed on its own. In a video the poses
  // are tracked until another source begins. `debug` may be null; it receives the stages of
  // kTarsier. Throws InputError if the camera's images have another aspect ratio.
  [[nodiscard]] MarkerResult process(const Frame& frame, MarkerState& state,
                                     DebugSink* debug = nullptr) const;

 private:
  explicit MarkerTracker(const MarkerTrackerOptions& options);
  void locate_board(const std::vector<markers::Marker>& found, const Frame& frame,
                    MarkerState& state, MarkerResult& result) const;

  MarkerTrackerOptions options_;
  std::vector<const markers::Dictionary*> families_;
};

}  // namespace tarsier::planar
