// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/detect/face_networks.h"

#include <opencv2/core/types.hpp>

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

// Training of the three networks that find faces, from boxes.
namespace tarsier::face {

// A picture and where its faces are.
struct FacePicture {
  std::string image;                // path
  std::vector<cv::Rect2d> faces;    // px, squares as FaceNetworks draws them; none: shows no face
  std::vector<cv::Rect2d> ignored;  // px, neither faces nor anything else
};

struct FaceTrainingOptions {
  // Batches of 32 of each network, in two halves: the second knows the mistakes of the first.
  int scan_steps = 6000;
  int judge_steps = 5000;
  int check_steps = 6000;  // in thirds
  // Pictures without faces that the program draws itself (chessboards, writing, shapes), from the
  // seed, to learn from.
  int drawings = 60;
  // How many false alarms there may be in 1000 pictures without faces: a score is sure from where
  // there are no more in every fourth of those pictures, which is not learned from.
  double false_alarms = 100;
  std::uint64_t seed = 1;
  void check() const;
};

struct FaceTraining {
  FaceNetworks networks;
  int pictures = 0;
  int faces = 0;
  int without = 0;          // pictures without faces that were learned from, without the drawings
  int held_out = 0;         // those that were not
  int held_out_alarms = 0;  // false ones there, sure
  // The mistakes that the second halves learned from: places that show no face.
  int scan_mistakes = 0;
  int judge_mistakes = 0;
  int check_mistakes = 0;
  std::vector<std::string> skipped;  // "path: reason"
};

// Faces are turned, mirrored, lit, blurred and partly hidden at random, and shown at all sizes from
// 14 px on. Other places of their pictures count as no face where the first half of the training
// does not firmly hold them for one (their boxes may be missing). The same result for any number of
// threads. Throws InputError(name) where no face or no picture without faces is left, Interrupted.
[[nodiscard]] FaceTraining train_face_networks(const std::vector<FacePicture>& pictures,
                                               const std::string& name,
                                               const FaceTrainingOptions& options,
                                               Progress& progress, std::stop_token stop);

}  // namespace tarsier::face
