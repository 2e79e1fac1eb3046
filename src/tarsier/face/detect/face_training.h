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

// Training of the three networks that find faces, from boxes.
namespace tarsier::face {

// An image and where its faces are.
struct FaceImage {
  std::string image;                // path
  std::vector<cv::Rect2d> faces;    // px, squares as FaceNetworks draws them; none: shows no face
  std::vector<cv::Rect2d> ignored;  // px, neither faces nor anything else
  cv::Mat gray = cv::Mat();         // CV_8UC1; where it is not empty, in place of the file
  // Of each face its 68 points (300-W, px) or none: those with points learn in disguise, too.
  std::vector<std::vector<cv::Point2d>> points = {};
};

struct FaceTrainingOptions {
  // Batches of 32 of each network, in two halves: the second knows the mistakes of the first.
  int scan_steps = 7000;
  int judge_steps = 7000;
  int check_steps = 8000;  // in thirds
  // Images without faces that the program draws itself (chessboards, writing, shapes), from the
  // seed, to learn from.
  int drawings = 60;
  // How many false alarms there may be in 1000 images without faces: a score is sure from where
  // the scores in every third of those images, which is not learned from, let no more expect.
  double false_alarms = 100;
  // Share of the faces with 68 points that learn in disguise (disguise.h), 0..1. Where it is not 0,
  // all faces are rolled by up to 48 degrees in place of 36.
  double disguised = 0;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {
        {"scan_steps", scan_steps, range(3, 1'000'000), "--scan-steps",
         "batches that the first network learns from"},
        {"judge_steps", judge_steps, range(3, 1'000'000), "--judge-steps", "batches of the second"},
        {"check_steps", check_steps, range(3, 1'000'000), "--check-steps", "batches of the third"},
        {"drawings", drawings, range(0, 10'000), "--drawings",
         "images without faces that the program draws and learns from as well"},
        {"false_alarms", false_alarms, range(0, 10'000), "--false-alarms",
         "how many there may be in 1000 of the images held out"},
        {"disguised", disguised, range(0, 1), "--disguised",
         "share of the faces with 68 points that wear drawn sunglasses, caps, beards or hold "
         "something; above 0 faces are rolled further, too"}};
  }
  void check() const { check_fields(*this); }
};

struct FaceTraining {
  FaceNetworks networks;
  int images = 0;
  int faces = 0;
  int without = 0;          // images without faces that were learned from, without the drawings
  int held_out = 0;         // those that were not
  int held_out_alarms = 0;  // false ones there, sure
  int held_out_likely = 0;  // and likely
  // The mistakes that the second halves learned from: places that show no face.
  int scan_mistakes = 0;
  int judge_mistakes = 0;
  int check_mistakes = 0;
  std::vector<std::string> skipped;  // "path: reason"
};

// Faces are turned, mirrored, lit, blurred and partly hidden at random, and shown at all sizes from
// 14 px on. Other places of their images count as no face where the first half of the training
// does not firmly hold them for one (their boxes may be missing). The same result for any number of
// threads. Throws InputError(name) where no face or no image without faces is left, Interrupted.
[[nodiscard]] FaceTraining train_face_networks(const std::vector<FaceImage>& images,
                                               const std::string& name,
                                               const FaceTrainingOptions& options,
                                               Progress& progress, std::stop_token stop);

// The score, from `lowest` to 0.98, from which on `allowed` of such `scores` are to be expected. Above
// `lowest` the logits of what is no face are taken as exponentially distributed, with their mean as
// its maximum likelihood estimate (from 0.98 on censored): all scores count and not only the few highest, which chance
// decides. With `allowed` = 0 it lies above all scores.
[[nodiscard]] double sure_score(const std::vector<double>& scores, double lowest, double allowed);

}  // namespace tarsier::face
