// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/features.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/face/recognition/deep.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::face::recognition {

std::vector<float> features_of(const cv::Mat& face, const RecognizerOptions& options,
                               const DeepNetwork* network) {
  require_gray(face);
  if (options.algorithm == Algorithm::kDefault) return describe(face, options.descriptor);
  if (options.algorithm == Algorithm::kDeep) {
    TARSIER_REQUIRE(network != nullptr, "no network for deep templates");
    return embed_crop(*network, face);
  }
  cv::Mat sized = face;
  if (options.size.area() > 0 && face.size() != options.size)
    cv::resize(face, sized, options.size, 0, 0,
               face.cols > options.size.width ? cv::INTER_AREA : cv::INTER_LINEAR);
  if (options.algorithm == Algorithm::kLbph) return lbp_histograms(sized, options.lbp);
  std::vector<float> pixels;
  pixels.reserve(sized.total());
  for (int y = 0; y < sized.rows; ++y) {
    const auto* row = sized.ptr<unsigned char>(y);
    pixels.insert(pixels.end(), row, row + sized.cols);
  }
  return pixels;
}

std::vector<float> project(const Recognizer& model, const std::vector<float>& input) {
  TARSIER_REQUIRE(static_cast<Eigen::Index>(input.size()) == model.mean.size(),
                  "{} inputs, the model has {}", input.size(), model.mean.size());
  const Rows x =
      Eigen::Map<const Rows>(input.data(), 1, static_cast<Eigen::Index>(input.size())) - model.mean;
  Rows out = products(x, model.components);
  if (is_whitened(model.options.algorithm))
    scale_rows(out, x.cast<double>().rowwise().squaredNorm(), model.eigenvalues,
               model.residual_variance);
  return {out.data(), out.data() + out.size()};
}

void scale_rows(Rows& rows, const Eigen::VectorXd& square, const Eigen::VectorXd& scatter,
                double residual_variance) {
  for (Eigen::Index i = 0; i < rows.rows(); ++i) {
    const Eigen::ArrayXd squares = rows.row(i).cast<double>().array().square();
    const double inside = (squares * scatter.array()).sum();
    const double length =
        std::sqrt(squares.sum() + std::max(0.0, square(i) - inside) / residual_variance);
    if (length > 1e-12) rows.row(i) *= static_cast<float>(1 / length);
  }
}

Rows person_sums(const Rows& rows, const std::vector<int>& labels, int count) {
  Rows sums = Rows::Zero(count, rows.cols());
  for (Eigen::Index i = 0; i < rows.rows(); ++i)
    sums.row(labels[static_cast<std::size_t>(i)]) += rows.row(i);
  return sums;
}

std::vector<double> template_weights(const Rows& rows, const std::vector<int>& labels, int count) {
  constexpr double kMinMedianShare = 0.5;  // of the median; templates below it get weight 0
  constexpr std::size_t kMinTemplates = 3;
  constexpr int kPasses = 2;
  std::vector<std::vector<std::size_t>> by_person(static_cast<std::size_t>(count));
  std::vector<double> weights(labels.size(), 0.0);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    if (labels[i] < 0) continue;
    weights[i] = 1;
    if (!rows.row(static_cast<Eigen::Index>(i)).isZero(0))
      by_person[static_cast<std::size_t>(labels[i])].push_back(i);
  }
  for (const std::vector<std::size_t>& own : by_person) {
    if (own.size() < kMinTemplates) continue;
    for (int pass = 0; pass < kPasses; ++pass) {
      Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(rows.cols());
      for (const std::size_t i : own)
        sum += weights[i] * rows.row(static_cast<Eigen::Index>(i)).cast<double>();
      std::vector<double> similarities;
      for (const std::size_t i : own) {
        const Eigen::RowVectorXd row = rows.row(static_cast<Eigen::Index>(i)).cast<double>();
        const Eigen::RowVectorXd others = sum - weights[i] * row;
        const double length = row.norm() * others.norm();
        similarities.push_back(length > 1e-12 ? row.dot(others) / length : 0);
      }
      const double median = upper_median(similarities);
      if (median <= 0) break;  // the templates are not similar: none can be excluded
      for (std::size_t k = 0; k < own.size(); ++k)
        weights[own[k]] = similarities[k] >= kMinMedianShare * median ? 1 : 0;
    }
  }
  return weights;
}

}  // namespace tarsier::face::recognition
