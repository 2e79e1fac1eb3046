// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/regression/occlusion.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/shape/similarity.h"
#include "tarsier/linalg/trainer.h"

#include <opencv2/imgproc.hpp>

#include <array>
#include <cmath>

namespace tarsier::face::regression {
namespace {

constexpr double kRounding = 0.004;  // rounds the loss near 0, shares of the shape's size
// Offsets of starts from the face, standard deviations at a spread of 1; spreads are uniform.
constexpr double kSpreadShift = 0.08;     // shares of the size
constexpr double kSpreadScale = 0.08;     // of the logarithm
constexpr double kSpreadRotation = 0.15;  // radians
constexpr double kMinSpread = 0.1;
constexpr double kMaxSpread = 1.2;

linalg::Network untrained_regression_network(int points) {
  linalg::Network network;
  const auto add = [&](int in, int out, int kernel, int stride) -> linalg::Layer& {
    linalg::Layer layer = linalg::convolution(in, out, kernel, kernel);
    layer.stride = stride;
    network.layers.push_back(std::move(layer));
    return network.layers.back();
  };
  add(1, 16, 5, 2);
  add(16, 32, 3, 2);
  add(32, 32, 3, 1);
  add(32, 64, 3, 2);
  add(64, 64, 3, 1);
  add(64, 96, 3, 2);
  add(96, 128, 3, 2);
  linalg::Layer& all = add(128, 192, 3, 1);
  all.pad_y = all.pad_x = 0;
  network.layers.push_back(linalg::convolution(192, 2 * points, 1, 1, false));
  return network;
}

// Changes light and sharpness like another camera.
void change_lighting(cv::Mat& gray, Rng& rng) {
  if (rng.uniform() < 0.5) {
    const double gamma = std::exp(rng.normal(0, 0.35));
    std::array<std::uint8_t, 256> table{};
    for (std::size_t i = 0; i < table.size(); ++i) {
      const double level = std::pow(static_cast<double>(i) / 255, gamma);
      table[i] = cv::saturate_cast<std::uint8_t>(255 * level);
    }
    cv::LUT(gray, cv::Mat(1, 256, CV_8UC1, table.data()), gray);
  }
  if (rng.uniform() < 0.3) {
    const double sigma = rng.uniform(0.5, 2.5);
    cv::GaussianBlur(gray, gray, cv::Size(), sigma);
  }
}

// The mean shape near the face.
Eigen::Matrix2Xd scattered_start(const Eigen::Matrix2Xd& mean, const TrainingFace& face, Rng& rng) {
  const double spread = rng.uniform(kMinSpread, kMaxSpread);
  const Eigen::Vector2d center = face.points.rowwise().mean();
  const double size = shape_size(face.points);
  const double turn = rng.normal(0, kSpreadRotation * spread);
  const double scale = size * std::exp(rng.normal(0, kSpreadScale * spread));
  const double across = rng.normal(0, kSpreadShift * spread);
  const double down = rng.normal(0, kSpreadShift * spread);
  const double angle = shape::fit_similarity(mean, face.points).angle() + turn;
  const shape::Similarity2d similarity{scale * std::cos(angle), scale * std::sin(angle),
                                       center.x() + size * across, center.y() + size * down};
  return similarity(mean);
}

// The network's input for face `f`, and the offsets of its points from those of the mean.
void make_example(const std::vector<TrainingFace>& faces, std::size_t f,
                  const Eigen::Matrix2Xd& mean, double occluded, Rng& rng,
                  linalg::Example& example) {
  thread_local FaceInput input;
  const TrainingFace& face = faces[f];
  cv::Mat gray = face.gray.clone();
  if (rng.uniform() < occluded) {
    const int others = static_cast<int>(faces.size()) - 1;
    const auto other = (f + static_cast<std::size_t>(rng.integer(1, others))) % faces.size();
    (void)draw_occlusion(gray, face.points, faces[other].gray, rng);
  }
  change_lighting(gray, rng);
  const Eigen::Matrix2Xd start = scattered_start(mean, face, rng);
  face_input(mean, gray, start, kNetworkSide, kNetworkScale, input);
  example.shape = {1, kNetworkSide, kNetworkSide};
  example.input = input.values;
  const Eigen::Matrix2Xd truth = shape::fit_similarity(mean, start).inverse()(face.points) - mean;
  const auto n = static_cast<std::size_t>(mean.cols());
  example.target.resize(2 * n);
  for (std::size_t p = 0; p < n; ++p) {
    example.target[p] = static_cast<float>(truth(0, static_cast<Eigen::Index>(p)));
    example.target[n + p] = static_cast<float>(truth(1, static_cast<Eigen::Index>(p)));
  }
}

// Mean distance of a point from its true position: the measure used for landmarks.
double distance_loss(const linalg::Example& example, const std::vector<float>& output,
                     std::vector<float>& derivative) {
  const std::size_t n = output.size() / 2;
  derivative.resize(output.size());
  double loss = 0;
  for (std::size_t p = 0; p < n; ++p) {
    const auto dx = static_cast<double>(output[p] - example.target[p]);
    const auto dy = static_cast<double>(output[n + p] - example.target[n + p]);
    const double distance = std::sqrt(dx * dx + dy * dy + kRounding * kRounding);
    loss += distance;
    const double share = 1 / (distance * static_cast<double>(n));
    derivative[p] = static_cast<float>(dx * share);
    derivative[n + p] = static_cast<float>(dy * share);
  }
  return loss / static_cast<double>(n);
}

}  // namespace

RegressionNetwork train_regression_network(const std::vector<TrainingFace>& faces,
                                           const RegressionNetworkOptions& options,
                                           Progress& progress, const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(faces.size() >= 2, "{} faces: two at least are needed", faces.size());
  for (const TrainingFace& face : faces) {
    TARSIER_REQUIRE(face.points.cols() == faces.front().points.cols(),
                    "{}: {} points, others have {}", face.name, face.points.cols(),
                    faces.front().points.cols());
  }
  RegressionNetwork model;
  model.mean = mean_shape(faces);
  model.network = untrained_regression_network(model.points());
  Rng rng = Rng(options.seed).fork(5);
  linalg::initialize(model.network, rng);
  linalg::TrainOptions training;
  training.steps = options.steps;
  training.seed = options.seed;
  const auto make = [&](std::int64_t, Rng& own, linalg::Example& example) {
    const int f = own.integer(0, static_cast<int>(faces.size()) - 1);
    make_example(faces, static_cast<std::size_t>(f), model.mean, options.occluded, own, example);
  };
  const auto loss = [](const linalg::Example& example, const std::vector<float>& output,
                       linalg::Shape, std::vector<float>& derivative) {
    return distance_loss(example, output, derivative);
  };
  linalg::train(model.network, training, "network", make, loss, progress, stop);
  linalg::round_to_half(model.network);  // as it will be stored
  return model;
}

}  // namespace tarsier::face::regression
