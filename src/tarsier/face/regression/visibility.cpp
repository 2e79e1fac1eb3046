// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/visibility.h"

#include "tarsier/core/require.h"
#include "tarsier/face/regression/packing.h"
#include "tarsier/face/shape/shape_model.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::face::regression {

std::vector<bool> Visibility::hidden() const {
  std::vector<bool> out;
  for (const double probability : visible) out.push_back(probability < kMinVisibleProbability);
  return out;
}

void VisibilityModel::check() const {
  network.check();
  const linalg::Shape out = network.output({1, kVisibilitySide, kVisibilitySide});
  TARSIER_REQUIRE((out == linalg::Shape{2 * points(), 1, 1}),
                  "the visibility network gives {} numbers for {} points", out.size(), points());
  for (const double number : {hidden_slope, hidden_offset, sigma_offset})
    TARSIER_REQUIRE(std::abs(number) <= 100, "a calibration of {}", number);
}

Visibility visibility_of(const VisibilityModel& model, const cv::Mat& gray,
                         const Eigen::Matrix2Xd& points, VisibilityWorkspace& workspace) {
  const Eigen::Index n = model.mean.cols();
  TARSIER_REQUIRE(points.cols() == n, "{} points, the model has {}", points.cols(), n);
  Visibility visibility;
  const double size = points.allFinite() ? shape_size(points) : 0;
  if (size < 1) {
    visibility.visible = Eigen::VectorXd::Zero(n);
    visibility.sigma_px = Eigen::VectorXd::Constant(n, size);
    return visibility;
  }
  face_input(model.mean, gray, points, kVisibilitySide, kVisibilityScale, workspace.face);
  const std::vector<float>& out =
      linalg::run(model.network, workspace.face.values.data(),
                  {1, kVisibilitySide, kVisibilitySide}, workspace.network);
  const Eigen::ArrayXd values =
      Eigen::Map<const Eigen::VectorXf>(out.data(), 2 * n).cast<double>().array();
  visibility.visible = 1 / (1 + (model.hidden_slope * values.head(n) + model.hidden_offset).exp());
  // Limits: sigma is at least a thousandth of the size, and at most the size of the face's
  // surroundings.
  visibility.sigma_px =
      size * (values.tail(n) + model.sigma_offset).max(std::log(1e-3)).min(std::log(2.0)).exp();
  return visibility;
}

void VisibilityScore::add(const Visibility& visibility, const Eigen::Matrix2Xd& fitted,
                          const Eigen::Matrix2Xd& truth, const std::vector<bool>& is_hidden) {
  TARSIER_REQUIRE(fitted.cols() == truth.cols() && visibility.visible.size() == truth.cols() &&
                      is_hidden.size() == static_cast<std::size_t>(truth.cols()),
                  "{} points, {} fitted, {} visibilities, {} hidden or not", truth.cols(),
                  fitted.cols(), visibility.visible.size(), is_hidden.size());
  const std::vector<bool> flagged = visibility.hidden();
  for (Eigen::Index p = 0; p < truth.cols(); ++p) {
    const auto k = static_cast<std::size_t>(p);
    (is_hidden[k] ? hidden : visible) += 1;
    if (flagged[k]) (is_hidden[k] ? hidden_flagged : visible_flagged) += 1;
    if ((fitted.col(p) - truth.col(p)).norm() <= visibility.sigma_px[p]) ++within;
  }
}

double VisibilityScore::recall() const {
  return hidden == 0 ? 1 : static_cast<double>(hidden_flagged) / hidden;
}
double VisibilityScore::precision() const {
  const int flagged = hidden_flagged + visible_flagged;
  return flagged == 0 ? 1 : static_cast<double>(hidden_flagged) / flagged;
}
double VisibilityScore::coverage() const {
  return hidden + visible == 0 ? 1 : static_cast<double>(within) / (hidden + visible);
}

namespace {

void list_visibility(linalg::ModelFields& file, VisibilityModel& model) {
  list_mean(file, model.mean);
  file.network("network", model.network, linalg::Precision::kHalf);
  file.number("hidden_slope", model.hidden_slope, -100, 100);
  file.number("hidden_offset", model.hidden_offset, -100, 100);
  file.number("sigma_offset", model.sigma_offset, -100, 100);
}

}  // namespace

nlohmann::json to_json(const VisibilityModel& model) {
  model.check();
  return linalg::written(model, list_visibility);
}

VisibilityModel visibility_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_checked<VisibilityModel>(value, path, list_visibility);
}

}  // namespace tarsier::face::regression
