// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/background.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/face/recognition/features.h"
#include "tarsier/linalg/model_fields.h"

#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

namespace tarsier::face::recognition {
namespace {

using nlohmann::json;

constexpr const char* kBackgroundType = "face-background";
constexpr int kBackgroundVersion = 1;
constexpr std::int64_t kMaxNumbers = 20'000;

Eigen::RowVectorXf described(const cv::Mat& face, const BackgroundOptions& options) {
  const std::vector<float> values =
      options.network ? embed_crop(*options.network, face) : describe(face, options.descriptor);
  return Eigen::Map<const Eigen::RowVectorXf>(values.data(),
                                              static_cast<Eigen::Index>(values.size()));
}

}  // namespace

void Background::check() const {
  TARSIER_REQUIRE(mean.size() > 0 && mean.allFinite() && weight > 0 && weight <= 1000,
                  "a background of {} numbers, weight {}", mean.size(), weight);
  const Eigen::Index m = basis.rows();
  if (m == 0) return;
  TARSIER_REQUIRE(basis.cols() == mean.size() && basis.allFinite() && variance.size() == m &&
                      variance.allFinite() && variance.minCoeff() >= 0 && within.rows() == m &&
                      within.cols() == m && within.allFinite(),
                  "a background's parts do not fit together");
  TARSIER_REQUIRE(std::isfinite(residual_variance) && residual_variance >= 0 &&
                      std::isfinite(within_residual_variance) && within_residual_variance >= 0 &&
                      within_weight > 0 && within_weight <= 1e6,
                  "outside {}, within {}, weight {}", residual_variance, within_residual_variance,
                  within_weight);
}

Background background_of(std::span<const cv::Mat> faces, const DescriptorOptions& options) {
  TARSIER_REQUIRE(!faces.empty(), "no faces");
  Eigen::RowVectorXd sum = Eigen::RowVectorXd::Zero(descriptor_length(options));
  for (const auto& face : faces) {
    const auto values = describe(face, options);
    sum += Eigen::Map<const Eigen::RowVectorXf>(values.data(),
                                                static_cast<Eigen::Index>(values.size()))
               .cast<double>();
  }
  Background out;
  out.mean = (sum / static_cast<double>(faces.size())).cast<float>();
  return out;
}

void BackgroundOptions::check() const {
  check_fields(*this);
  descriptor.check();
}

cv::Mat relit_face(const cv::Mat& gray, double strength, std::uint64_t seed) {
  require_gray(gray);
  Rng rng(seed);
  const double across = strength * rng.normal();
  const double down = 0.5 * strength * rng.normal();
  const double gamma = std::exp(0.3 * strength * rng.normal());
  const double bulge = 0.7 * strength * rng.normal();
  double power[256];
  for (int g = 0; g < 256; ++g) power[g] = 255 * std::pow(g / 255.0, gamma);
  cv::Mat out(gray.size(), CV_8UC1);
  for (int y = 0; y < gray.rows; ++y) {
    const double v = (2.0 * y + 1) / gray.rows - 1;
    for (int x = 0; x < gray.cols; ++x) {
      const double u = (2.0 * x + 1) / gray.cols - 1;
      const double gain = std::exp(across * u + down * v + bulge * (u * u - 0.3));
      out.at<unsigned char>(y, x) = cv::saturate_cast<unsigned char>(
          gain * power[gray.at<unsigned char>(y, x)] + 2 * rng.normal());
    }
  }
  return out;
}

Background learn_background(std::span<const cv::Mat> faces, const BackgroundOptions& options,
                            Progress& progress, const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(faces.size() >= 3, "{} faces", faces.size());
  for (const cv::Mat& face : faces) require_gray(face);
  const auto count = static_cast<Eigen::Index>(faces.size());
  const int images = options.variants + 1;
  Rows rows(count * images,
            options.network ? options.network->outputs() : descriptor_length(options.descriptor));
  progress.begin("describing", count, "faces");
  for (Eigen::Index i = 0; i < count; ++i) {
    throw_if_stopped(stop);
    const cv::Mat& face = faces[static_cast<std::size_t>(i)];
    Rng rng = Rng(options.seed).fork(static_cast<std::uint64_t>(i));
    rows.row(i * images) = described(face, options);
    const double px = options.moved_px * face.cols / 64;
    for (int k = 1; k < images; ++k) {
      const double dx = px * rng.normal();
      const double dy = px * rng.normal();
      const double degrees = 2 * options.moved_px * rng.normal();
      const double scale = 1 + 0.02 * options.moved_px * rng.normal();
      rows.row(i * images + k) = described(
          relit_face(transformed_face(face, dx, dy, degrees, scale), options.relight, rng()),
          options);
    }
    progress.advance();
  }
  progress.end();

  Background out;
  out.weight = options.weight;
  out.within_weight = options.within_weight;
  Rows people(count, rows.cols());
  for (Eigen::Index i = 0; i < count; ++i) people.row(i) = rows.row(i * images);
  const Pca pca = principal_components(people, options.components);
  out.mean = pca.mean;
  out.basis = pca.components;
  out.variance = pca.variance;
  const Rows centred = rows.rowwise() - out.mean;
  const Eigen::MatrixXd coefficients = products(centred, out.basis).cast<double>();
  std::vector<int> labels;
  for (Eigen::Index i = 0; i < centred.rows(); ++i) labels.push_back(static_cast<int>(i / images));
  out.within = within_scatter(coefficients, labels, static_cast<int>(count));
  for (Eigen::Index i = 0; i < count; ++i) {
    out.residual_variance += centred.row(i * images).cast<double>().squaredNorm() -
                             coefficients.row(i * images).squaredNorm();
    const Eigen::RowVectorXd mean =
        centred.middleRows(i * images, images).cast<double>().colwise().mean();
    const Eigen::RowVectorXd mean_inside =
        coefficients.middleRows(i * images, images).colwise().mean();
    for (int k = 0; k < images; ++k) {
      const Eigen::Index row = i * images + k;
      out.within_residual_variance += (centred.row(row).cast<double>() - mean).squaredNorm() -
                                      (coefficients.row(row) - mean_inside).squaredNorm();
    }
  }
  out.residual_variance = std::max(0.0, out.residual_variance / static_cast<double>(count));
  out.within_residual_variance =
      std::max(0.0, out.within_residual_variance / static_cast<double>(count * options.variants));
  out.network = options.network;
  if (out.network) {
    out.network_fingerprint = out.network->fingerprint;
    // Synthetic images vary less than real images of a person, and in other directions. The network
    // was trained to suppress such variation. Therefore the scatter is the same in all directions.
    const auto directions = static_cast<double>(out.within.rows());
    out.within = Eigen::MatrixXd::Identity(out.within.rows(), out.within.cols()) *
                 (out.within.trace() / directions);
  }
  out.check();
  return out;
}

namespace {

void list_background(linalg::ModelFields& file, Background& background) {
  file.number("weight", background.weight, 1e-6, 1000);
  file.matrix("basis", background.basis, -1, -1);
  const Eigen::Index rows = background.basis.rows();
  file.require(rows >= 1 && rows <= 2000 && background.basis.cols() <= kMaxNumbers,
               "'basis' is too large");
  file.matrix("mean", background.mean, 1, background.basis.cols());
  file.matrix<float>("variance", background.variance, 1, rows);
  file.number("outside", background.residual_variance, 0, 1e6);
  file.matrix<float>("within", background.within, rows, rows);
  file.number("within_rest", background.within_residual_variance, 0, 1e6);
  file.number("within_weight", background.within_weight, 1e-6, 1e6);
  file.number("genuine", background.prior.genuine, -1, 1);
  if (file.has("network", background.network_fingerprint != 0))
    file.whole("network", background.network_fingerprint, 1);
}

}  // namespace

void write_background(const std::string& path, const Background& background,
                      const json& provenance) {
  background.check();
  TARSIER_REQUIRE(background.basis.rows() > 0, "a background of a mean alone");
  write_archive(path, {kBackgroundType, kBackgroundVersion, provenance,
                       linalg::written(background, list_background)});
}

Background read_background(const std::string& path) {
  auto out = linalg::read_fields<Background>(
      read_archive(path, kBackgroundType, kBackgroundVersion).payload, path, list_background);
  const Eigen::MatrixXd& within = out.within;
  if ((within - within.transpose()).cwiseAbs().maxCoeff() >
      1e-4 * (1e-9 + within.cwiseAbs().maxCoeff()))
    throw ModelError(path, "'within' is not symmetric");
  return checked(std::move(out), path);
}

}  // namespace tarsier::face::recognition
