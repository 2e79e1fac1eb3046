// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

// Functions shared by training and use of the recognisers.
namespace tarsier::face::recognition {

// Pixels (eigen, fisher), histograms (lbph), descriptor (default), embedding (deep). Throws
// std::invalid_argument, also if kDeep has no network.
[[nodiscard]] std::vector<float> features_of(const cv::Mat& face, const RecognizerOptions& options,
                                             const DeepNetwork* network = nullptr);

// components (input - mean); default, deep: normalised by scale_rows().
[[nodiscard]] std::vector<float> project(const Recognizer& model, const std::vector<float>& input);

// Normalises whitened rows to length 1. The length includes the part outside the subspace, whose
// variance is taken as `residual_variance`. A stranger, whom the subspace represents badly, is
// therefore similar to nobody. `square`: squared length of each row before projection. `scatter`:
// of each column, as Recognizer::eigenvalues. Rows of zeros are not changed.
void scale_rows(Rows& rows, const Eigen::VectorXd& square, const Eigen::VectorXd& scatter,
                double residual_variance);

// The sum of the rows of each label 0..count-1.
[[nodiscard]] Rows person_sums(const Rows& rows, const std::vector<int>& labels, int count);

// The weight of each template among those of its person: 1, or 0 for an outlier, such as a face of
// another person that was enrolled by mistake. With c the cosine between a template and the sum of
// the person's other templates, those count whose c is at least half the person's median. c is then
// computed a second time with the sum of these templates alone. People with one or two templates
// keep them. Rows of zeros are not judged and keep weight 1. Templates with negative labels get 0.
[[nodiscard]] std::vector<double> template_weights(const Rows& rows, const std::vector<int>& labels,
                                                   int count);

}  // namespace tarsier::face::recognition
