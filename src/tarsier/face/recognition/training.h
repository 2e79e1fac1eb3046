// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

// Training in small steps, for callers with other work to do in between, and the choice of training
// faces from very many.
namespace tarsier::face::recognition {

// With more faces than this, subspace and calibration are learned from an evenly chosen subset. The
// templates of the other faces are then computed with the result. This bounds time and memory of
// training.
inline constexpr int kMaxTrainingFaces = 2000;

// Indices of the training faces, rising: all if there are at most `max`. Otherwise evenly chosen
// people with up to four evenly chosen images each (or as many as fit). `people[i]`: the person in
// face i, 0 ..; every number up to the greatest occurs. max >= 1.
[[nodiscard]] std::vector<std::size_t> training_subset(const std::vector<int>& people, int max);

// Gives the same result as train().
class Training {
 public:
  // As train(). `background` (may be null) must outlive it. Throws std::invalid_argument.
  Training(std::vector<cv::Mat> faces, const std::vector<std::string>& labels,
           const RecognizerOptions& options, const Background* background,
           int max_training_faces = kMaxTrainingFaces);
  // As train_coordinates() of background_space.h.
  Training(const Rows& coordinates, const std::vector<std::string>& labels,
           const RecognizerOptions& options, const Background& background);
  ~Training();
  Training(Training&&) noexcept;
  Training& operator=(Training&&) noexcept;

  // Does the next piece of the work; false when all is done. Throws std::invalid_argument for faces
  // that cannot be trained on, Interrupted.
  bool step(Progress& progress, const std::stop_token& stop);
  // Estimated cost of the last step, in units of about a millisecond of one small core. It depends
  // on the sizes alone, so that callers behave identically on every machine.
  [[nodiscard]] double work() const;
  // Returns the model. May be called once, after the last step.
  [[nodiscard]] Recognizer take();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face::recognition
