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

// geometry::similarity_between() in spite of wrong pairs, fewer than half: the best of 1000 triples (of all, where there
// are not more), then again and again from all pairs within `tolerance` (units of `to`, > 0). With
// tolerance 0 the best triple is the one of the least median distance (Rousseeuw, JASA 1984), and
// within means 3 (1 + 5 / (n - 2)) times the median: 99.9 % of normal errors of many pairs, nearly
// all of few. Needs five pairs to find a wrong one. Same seed, same result. Empty where
// similarity_between() is, or where fewer than three pairs agree. Throws as similarity_between(),
// and for a tolerance below 0.
[[nodiscard]] std::optional<geometry::Sim3> robust_similarity(
    const std::vector<Eigen::Vector3d>& from, const std::vector<Eigen::Vector3d>& to,
    double tolerance, std::uint64_t seed);

// Distances |similarity * from - to| of the pairs, and their median (the upper one of an even
// number; 0 for no pairs), in units of `to`.
[[nodiscard]] std::vector<double> residuals_of(const geometry::Sim3& similarity,
                                               const std::vector<Eigen::Vector3d>& from,
                                               const std::vector<Eigen::Vector3d>& to);
[[nodiscard]] double median_residual(const geometry::Sim3& similarity,
                                     const std::vector<Eigen::Vector3d>& from,
                                     const std::vector<Eigen::Vector3d>& to);

// Moves points and registered poses; what the images see stays the same. Throws
// std::invalid_argument unless the similarity is one (scale > 0, rotation proper, all finite).
void transform(Model& model, const geometry::Sim3& similarity);

// Known positions of images: lines "name,x,y,z", blanks around the fields and empty lines
// allowed, a name with a comma in "...", a first line without numbers is a header. Up to 100 MB.
// Throws InputError that names the line: not four fields, a number that is none or beyond 1e12, a
// name that is empty or there twice; or that there is no position at all.
[[nodiscard]] std::map<std::string, Eigen::Vector3d> read_positions_csv(const std::string& path);

}  // namespace tarsier::sfm
