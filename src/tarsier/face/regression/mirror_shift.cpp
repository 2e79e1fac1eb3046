// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/mirror_shift.h"

#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/starts.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tarsier::face::regression {

double measured_shift(const std::vector<TrainingFace>& faces, const Eigen::Matrix2Xd& mean,
                      std::uint64_t seed, Progress& progress, const std::stop_token& stop) {
  constexpr std::size_t kFaces = 600;  // mirrored ones follow the originals
  const std::vector<TrainingFace> part(
      faces.begin(), faces.begin() + static_cast<std::ptrdiff_t>(std::min(kFaces, faces.size())));
  DescentOptions options;
  options.stages = {{16, 0.4}, {24, 0.3}};
  options.components = 16;
  // Starts are scattered around the annotated points. Weak regularisation lets the fits move away
  // from them.
  options.ridge = 0.2;
  options.seed = seed;
  DescentReport report;
  (void)train_descent(part, scattered_starts(part, mean, 4, seed), options, progress, stop,
                      &report);
  return report.to_the_right;
}

std::vector<TrainingFace> load_framed_faces(const shape::LandmarkSet& set, bool mirror,
                                            std::uint64_t seed, Progress& progress,
                                            const std::stop_token& stop,
                                            std::vector<std::string>& skipped) {
  constexpr int kMaxFaceSide = 200;  // px of a face: the frames are smaller
  LoadOptions load;
  load.mirror = mirror;
  load.largest = kMaxFaceSide;
  std::vector<TrainingFace> faces = load_training_faces(set, "", load, progress, stop, skipped);
  if (!mirror) return faces;
  const double shift = measured_shift(faces, mean_shape(faces), seed, progress, stop);
  if (std::abs(shift) <= kMinCorrectedShift) return faces;
  load.to_the_right = shift;
  skipped.clear();
  return load_training_faces(set, "", load, progress, stop, skipped);
}

}  // namespace tarsier::face::regression
