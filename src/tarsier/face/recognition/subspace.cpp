// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/subspace.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/linalg/gemm.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::recognition {

Rows products(const Rows& a, const Rows& b) {
  TARSIER_REQUIRE(a.cols() == b.cols(), "{} and {} columns", a.cols(), b.cols());
  Rows out = Rows::Zero(a.rows(), b.rows());
  if (out.size() == 0) return out;
  // Blocks of rows that fit into the cache together.
  constexpr Eigen::Index kBlock = 32;
  const auto& kernels = linalg::gemm_kernels();
  const auto d = static_cast<std::ptrdiff_t>(a.cols());
  for (Eigen::Index i = 0; i < a.rows(); i += kBlock) {
    const auto rows = static_cast<int>(std::min(kBlock, a.rows() - i));
    for (Eigen::Index j = 0; j < b.rows(); j += kBlock) {
      const auto columns = static_cast<int>(std::min(kBlock, b.rows() - j));
      kernels.dots(rows, columns, static_cast<int>(d), a.data() + i * d, d, b.data() + j * d, d,
                   out.data() + i * out.cols() + j, static_cast<std::ptrdiff_t>(out.cols()));
    }
  }
  return out;
}

Pca principal_components(const Rows& samples, int max_components, const Eigen::RowVectorXf* mean) {
  TARSIER_REQUIRE(samples.rows() > 0 && samples.cols() > 0, "no samples");
  Pca pca;
  pca.mean = mean != nullptr
                 ? *mean
                 : Eigen::RowVectorXf(samples.cast<double>().colwise().mean().cast<float>());
  Rows centred = samples.rowwise() - pca.mean;
  const auto n = static_cast<double>(samples.rows());
  const bool by_gram = samples.rows() <= samples.cols();
  if (!by_gram) centred.transposeInPlace();
  Eigen::MatrixXd gram = products(centred, centred).cast<double>();
  gram = (gram + gram.transpose()).eval() / 2;
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(gram);
  const Eigen::VectorXd values = eigen.values.reverse();
  const double min_variance = std::max(1e-6 * values(0), 1e-12);
  Eigen::Index component_count = 0;
  while (component_count < values.size() && values(component_count) > min_variance)
    ++component_count;
  if (max_components > 0)
    component_count = std::min(component_count, static_cast<Eigen::Index>(max_components));
  // One eigenvector per row, the greatest first.
  const Rows vectors =
      eigen.vectors.rightCols(component_count).rowwise().reverse().transpose().cast<float>();
  pca.variance = values.head(component_count) / n;
  if (by_gram) {
    centred.transposeInPlace();  // d x n
    pca.components = products(vectors, centred);
    for (Eigen::Index i = 0; i < component_count; ++i) pca.components.row(i).normalize();
  } else {
    pca.components = vectors;
  }
  return pca;
}

Eigen::MatrixXd within_scatter(const Eigen::MatrixXd& samples, const std::vector<int>& labels,
                               int classes) {
  TARSIER_REQUIRE(static_cast<std::size_t>(samples.rows()) == labels.size(), "{} labels",
                  labels.size());
  Eigen::MatrixXd means = Eigen::MatrixXd::Zero(classes, samples.cols());
  Eigen::VectorXd counts = Eigen::VectorXd::Zero(classes);
  for (Eigen::Index i = 0; i < samples.rows(); ++i) {
    const int c = labels[static_cast<std::size_t>(i)];
    means.row(c) += samples.row(i);
    counts(c) += 1;
  }
  int present = 0;
  for (int c = 0; c < classes; ++c) {
    if (counts(c) == 0) continue;
    means.row(c) /= counts(c);
    ++present;
  }
  Eigen::MatrixXd centred = samples;
  for (Eigen::Index i = 0; i < samples.rows(); ++i)
    centred.row(i) -= means.row(labels[static_cast<std::size_t>(i)]);
  const auto freedom = static_cast<double>(samples.rows() - present);
  if (freedom <= 0) return Eigen::MatrixXd::Zero(samples.cols(), samples.cols());
  // Compute the lower half of the symmetric matrix, then copy it.
  Eigen::MatrixXd scatter = Eigen::MatrixXd::Zero(samples.cols(), samples.cols());
  scatter.selfadjointView<Eigen::Lower>().rankUpdate(centred.transpose(), 1 / freedom);
  return Eigen::MatrixXd(scatter.selfadjointView<Eigen::Lower>());
}

Eigen::MatrixXd linear_discriminants(const Eigen::MatrixXd& samples, const std::vector<int>& labels,
                                     int classes, Eigen::VectorXd* ratios) {
  TARSIER_REQUIRE(classes >= 2, "discriminants need at least two people, there is {}", classes);
  const Eigen::MatrixXd within = within_scatter(samples, labels, classes);
  const Eigen::RowVectorXd mean = samples.colwise().mean();
  Eigen::MatrixXd between = Eigen::MatrixXd::Zero(samples.cols(), samples.cols());
  for (int c = 0; c < classes; ++c) {
    Eigen::RowVectorXd own = Eigen::RowVectorXd::Zero(samples.cols());
    double count = 0;
    for (Eigen::Index i = 0; i < samples.rows(); ++i) {
      if (labels[static_cast<std::size_t>(i)] != c) continue;
      own += samples.row(i);
      count += 1;
    }
    if (count == 0) continue;
    own = own / count - mean;
    between += count * own.transpose() * own;
  }
  // The tiny ridge matters only if images repeat and the scatter within classes is singular.
  Eigen::MatrixXd ridged = within;
  const double trace = within.trace() / static_cast<double>(within.rows());
  ridged.diagonal().array() += std::max(1e-9 * trace, 1e-12);
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(between, ridged);
  const Eigen::Index component_count = std::min<Eigen::Index>(classes - 1, samples.cols());
  Eigen::MatrixXd directions = eigen.vectors.rightCols(component_count).rowwise().reverse();
  directions.colwise().normalize();
  if (ratios != nullptr) *ratios = eigen.values.tail(component_count).reverse();
  return directions;
}

Whitening whitening(const Eigen::MatrixXd& scatter, double lambda) {
  Whitening out;
  const double trace = scatter.trace() / static_cast<double>(scatter.rows());
  out.residual_variance = trace > 0 ? lambda * trace : 1.0;
  Eigen::MatrixXd ridged = scatter;
  ridged.diagonal().array() += out.residual_variance;
  const linalg::SymmetricEigen eigen = linalg::symmetric_eigen(ridged);
  out.scatter = eigen.values.cwiseMax(1e-6 * out.residual_variance);
  out.directions = eigen.vectors * out.scatter.cwiseSqrt().cwiseInverse().asDiagonal();
  return out;
}

}  // namespace tarsier::face::recognition
