// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/gallery/gallery.h"
#include "tarsier/people_face/face_reader.h"
#include "tarsier/recognition/recognizer.h"

#include <opencv2/core/mat.hpp>

#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// From a gallery to a recogniser and from a face to a name.
namespace tarsier::people {

// What a recogniser of this kind gets of a face that cut_face() made: the default one the face as
// it is (it normalises light itself), the classical ones classical_face().
[[nodiscard]] cv::Mat recognizer_input(recognition::Algorithm algorithm, const cv::Mat& crop);

// The recogniser of all faces of a gallery: the one that is stored there while nothing changed,
// else trained anew and, where `store`, stored. Nothing for a gallery without faces. `background`
// may be null; then one person cannot be told from strangers. Throws std::invalid_argument for what
// the algorithm cannot be trained on (Fisherfaces: one person), Interrupted.
[[nodiscard]] std::optional<recognition::Recognizer> gallery_model(
    Gallery& gallery, const recognition::Background* background, bool store, Progress& progress,
    const std::stop_token& stop);

// A face's name, with what it is worth.
struct Recognition {
  std::string label;      // the nearest person; empty: nobody is enrolled
  double score = 0;       // the recogniser's own
  double threshold = 0;   // of the score, at the stated rate of false accepts
  double confidence = 0;  // 0..1
  bool known = false;
  int nearest = -1;  // index of the nearest template
};

// `false_accepts`: rate that `known` may be wrong for strangers, (0, 1). Without calibration (one
// person and no background, or classical ones of two) nobody is known. Of the confidence, 0.5 is
// where the score reaches the threshold; it rises with the score as the calibration has it.
[[nodiscard]] Recognition recognize(const recognition::Recognizer& model,
                                    const std::vector<float>& features, double false_accepts);

// People of the gallery, other than `name`, whom these new faces (cut_face()) are taken for at a
// false accept rate of one in a thousand by more than half of them: probably the same person under
// another name. Empty where there are none.
[[nodiscard]] std::vector<std::string> other_names(const recognition::Recognizer& model,
                                                   const std::vector<cv::Mat>& crops,
                                                   const std::string& name);

}  // namespace tarsier::people
