// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

// What training and use of the recognisers share.
namespace tarsier::face::recognition {

// Pixels (eigen, fisher), histograms (lbph), descriptor (default), the network's numbers (deep).
// Throws std::invalid_argument, also where kDeep has no network.
[[nodiscard]] std::vector<float> features_of(const cv::Mat& face, const RecognizerOptions& options,
                                             const DeepNetwork* network = nullptr);

// components (input - mean); default, deep: to length 1.
[[nodiscard]] std::vector<float> project(const Recognizer& model, const std::vector<float>& input);

// Whitened rows to length 1, but for what lies outside the subspace: what training never saw varies
// as little as the ridge says, and the length counts it. So a stranger, of whom the subspace holds
// little, is like nobody. `square`: of each row, its squared length before projection; `scatter`:
// of each column, as Recognizer::importance; `rest`: of what is outside. Rows of zeros stay.
void scale_rows(Rows& rows, const Eigen::VectorXd& square, const Eigen::VectorXd& scatter,
                double rest);

// The sums of the rows of each label 0..count-1.
[[nodiscard]] Rows person_sums(const Rows& rows, const std::vector<int>& labels, int count);

// What each template counts for among those of its person: 1, or 0 for one that is hardly like the
// others, as a face of somebody else is that was enrolled by mistake. With c the cosine of a
// template to the sum of the person's others, those count whose c is at least half the person's
// median; c is then found again with the sum of those alone. People with one or two templates keep
// them; rows of zeros say nothing and keep theirs; negative labels are nobody's: 0.
[[nodiscard]] std::vector<double> template_weights(const Rows& rows, const std::vector<int>& labels,
                                                   int count);

}  // namespace tarsier::face::recognition
