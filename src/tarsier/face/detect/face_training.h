// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/detect/face_networks.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

// Training of the three face detection networks from boxes.
namespace tarsier::face {

// An image and the boxes of its faces.
struct FaceImage {
  std::string image;  // path
  // px, squares like those of FaceNetworks; empty: no face in the image
  std::vector<cv::Rect2d> faces;
  std::vector<cv::Rect2d> ignored;  // px, regions that are neither faces nor background
  cv::Mat gray = cv::Mat();         // CV_8UC1; if not empty, used instead of the file
  // For each face its 68 points (300-W, px), or none. Faces with points are also trained in
  // disguise.
  std::vector<std::vector<cv::Point2d>> points = {};
};

struct FaceTrainingOptions {
  // Number of batches of 32 for each network. The second half of them includes the false positives
  // of the first.
  int scan_steps = 7000;
  int refine_steps = 7000;
  int verify_steps = 8000;  // in thirds
  // Number of synthetic images without faces (chessboards, text, shapes) for training, drawn by the
  // seed.
  int drawings = 60;
  // Allowed false alarms per 1000 images without faces. It determines the score of a confident
  // face, from the scores in every third of these images, which is held out.
  double false_alarms = 100;
  // Share of the faces with 68 points that are trained in disguise (disguise.h), 0..1. If it is not
  // 0, all faces are rolled by up to 48 degrees instead of 36.
  double disguised = 0;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"scan_steps", scan_steps, range(3, 1'000'000), "--scan-steps",
             "training steps of the first network"},
            {"refine_steps", refine_steps, range(3, 1'000'000), "--refine-steps",
             "training steps of the second network"},
            {"check_steps", verify_steps, range(3, 1'000'000), "--check-steps",
             "training steps of the third network"},
            {"drawings", drawings, range(0, 10'000), "--drawings",
             "number of synthetic images without faces to add"},
            {"false_alarms", false_alarms, range(0, 10'000), "--false-alarms",
             "allowed false alarms in 1000 of the held-out images"},
            {"disguised", disguised, range(0, 1), "--disguised",
             "share of the 68-point faces with drawn sunglasses, caps, beards or hands; above 0 "
             "also more roll"}};
  }
  void check() const { check_fields(*this); }
};

struct FaceTraining {
  FaceNetworks networks;
  int images = 0;
  int faces = 0;
  // Training images without faces, not counting the drawings.
  int without_faces = 0;
  int held_out = 0;         // held-out images without faces
  int held_out_alarms = 0;  // confident false alarms in these
  int held_out_likely = 0;  // likely false alarms in these
  // The false positives used in the second halves.
  int scan_false_positives = 0;
  int refine_false_positives = 0;
  int verify_false_positives = 0;
  std::vector<std::string> skipped;  // "path: reason"
};

// Faces are randomly rotated, mirrored, relit, blurred and partly hidden, at all sizes from 14 px
// on. Other regions of their images count as background, unless the first half of the training is
// confident that they show a face (whose box may be missing). The result does not depend on the
// number of threads. Throws InputError(name) if no face or no image without faces is left,
// Interrupted.
[[nodiscard]] FaceTraining train_face_networks(const std::vector<FaceImage>& images,
                                               const std::string& name,
                                               const FaceTrainingOptions& options,
                                               Progress& progress, std::stop_token stop);

// The score, from `lowest` to 0.98, that `allowed` of these `scores` are expected to reach. Above
// `lowest`, the logits of non-faces are modelled as exponentially distributed. Their mean is the
// maximum likelihood estimate (censored from 0.98 on), so that all scores contribute and not only
// the few highest ones, which are random. With `allowed` = 0, the result is above all scores.
[[nodiscard]] double choose_confident_score(const std::vector<double>& scores, double lowest,
                                            double allowed);

}  // namespace tarsier::face
