// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <vector>

// Linear subspaces of vectors with many more dimensions than samples.
namespace tarsier::face::recognition {

// A sample or a direction per row, contiguous for dot products.
using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Pca {
  Eigen::RowVectorXf mean;
  Rows components;           // m x d, orthonormal rows, by falling variance
  Eigen::VectorXd variance;  // m, along each component (sum of squares / samples)
};

// a b^T in single precision with the machine's vector instructions; a: n x d, b: m x d.
[[nodiscard]] Rows products(const Rows& a, const Rows& b);

// Principal components through the n x n Gram matrix (Turk and Pentland, "Eigenfaces for
// recognition", 1991). At most `max_components` components (0: all), without those below 1e-6 of
// the greatest variance. `mean` is subtracted instead of the samples' own mean.
[[nodiscard]] Pca principal_components(const Rows& samples, int max_components = 0,
                                       const Eigen::RowVectorXf* mean = nullptr);

// Scatter within classes (labels 0..classes-1), divided by (samples - non-empty classes). Zero if
// this difference is zero.
[[nodiscard]] Eigen::MatrixXd within_scatter(const Eigen::MatrixXd& samples,
                                             const std::vector<int>& labels, int classes);

// Linear discriminants (Fisher; Belhumeur, Hespanha and Kriegman, "Eigenfaces vs. Fisherfaces",
// PAMI 1997). The columns are the directions with the greatest ratio of scatter between classes to
// scatter within classes, each of length 1; at most classes - 1. One sample per row. `ratios`, if
// not null, receives the ratios.
[[nodiscard]] Eigen::MatrixXd linear_discriminants(const Eigen::MatrixXd& samples,
                                                   const std::vector<int>& labels, int classes,
                                                   Eigen::VectorXd* ratios = nullptr);

struct Whitening {
  Eigen::MatrixXd directions;    // W, each column an eigenvector / sqrt(scatter)
  Eigen::VectorXd scatter;       // along each direction, with the ridge
  double residual_variance = 1;  // the ridge: lambda trace(S) / n
};
// W^T (S + lambda trace(S) / n I) W = I for a scatter S, n x n. For a scatter of zeros: W = I and
// `residual_variance` = 1.
[[nodiscard]] Whitening whitening(const Eigen::MatrixXd& scatter, double lambda);

}  // namespace tarsier::face::recognition
