// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <vector>

// Linear subspaces of many more numbers than samples.
namespace tarsier::face::recognition {

// A sample, or a direction, per row: dot products run over consecutive numbers.
using Rows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

struct Pca {
  Eigen::RowVectorXf mean;
  Rows components;           // m x d, orthonormal rows, by falling variance
  Eigen::VectorXd variance;  // m, along each (sum of squares / samples)
};

// a b^T by the machine's vector instructions, single precision; a: n x d, b: m x d.
[[nodiscard]] Rows products(const Rows& a, const Rows& b);

// Principal components through the n x n Gram matrix (Turk and Pentland, "Eigenfaces for
// recognition", 1991). At most `most` components (0: all), none below 1e-6 of the greatest
// variance. `mean`: taken off, in place of the samples' own.
[[nodiscard]] Pca principal_components(const Rows& samples, int most = 0,
                                       const Eigen::RowVectorXf* mean = nullptr);

// Scatter within classes (labels 0..classes-1), divided by (samples - classes that have any).
// Zero where that is none.
[[nodiscard]] Eigen::MatrixXd within_scatter(const Eigen::MatrixXd& samples,
                                             const std::vector<int>& labels, int classes);

// Linear discriminants (Fisher; Belhumeur, Hespanha and Kriegman, "Eigenfaces vs. Fisherfaces",
// PAMI 1997): the columns are the directions of greatest ratio of scatter between to within
// classes, each of length 1, at most classes - 1. Samples per row. `ratios`, if given: the ratios.
[[nodiscard]] Eigen::MatrixXd linear_discriminants(const Eigen::MatrixXd& samples,
                                                   const std::vector<int>& labels, int classes,
                                                   Eigen::VectorXd* ratios = nullptr);

struct Whitening {
  Eigen::MatrixXd directions;  // W, each column an eigenvector / sqrt(scatter)
  Eigen::VectorXd scatter;     // along each, with the ridge
  double rest = 1;             // the ridge: lambda trace(S) / n
};
// W^T (S + lambda trace(S) / n I) W = I for a scatter S, n x n. Of a scatter of zeros: I, rest 1.
[[nodiscard]] Whitening whitening(const Eigen::MatrixXd& scatter, double lambda);

}  // namespace tarsier::face::recognition
