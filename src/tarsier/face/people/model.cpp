// SPDX-License-Identifier: MIT
#include "tarsier/face/people/model.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/people/classical.h"

#include <cmath>
#include <map>

namespace tarsier::face::people {

using recognition::Algorithm;
using recognition::Recognizer;

cv::Mat recognizer_input(Algorithm algorithm, const cv::Mat& crop) {
  return recognition::is_whitened(algorithm) ? crop : classical_face(crop);
}

Recognition recognition_of(const Recognizer& model, const recognition::PersonScore& best,
                           double false_accepts, int people) {
  TARSIER_REQUIRE(false_accepts > 0 && false_accepts < 1, "a rate of {}", false_accepts);
  Recognition out;
  out.label = model.labels[static_cast<std::size_t>(best.person)];
  out.score = best.score;
  out.nearest = best.nearest;
  if (!model.calibration) return out;
  const recognition::Calibration& calibration = *model.calibration;
  out.threshold = calibration.threshold(false_accepts, people);
  out.known = out.score >= out.threshold;
  const double slope = calibration.slope > 0 ? calibration.slope : 1 / calibration.scale;
  out.confidence = logistic(slope * (out.score - out.threshold));
  return out;
}

Recognition recognize(const Recognizer& model, const std::vector<float>& features,
                      double false_accepts) {
  TARSIER_REQUIRE(false_accepts > 0 && false_accepts < 1, "a rate of {}", false_accepts);
  const auto found = recognition::best_person(model, features);
  if (!found) return {};
  return recognition_of(model, *found, false_accepts, static_cast<int>(model.labels.size()));
}

namespace {

constexpr double kDuplicateFalseAcceptRate = 0.001;

}  // namespace

std::vector<std::string> duplicate_names(GalleryFollower& follower,
                                         const std::vector<cv::Mat>& crops,
                                         const std::string& name) {
  const Recognizer& model = *follower.recognizer();
  std::map<std::string, std::size_t> taken_for;
  for (const cv::Mat& crop : crops) {
    const auto face =
        recognition::template_of(model, recognizer_input(model.options.algorithm, crop));
    const Recognition seen = follower.recognize(face, kDuplicateFalseAcceptRate);
    if (seen.known && seen.label != name) ++taken_for[seen.label];
  }
  std::vector<std::string> out;
  for (const auto& [label, count] : taken_for)
    if (2 * count > crops.size()) out.push_back(label);
  return out;
}

}  // namespace tarsier::face::people
