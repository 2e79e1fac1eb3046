// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/detect/anchor_detector.h"
#include "tarsier/face/detect/box_detector.h"
#include "tarsier/face/detect/detector.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/detect/search_plan.h"
#include "tarsier/face/landmarks/training_face.h"

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

// From a detector's box to a first shape: the mean shape, upright, with its centre at
// (dx, dy) * box width from the box's centre and its size `size` * box width.
struct BoxModel {
  double dx = 0;
  double dy = 0;
  double size = 0.3;
  int trained_on = 0;  // boxes
  void check() const;
};

// Medians over the faces whose box holds at least `fraction` of the points (0..1); others were
// found wrong. Throws std::invalid_argument where no box is right.
[[nodiscard]] BoxModel train_box_model(const std::vector<Eigen::Matrix2Xd>& shapes,
                                       const std::vector<cv::Rect2d>& boxes, double fraction = 0.8);

// `mean` is centred and of size 1; `roll` as in Candidate.
[[nodiscard]] Eigen::Matrix2Xd start_in_box(const BoxModel& model, const Eigen::Matrix2Xd& mean,
                                            const cv::Rect2d& box, double roll = 0);
// Where the 68 points of 300-W lie in the boxes of the frontal cascade, measured on faces68.
[[nodiscard]] BoxModel cascade_box();
// The box that a detector would have drawn around a shape of this place and size.
[[nodiscard]] cv::Rect2d box_around(const BoxModel& model, const Eigen::Matrix2Xd& points);

struct HogDetector;

// A place where a face may be.
struct Candidate {
  cv::Rect2d box;    // px, as the frontal cascade, or the trained detector, draws it
  bool sure = true;  // found by the strict search; else only a fit can tell
  double score = 1;  // of the detector, 0..1
  // Radians, clockwise in the image, of the face within the box, which is that of the face turned
  // upright about the box's middle. 0: found upright.
  double roll = 0;
};

// When faces are looked for in the image turned to the left and to the right, too.
enum class RolledSearch {
  kNever,
  kAuto,    // where no face with a good fit was found upright
  kAlways,  // in every still image; in videos in each search of the whole image
};
[[nodiscard]] std::string_view name_of(RolledSearch search);  // "never", "auto", "always"
// Throws std::invalid_argument naming the choices.
[[nodiscard]] RolledSearch parse_rolled_search(std::string_view name);

// Radians by which the image is turned to either side. Detectors find faces whose roll differs by
// some 25 degrees from upright: with this angle up to 65 degrees.
inline constexpr double kSearchRoll = 40 * CV_PI / 180;

struct FaceFinderOptions {
  // Of the cascades; of other detectors only the sizes of faces count.
  FaceDetectorOptions detector;
  // Look less strictly, too: below the detector's threshold, or with other cascades (one for
  // profiles) everywhere.
  bool thorough = true;
  // In place of all others; or null. What it scores 0.6 and more is sure.
  std::shared_ptr<const BoxDetector> own;
  // What find_faces() and track_faces() do besides find().
  RolledSearch rolled = RolledSearch::kAuto;
};

// Faces of any size in images of any size, by one of four detectors: the networks of
// detect/face_networks.h with OpenCV's frontal cascade beside them for large faces (a tenth of the
// image's smaller side and more, searched at 320 px), a detector of one's own (hog_detector.h),
// a network of one's own (FaceFinderOptions::own), or OpenCV's cascades alone. What the strict and the less strict search see is put together: of
// boxes that overlap a sure one stays, so that one found face never hides another. Not thread-safe.
class FaceFinder {
 public:
  // The cascades. Throws ModelError where they are missing (Debian: opencv-data).
  explicit FaceFinder(const FaceFinderOptions& options = {});
  FaceFinder(const HogDetector& detector, const FaceFinderOptions& options);
  // `anchors`, which may be null, look beside the networks for large faces in the whole image, at
  // several sizes; what both see is judged by both.
  FaceFinder(std::shared_ptr<const FaceNetworks> networks, const FaceFinderOptions& options,
             std::shared_ptr<const AnchorDetector> anchors = nullptr);
  ~FaceFinder();
  FaceFinder(FaceFinder&&) noexcept;
  FaceFinder& operator=(FaceFinder&&) noexcept;
  // Largest first; `gray` CV_8UC1.
  [[nodiscard]] std::vector<Candidate> find(const cv::Mat& gray);
  // Only the strict search.
  [[nodiscard]] std::vector<Candidate> find_sure(const cv::Mat& gray);
  // In a part of the image. Of the cascades' less strict searches one is made, each in its turn.
  // cascades = false leaves out those that run beside the networks in a whole image: they take four
  // times as long as the networks.
  [[nodiscard]] std::vector<Candidate> find_in(const cv::Mat& gray, const SearchTile& tile,
                                               bool cascades = true);
  // Faces rolled to either side that the strict search is sure of: in the image turned by -kSearchRoll and kSearchRoll, the better
  // of those that overlap, largest first. Middles of boxes are inside the image.
  [[nodiscard]] std::vector<Candidate> find_rolled(const cv::Mat& gray);
  // The same in a part of the image, for faces of about this roll, radians within -pi/2 .. pi/2.
  // The part is searched at a size at which the tile's smallest face is still found.
  [[nodiscard]] std::vector<Candidate> find_rolled_in(const cv::Mat& gray, const SearchTile& tile,
                                                      double roll);
  [[nodiscard]] RolledSearch rolled_search() const;
  // How the search of images of this size is spread over a video. A tile costs about the
  // same whatever the size is.
  [[nodiscard]] SearchPlan plan(cv::Size image) const;
  // What the searches cost so far: pixels of images and their pyramids as they were looked at.
  [[nodiscard]] std::int64_t pixels() const;
  // Width of the smallest face that is looked for in such an image, px.
  [[nodiscard]] double min_face(cv::Size image) const;
  // Where shapes lie in the boxes of a trained detector; nothing: as in those of the cascade.
  [[nodiscard]] const std::optional<BoxModel>& box_model() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

[[nodiscard]] nlohmann::json to_json(const BoxModel& model);
[[nodiscard]] BoxModel box_model_from_json(const nlohmann::json& value, const std::string& path);

}  // namespace tarsier::face::landmarks
