// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

#include <stop_token>

// Training of the textbook recognisers: Eigenfaces (Turk and Pentland 1991), Fisherfaces (Belhumeur
// and others 1997), and local binary pattern histograms (Ahonen and others 2004).
namespace tarsier::face::recognition {

// Sets subspace, templates and calibration of a model whose `options`, `labels` and `people` are
// set. `rows`: one face each. Throws std::invalid_argument for faces that cannot be trained on,
// Interrupted.
void train_classical(Recognizer& model, const Rows& rows, const std::stop_token& stop);

}  // namespace tarsier::face::recognition
