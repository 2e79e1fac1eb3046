// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::sfm {

// A robust version of geometry::similarity_between(), for fewer than half wrong pairs. Takes the
// best of 1000 triples of pairs (of all triples where there are fewer), then refits to all pairs
// within `tolerance` (units of `to`, >= 0) until nothing changes. With tolerance 0, the best triple
// is the one with the least median distance (Rousseeuw, JASA 1984), and the tolerance is 3 (1 + 5 /
// (n - 2)) times that median. It keeps 99.9 % of normally distributed errors of many pairs, nearly
// all of few. At least five pairs are needed to detect a wrong one. The same seed gives the same
// result. Empty where similarity_between() is empty or fewer than three pairs agree. Throws as
// similarity_between(), and for a tolerance below 0.
[[nodiscard]] std::optional<geometry::Sim3> robust_similarity(
    const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to,
    double tolerance, std::uint64_t seed);

// Distances |similarity * from - to| of the pairs, in units of `to`.
[[nodiscard]] std::vector<double> residuals_of(const geometry::Sim3& similarity,
                                               const std::vector<Eigen::Vector3d>& from,
                                               const std::vector<Eigen::Vector3d>& to);

// Transforms points and registered poses. Projections into the images do not change. Throws
// std::invalid_argument unless the similarity is valid (scale > 0, proper rotation, all finite).
void transform(Model& model, const geometry::Sim3& similarity);

// Whether single precision rounds coordinates near `position` by more than a ten-thousandth of
// `length`, as metres of UTM in a scene of a few metres.
[[nodiscard]] bool is_beyond_float(const Eigen::Vector3d& position, double length);

// Reads known positions of images: lines "name,x,y,z". Blanks around fields and empty lines are
// allowed. A name with a comma stands in "...". A first line without numbers is a header. At most
// 100 MB. Throws InputError, which names the line: not four fields, an invalid number or one beyond
// 1e12, an empty or repeated name; or where there is no position at all.
[[nodiscard]] std::map<std::string, Eigen::Vector3d> read_positions_csv(const std::string& path);

}  // namespace tarsier::sfm
