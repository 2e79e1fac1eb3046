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

// Training in small steps, for callers that do other work meanwhile, and what it is
// learned from where there are very many faces.
namespace tarsier::face::recognition {

// Of more faces than this a subspace and a calibration are learned from an even choice; the others
// get their templates from what was learned. Time and memory of training stay bounded.
inline constexpr int kMaxLearnedFaces = 2000;

// Which of the faces are learned from, in rising order: all where there are at most `max`; else of
// people who are evenly chosen up to four images each (or as many as fit), evenly chosen as well.
// `people[i]`: who face i shows, 0 ..; every number up to the greatest occurs. max >= 1.
[[nodiscard]] std::vector<std::size_t> learning_sample(const std::vector<int>& people, int max);

// Same result as train(), whatever happens between the steps.
class Training {
 public:
  // As train(). `background` (may be null) must outlive it. Throws std::invalid_argument.
  Training(std::vector<cv::Mat> faces, std::vector<std::string> labels,
           const RecognizerOptions& options, const Background* background,
           int max_learned = kMaxLearnedFaces);
  // As train_coordinates(): of background_space.h.
  Training(const Rows& coordinates, std::vector<std::string> labels,
           const RecognizerOptions& options, const Background& background);
  ~Training();
  Training(Training&&) noexcept;
  Training& operator=(Training&&) noexcept;

  // Does the next piece of the work; false: all is done. Throws std::invalid_argument for what
  // cannot be trained on, Interrupted.
  bool step(Progress& progress, const std::stop_token& stop);
  // What the last step took, in units of about a millisecond of one small core: an estimate from
  // the sizes alone, so that what a caller does with it does not depend on the machine.
  [[nodiscard]] double work() const;
  // The model, once; only after the last step.
  [[nodiscard]] Recognizer take();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face::recognition
