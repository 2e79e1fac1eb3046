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

// A face in an image, ready for recognition.
struct Face {
  cv::Rect2d box;           // px, as the detector draws it
  Eyes eyes;                // px
  cv::Mat crop;             // CV_8UC1, crop_face() with the reader's options
  Eigen::Matrix2Xd points;  // 2 x 68, px; empty without landmarks
  double score = 1;         // score of the points, 0..1
  // False where the detection is probably no face, or where its points are probably wrong (face
  // hidden by sunglasses or a hand, or turned far). Such a face may be a probe, but it is not
  // enrolled. See FaceReaderOptions::min_uncertain.
  bool trusted = true;
  int id = 0;  // kept while the face is tracked; 0 in still images
  Quality quality;
};

// Probability that a detection is a face, 0..1. `detection` is the detector's score and `points`
// the score of the fitted points (both 0..1). The model is a logistic regression. It was fitted on
// faces68, plain and disguised (sunglasses, caps, beards, hands; the points of these score low),
// and on images without faces. Without the detector that users can install, `detection` is no
// probability, and only the points count.
[[nodiscard]] double face_probability(double detection, double points);

// Tuned on faces-wild: half of its images without a trusted face have a face of at least this
// trust. Below this trust, identification is no better than chance.
inline constexpr double kMinUncertain = 0.1;

struct FaceReaderOptions {
  EyeMethod eyes = EyeMethod::kLandmarks;
  CropOptions crop;
  landmarks::FaceFinderOptions finder;
  // Min score of the points of a face that only the less strict search found. It applies only where
  // the finder has the detector that users can install.
  double min_score = 0.35;
  double min_trust = 0.5;  // min face_probability() of any face
  // If a still image has no trusted face, its most likely face is returned as not trusted, provided
  // that its trust is at least this. 1 disables it; kMinUncertain is a good value.
  double min_uncertain = 1;
  landmarks::TrackerOptions tracker;

  [[nodiscard]] OptionFields fields() {
    return {{"min_score", min_score, range(0, 1)},
            {"min_trust", min_trust, range(0, 1)},
            {"min_uncertain", min_uncertain, range(0, 1)}};
  }
  void check() const;
};

// Reads the faces of an image: detection (landmarks/face_finder.h), eyes, crop, quality. Not
// thread-safe; the landmark model is shared.
class FaceReader {
 public:
  // `model` (68 points) is needed only for EyeMethod::kLandmarks. `networks` detect the faces; if
  // it is null, the cascades do. `anchors`: see landmarks::FaceFinder. Throws ModelError if
  // cascades are missing, std::invalid_argument if the model has another number of points.
  FaceReader(FaceReaderOptions options, std::shared_ptr<const landmarks::LandmarkModel> model,
             std::shared_ptr<const FaceNetworks> networks = nullptr,
             std::shared_ptr<const AnchorDetector> anchors = nullptr);
  ~FaceReader();
  FaceReader(FaceReader&&) noexcept;
  FaceReader& operator=(FaceReader&&) noexcept;

  // Returns the faces, largest first. Faces without detected eyes are left out and counted in
  // `without_eyes`. `debug` receives the stages of the first face.
  [[nodiscard]] std::vector<Face> read(const cv::Mat& gray, DebugSink* debug = nullptr);
  // The faces of the next frame of a video, at `time` (s). With landmarks, faces are tracked and
  // keep their id. `debug` receives the stages of the largest face.
  [[nodiscard]] std::vector<Face> track(const cv::Mat& gray, double time,
                                        DebugSink* debug = nullptr);
  // Drops all tracks, e.g. before another video.
  void reset();
  // The face with the given eyes.
  [[nodiscard]] Face face_from_eyes(const cv::Mat& gray, const Eyes& eyes) const;

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
