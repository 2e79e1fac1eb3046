// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <optional>
#include <vector>

namespace tarsier::sfm {

struct MapperOptions;
struct Reconstruction;

// How well the observations of a model determine where its cameras are: standard deviations of their centres, as shares of the
// extent (the diagonal of the box around the centres).
//
// Noise goes through the adjustment to first order. With J the derivatives of the weighted residuals, n noise of the size of
// the model's own residuals and d = -(J^T J)^-1 J^T n, the centres moved by d are compared with those of the model after the
// best similarity, as the observations tell nothing about place, direction and scale; the root mean square over the samples
// is the standard deviation (a parametric bootstrap, Efron and Tibshirani, An Introduction to the Bootstrap, 1993, section
// 6.5). It knows nothing of wrong correspondences: a folded model may be certain of its shape. A long chain of images that
// bends is not.
struct CenterUncertainty {
  // Noise of a coordinate of an observation: the root mean square of the weighted residuals, divided by the root of the
  // share of the coordinates that the unknowns have not fitted (the redundancy).
  double sigma_px = 0;
  std::vector<double> sigmas;  // of each image, a share of the extent; 0 where it is not registered
  double mean = 0;             // root mean square over the registered images
  double worst = 0;            // of all images
};

// None for fewer than three images, for centres on a line, for no more coordinates than unknowns, and where the equations
// have no solution. Lenses are uncertain as far as `options` refine them. Of many points some are used, and the result is
// scaled to all. The same for any number of threads.
[[nodiscard]] std::optional<CenterUncertainty> center_uncertainty(const Model& model,
                                                                  const MapperOptions& options);

// What uncertain centres leave of a model's trust, 0.5 to 1: half of the second half is gone where the worst is off by one
// per cent.
[[nodiscard]] double certainty_trust(const CenterUncertainty& uncertainty);

// Sets the uncertainty of each model and takes what it costs off its trust.
void add_uncertainty(const MapperOptions& options, Reconstruction& made);

}  // namespace tarsier::sfm
