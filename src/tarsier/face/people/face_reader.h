// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/face/people/eyes.h"
#include "tarsier/face/people/quality.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face::people {

// A face of an image, ready to be recognised.
struct Face {
  cv::Rect2d box;           // px, as a detector draws it
  Eyes eyes;                // px
  cv::Mat crop;             // CV_8UC1, cut_face() with the reader's options
  Eigen::Matrix2Xd points;  // 2 x 68, px; empty without landmarks
  double score = 1;         // of the points, 0..1
  // False: hardly likely to be a face, or its points are hardly right (hidden by sunglasses or a hand,
  // far turned), see FaceReaderOptions::min_uncertain. To be asked for, not to be enrolled.
  bool trusted = true;
  int id = 0;  // stays with a followed face; 0 in stills
  Quality quality;
};

// How likely something is a face, 0..1, of which the detector is as certain as `detection` says and
// whose points fit as `points` says (both 0..1): a logistic regression over faces68 as it is and
// disguised (sunglasses, caps, beards, hands: of those the points' score is low), and images without
// faces. Without the detector that users can install `detection` is no probability, and the points
// alone count.
[[nodiscard]] double trust_in(double detection, double points);

// Of the images of faces-wild in which no face is trusted, half have one of this trust; below it, people
// are named no better than by chance.
inline constexpr double kMinUncertain = 0.1;

struct FaceReaderOptions {
  EyeMethod eyes = EyeMethod::kLandmarks;
  CutOptions cut;
  landmarks::FaceFinderOptions finder;
  // Of the points of a face that only the less strict search saw. Counts only where the finder has the
  // detector that users can install.
  double min_score = 0.35;
  double min_trust = 0.5;  // of any face, how likely it is one: see trust_in()
  // A still image without a face that is trusted gives the most likely one, if it has this trust at
  // least, as one that is not trusted. 1: it gives none; kMinUncertain is a good value.
  double min_uncertain = 1;
  landmarks::TrackerOptions tracker;

  [[nodiscard]] OptionFields fields() {
    return {{"min_score", min_score, range(0, 1)},
            {"min_trust", min_trust, range(0, 1)},
            {"min_uncertain", min_uncertain, range(0, 1)}};
  }
  void check() const;
};

// Image to faces: detection (landmarks/face_finder.h), eyes, cut, quality. Not
// thread-safe; the landmark model is shared.
class FaceReader {
 public:
  // `model` (68 points): needed for EyeMethod::kLandmarks only. Throws ModelError where cascades
  // are missing, std::invalid_argument for a model of other points.
  // `networks` find the faces; null: the cascades. `anchors`: see landmarks::FaceFinder.
  FaceReader(const FaceReaderOptions& options,
             std::shared_ptr<const landmarks::LandmarkModel> model,
             std::shared_ptr<const FaceNetworks> networks = nullptr,
             std::shared_ptr<const AnchorDetector> anchors = nullptr);
  ~FaceReader();
  FaceReader(FaceReader&&) noexcept;
  FaceReader& operator=(FaceReader&&) noexcept;

  // Largest first. Faces whose eyes are not found are left out and counted in `without_eyes`.
  // `debug` gets the stages of the first face.
  [[nodiscard]] std::vector<Face> read(const cv::Mat& gray, DebugSink* debug = nullptr);
  // The next frame of a video at `time` (s): with landmarks faces are followed and keep their id.
  // `debug` gets the stages of the largest face.
  [[nodiscard]] std::vector<Face> follow(const cv::Mat& gray, double time,
                                         DebugSink* debug = nullptr);
  // Forgets all places: another video.
  void restart();
  // Where the eyes are known.
  [[nodiscard]] Face at_eyes(const cv::Mat& gray, const Eyes& eyes) const;

  [[nodiscard]] const FaceReaderOptions& options() const { return options_; }
  [[nodiscard]] int without_eyes() const { return without_eyes_; }  // of the last image

 private:
  struct Impl;
  [[nodiscard]] std::vector<Face> read_by_landmarks(const cv::Mat& gray);
  FaceReaderOptions options_;
  std::unique_ptr<Impl> impl_;
  int without_eyes_ = 0;
};

}  // namespace tarsier::face::people
