// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/anchor_detector.h"
#include "tarsier/face/detect/box_detector.h"
#include "tarsier/face/detect/detector.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/detect/search_plan.h"

#include <Eigen/Core>
#include <opencv2/core/cvdef.h>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::face::landmarks {

// From a detector's bounding box to an initial shape: the mean shape, upright, with its centre at
// (dx, dy) * box width from the box centre and the size `size` * box width.
struct BoxModel {
  double dx = 0;
  double dy = 0;
  double size = 0.3;
  int trained_on = 0;  // boxes
  void check() const;
};

// Medians over the faces whose box contains at least `fraction` of the points (0..1); other boxes
// are false detections. Throws std::invalid_argument if no box is correct.
[[nodiscard]] BoxModel train_box_model(const std::vector<Eigen::Matrix2Xd>& shapes,
                                       const std::vector<cv::Rect2d>& boxes, double fraction = 0.8);

// `mean` is centred and of size 1; `roll` as in Candidate.
[[nodiscard]] Eigen::Matrix2Xd start_in_box(const BoxModel& model, const Eigen::Matrix2Xd& mean,
                                            const cv::Rect2d& box, double roll = 0);
// The position of the 68 points of 300-W in the boxes of the frontal cascade, measured on faces68.
[[nodiscard]] BoxModel cascade_box();
// The box that a detector would give for a shape of this position and size.
[[nodiscard]] cv::Rect2d box_around(const BoxModel& model, const Eigen::Matrix2Xd& points);

struct HogDetector;

// A possible face.
struct Candidate {
  cv::Rect2d box;         // px, in the form of the frontal cascade or the trained detector
  bool confident = true;  // detected by the strict search; otherwise the fit decides
  double score = 1;       // of the detector, 0..1
  // Radians, clockwise in the image: roll of the face in the box. The box is that of the face after
  // rotating it upright about the box centre. 0: detected upright.
  double roll = 0;
};

// When faces are also searched for in the image rotated to the left and to the right.
enum class RolledSearch {
  kNever,
  kAuto,    // if no upright face with a good fit was found
  kAlways,  // in every still image; in videos in each search of the whole image
};
[[nodiscard]] std::string_view name_of(RolledSearch search);  // "never", "auto", "always"
// Throws std::invalid_argument that names the choices.
[[nodiscard]] RolledSearch parse_rolled_search(std::string_view name);

// Radians by which the image is rotated to each side. Detectors find faces up to about 25 degrees
// of roll; with this rotation up to 65 degrees.
inline constexpr double kSearchRoll = 40 * CV_PI / 180;

struct FaceFinderOptions {
  // For the cascades; other detectors use only the face sizes.
  FaceDetectorOptions detector;
  // Also search less strictly: below the detector's threshold, or with other cascades (one for
  // profiles) everywhere.
  bool thorough = true;
  // Used instead of all others; or null. Faces with a score of 0.6 or more are confident.
  std::shared_ptr<const BoxDetector> external_detector;
  // What find_faces() and track_faces() do in addition to find().
  RolledSearch rolled = RolledSearch::kAuto;
};

// Detects faces of any size in images of any size, with one of four detectors:
// - the networks of detect/face_networks.h together with OpenCV's frontal cascade for large faces
//   (at least a tenth of the image's smaller side, searched at 320 px);
// - a detector trained by the user (hog_detector.h);
// - the user's own network (FaceFinderOptions::external_detector);
// - OpenCV's cascades alone.
// The results of the strict and the less strict search are merged. Of overlapping boxes a confident
// one is kept, so that one detected face never hides another. Not thread-safe.
class FaceFinder {
 public:
  // Uses the cascades. Throws ModelError if they are missing (Debian: opencv-data).
  explicit FaceFinder(const FaceFinderOptions& options = {});
  FaceFinder(const HogDetector& detector, const FaceFinderOptions& options);
  // `anchors`, which may be null, additionally detect large faces in the whole image at several
  // sizes. Faces that both detect are scored jointly.
  FaceFinder(std::shared_ptr<const FaceNetworks> networks, const FaceFinderOptions& options,
             std::shared_ptr<const AnchorDetector> anchors = nullptr);
  ~FaceFinder();
  FaceFinder(FaceFinder&&) noexcept;
  FaceFinder& operator=(FaceFinder&&) noexcept;
  // Largest first; `gray` CV_8UC1.
  [[nodiscard]] std::vector<Candidate> find(const cv::Mat& gray);
  // Only the strict search.
  [[nodiscard]] std::vector<Candidate> find_confident(const cv::Mat& gray);
  // Searches a part of the image. Of the cascades' less strict searches, only one is run, in turn.
  // cascades = false disables the cascades that run together with the networks in a whole image,
  // which take four times as long as the networks.
  [[nodiscard]] std::vector<Candidate> find_in(const cv::Mat& gray, const SearchTile& tile,
                                               bool cascades = true);
  // Rolled faces that the strict search is confident of, in the image rotated by -kSearchRoll and
  // kSearchRoll. Keeps the better of overlapping ones, largest first. Box centres are inside the
  // image.
  [[nodiscard]] std::vector<Candidate> find_rolled(const cv::Mat& gray);
  // The same in a part of the image, for faces of about this roll, radians within -pi/2 .. pi/2.
  // The part is searched at a resolution at which the tile's smallest face is still detected.
  [[nodiscard]] std::vector<Candidate> find_rolled_in(const cv::Mat& gray, const SearchTile& tile,
                                                      double roll);
  [[nodiscard]] RolledSearch rolled_search() const;
  // How the search of images of this size is spread over the frames of a video. A tile costs about
  // the same for any image size.
  [[nodiscard]] SearchPlan plan(cv::Size image) const;
  // Cost of the searches so far: searched pixels of images and their pyramids.
  [[nodiscard]] std::int64_t pixels() const;
  // Width of the smallest face that is searched for in an image of this size, px.
  [[nodiscard]] double min_face(cv::Size image) const;
  // Positions of shapes in the boxes of a trained detector; empty: as for the cascade.
  [[nodiscard]] const std::optional<BoxModel>& box_model() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

[[nodiscard]] nlohmann::json to_json(const BoxModel& model);
[[nodiscard]] BoxModel box_model_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::landmarks
