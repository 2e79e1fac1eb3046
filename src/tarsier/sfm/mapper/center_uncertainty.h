// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <optional>
#include <vector>

namespace tarsier::sfm {

struct MapperOptions;
struct Reconstruction;

// Uncertainty of the camera centres of a model, given its observations: standard deviations as
// shares of the extent (the diagonal of the bounding box of the centres).
//
// Noise is propagated through the adjustment to first order. J are the derivatives of the weighted
// residuals, n is noise of the size of the model's residuals, and d = -(J^T J)^-1 J^T n. The
// centres moved by d are compared with the model's centres after the best similarity, since
// observations do not determine position, orientation and scale. The root mean square over the
// samples is the standard deviation (a parametric bootstrap, Efron and Tibshirani, An Introduction
// to the Bootstrap, 1993, section 6.5). Wrong correspondences are not considered: a folded model
// may have a certain shape. A long chain of images that bends has an uncertain one.
struct CenterUncertainty {
  // Noise of a coordinate of an observation: the root mean square of the weighted residuals,
  // divided by the root of the redundancy (the share of coordinates beyond the number of unknowns).
  double sigma_px = 0;
  std::vector<double> sigmas;  // per image, a share of the extent; 0 where it is not registered
  double mean = 0;             // root mean square over the registered images
  double worst = 0;            // maximum over the images
};

// Empty for fewer than three images, for collinear centres, for no more coordinates than unknowns,
// and where the equations have no solution. Lenses are uncertain as far as `options` refine them.
// Of many points a part is used, and the result is scaled to all. Does not depend on the number of
// threads.
[[nodiscard]] std::optional<CenterUncertainty> center_uncertainty(const Model& model,
                                                                  const MapperOptions& options);

// Factor of a model's trust by uncertain centres, 0.5 to 1; 0.75 where the worst standard deviation
// is one per cent.
[[nodiscard]] double uncertainty_trust_factor(const CenterUncertainty& uncertainty);

// Sets the uncertainty of each model and multiplies its trust by uncertainty_trust_factor().
void add_uncertainty(const MapperOptions& options, Reconstruction& made);

}  // namespace tarsier::sfm
