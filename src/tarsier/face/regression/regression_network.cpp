// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/regression_network.h"

#include "tarsier/core/require.h"
#include "tarsier/face/regression/packing.h"
#include "tarsier/face/shape/similarity.h"

#include <nlohmann/json.hpp>

namespace tarsier::face::regression {

void RegressionNetwork::check() const {
  network.check();
  const linalg::Shape out = network.output({1, kNetworkSide, kNetworkSide});
  TARSIER_REQUIRE((out == linalg::Shape{2 * points(), 1, 1}),
                  "the network gives {} numbers for {} points", out.size(), points());
  // The last layer, which adapt_network() changes.
  const linalg::Layer& last = network.layers.back();
  TARSIER_REQUIRE(network.layers.size() >= 2 && last.kind == linalg::Layer::Kind::kConvolution &&
                      last.kernel_x == 1 && last.kernel_y == 1 && !last.relu,
                  "the last of the network's {} layers is not linear", network.layers.size());
}

Eigen::Matrix2Xd fit_network(const RegressionNetwork& model, const cv::Mat& gray,
                             const Eigen::Matrix2Xd& start, RegressionNetworkWorkspace& workspace) {
  const Eigen::Index n = model.mean.cols();
  TARSIER_REQUIRE(start.cols() == n, "{} points, the model has {}", start.cols(), n);
  TARSIER_REQUIRE(start.allFinite() && shape_size(start) > 0, "the start has no size");
  face_input(model.mean, gray, start, kNetworkSide, kNetworkScale, workspace.face);
  const std::vector<float>& out = linalg::run(model.network, workspace.face.values.data(),
                                              {1, kNetworkSide, kNetworkSide}, workspace.network);
  Eigen::Matrix2Xd shape = model.mean;
  for (Eigen::Index p = 0; p < n; ++p) {
    shape(0, p) += static_cast<double>(out[static_cast<std::size_t>(p)]);
    shape(1, p) += static_cast<double>(out[static_cast<std::size_t>(n + p)]);
  }
  return shape::fit_similarity(model.mean, start)(shape);
}

namespace {

void list_regression_network(linalg::ModelFields& file, RegressionNetwork& model) {
  list_mean(file, model.mean);
  file.network("network", model.network, linalg::Precision::kHalf);
}

}  // namespace

nlohmann::json to_json(const RegressionNetwork& model) {
  model.check();
  return linalg::written(model, list_regression_network);
}

RegressionNetwork regression_network_from_json(const nlohmann::json& value,
                                               const std::string& path) {
  return linalg::read_checked<RegressionNetwork>(value, path, list_regression_network);
}

}  // namespace tarsier::face::regression
