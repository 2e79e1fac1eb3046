// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_model.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::head {

using Eigen::Index;

namespace {
constexpr double kMaxModelValue = 1e6;  // mm, limit for all numbers of a model
constexpr double kMinNoise = 1e-6;      // mm
}  // namespace

void HeadModel::check() const {
  const int n = points();
  const int m = mode_count();
  TARSIER_REQUIRE(n >= 4, "a head of {} points", n);
  TARSIER_REQUIRE(mean.allFinite() && mean.cwiseAbs().maxCoeff() <= kMaxModelValue,
                  "the mean is not finite or beyond {} mm", kMaxModelValue);
  TARSIER_REQUIRE(modes.rows() == 3 * n || m == 0, "modes of {} rows for {} points", modes.rows(),
                  n);
  TARSIER_REQUIRE(m == 0 || modes.allFinite(), "the modes are not finite");
  TARSIER_REQUIRE(deviation.size() == m, "{} deviations of {} modes", deviation.size(), m);
  TARSIER_REQUIRE(landmark.size() == static_cast<std::size_t>(n),
                  "{} landmark numbers of {} points", landmark.size(), n);
  // Points are weighted by 1 / noise^2.
  TARSIER_REQUIRE(noise.size() == n && noise.allFinite() && noise.minCoeff() >= kMinNoise &&
                      noise.maxCoeff() <= kMaxModelValue,
                  "the noise of the points must be {} numbers of {} to {} mm", n, kMinNoise,
                  kMaxModelValue);
  for (const int number : landmark) TARSIER_REQUIRE(number >= 0, "landmark number {}", number);
  for (int k = 0; k < m; ++k) {
    TARSIER_REQUIRE(deviation[k] >= 0 && deviation[k] <= kMaxModelValue &&
                        (k == 0 || deviation[k] <= deviation[k - 1]),
                    "deviation {} is {}", k, deviation[k]);
  }
  const Eigen::MatrixXd product = modes.transpose() * modes;
  TARSIER_REQUIRE(
      m == 0 || (product - Eigen::MatrixXd::Identity(m, m)).cwiseAbs().maxCoeff() < 1e-6,
      "the modes are not orthonormal");
  TARSIER_REQUIRE(mirror.empty() || mirror.size() == static_cast<std::size_t>(n),
                  "a mirror of {} points for {} points", mirror.size(), n);
  for (std::size_t i = 0; i < mirror.size(); ++i) {
    const int other = mirror[i];
    TARSIER_REQUIRE(
        other >= 0 && other < n && mirror[static_cast<std::size_t>(other)] == static_cast<int>(i),
        "the mirror of point {} is {}", i, other);
    const auto a = static_cast<Index>(i);
    const Eigen::Vector3d flip(-1, 1, 1);
    TARSIER_REQUIRE((mean.col(a) - flip.cwiseProduct(mean.col(other))).norm() < 1e-3,
                    "points {} and {} of the mean are not symmetric", i, other);
    for (int k = 0; k < m; ++k) {
      TARSIER_REQUIRE((modes.col(k).segment<3>(3 * a) -
                       flip.cwiseProduct(Eigen::Vector3d(modes.col(k).segment<3>(3 * other))))
                              .norm() < 1e-3,
                      "mode {} is not symmetric at points {} and {}", k, i, other);
    }
  }
  const bool has_eyes = outer_eyes[0] >= 0 || outer_eyes[1] >= 0;
  for (const int eye : outer_eyes) {
    TARSIER_REQUIRE(!has_eyes || (eye >= 0 && eye < n), "outer eye corner {} of {} points", eye, n);
  }
  TARSIER_REQUIRE(!has_eyes || outer_eyes[0] != outer_eyes[1],
                  "both outer eye corners are point {}", outer_eyes[0]);
  for (const auto& [a, b] : connections) {
    TARSIER_REQUIRE(a >= 0 && a < n && b >= 0 && b < n, "a connection of {} and {} of {} points", a,
                    b, n);
  }
  for (const int i : outline) TARSIER_REQUIRE(i >= 0 && i < n, "outline point {} of {}", i, n);
  TARSIER_REQUIRE(trained_on >= 0, "trained on {} faces", trained_on);
}

Eigen::Matrix3Xd shape_of(const HeadModel& model, const Eigen::VectorXd& b) {
  TARSIER_REQUIRE(b.size() <= model.mode_count(), "{} parameters for {} modes", b.size(),
                  model.mode_count());
  Eigen::Matrix3Xd shape = model.mean;
  if (b.size() > 0) {
    Eigen::Map<Eigen::VectorXd>(shape.data(), shape.size()) += model.modes.leftCols(b.size()) * b;
  }
  return shape;
}

HeadModel select_points(const HeadModel& model, const std::vector<int>& points) {
  model.check();
  std::vector<int> place(static_cast<std::size_t>(model.points()), -1);
  TARSIER_REQUIRE(points.size() >= 4, "{} points selected", points.size());
  for (std::size_t k = 0; k < points.size(); ++k) {
    TARSIER_REQUIRE(points[k] >= 0 && points[k] < model.points(), "point {} of {}", points[k],
                    model.points());
    int& at = place[static_cast<std::size_t>(points[k])];
    TARSIER_REQUIRE(at < 0, "point {} is selected twice", points[k]);
    at = static_cast<int>(k);
  }
  const auto n = static_cast<Index>(points.size());
  HeadModel part;
  part.mean.resize(3, n);
  part.noise.resize(n);
  Eigen::MatrixXd modes(3 * n, model.mode_count());
  bool is_symmetric = !model.mirror.empty();
  for (Index k = 0; k < n; ++k) {
    const auto from = static_cast<std::size_t>(points[static_cast<std::size_t>(k)]);
    const auto i = static_cast<Index>(from);
    part.mean.col(k) = model.mean.col(i);
    part.noise[k] = model.noise[i];
    modes.middleRows(3 * k, 3) = model.modes.middleRows(3 * i, 3);
    part.landmark.push_back(model.landmark[from]);
    if (is_symmetric) {
      part.mirror.push_back(place[static_cast<std::size_t>(model.mirror[from])]);
      is_symmetric = part.mirror.back() >= 0;
    }
  }
  if (!is_symmetric) part.mirror.clear();
  part.modes.resize(3 * n, 0);
  if (model.mode_count() > 0) {
    const linalg::LeftSvd svd = linalg::left_svd(modes * model.deviation.asDiagonal());
    const Index kept = (svd.values.array() > 1e-9 * svd.values[0]).count();
    part.modes = svd.u.leftCols(kept);
    part.deviation = svd.values.head(kept);
  }
  for (std::size_t e = 0; e < 2; ++e) {
    if (model.outer_eyes[e] >= 0)
      part.outer_eyes[e] = place[static_cast<std::size_t>(model.outer_eyes[e])];
  }
  if (part.outer_eyes[0] < 0 || part.outer_eyes[1] < 0) part.outer_eyes = {-1, -1};
  for (const auto& [a, b] : model.connections) {
    const int from = place[static_cast<std::size_t>(a)];
    const int to = place[static_cast<std::size_t>(b)];
    if (from >= 0 && to >= 0) part.connections.push_back({from, to});
  }
  for (const int i : model.outline) {
    if (place[static_cast<std::size_t>(i)] >= 0)
      part.outline.push_back(place[static_cast<std::size_t>(i)]);
  }
  part.trained_on = model.trained_on;
  return part;
}

}  // namespace tarsier::face::head
