// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/statistics.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/mirror_shift.h"
#include "tarsier/face/regression/occlusion.h"
#include "tarsier/face/regression/starts.h"
#include "tarsier/face/regression/visibility.h"
#include "tarsier/linalg/losses.h"
#include "tarsier/linalg/trainer.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::face::regression {
namespace {

constexpr double kSigmaQuantile = 0.68;  // share of points within sigma
constexpr double kMinError = 0.005;  // errors below this count as this, shares of the shape's size
// Errors of a tracker's fits, relative to those of a descent that was trained on half of the faces
// (measured: 0.84 on one half of the held-out faces, 0.77 on the other; nearly the same with
// occlusions).
constexpr double kErrorRatio = 0.80;
constexpr int kStarts = 6;            // per face, for the descents
constexpr int kHoldOut = 5;           // every kHoldOut-th face is held out for calibration
constexpr int kExamplesPerFace = 6;   // examples of each of these
constexpr float kErrorWeight = 0.5F;  // of the errors' part of the loss
constexpr float kHuberThreshold = 1;  // of its Huber loss; a factor of e

linalg::Network untrained_visibility_network(int points) {
  linalg::Network network;
  linalg::Layer first = linalg::convolution(1, 12, 5, 5);
  first.stride = 2;
  network.layers.push_back(std::move(first));
  for (const auto& [in, out] : {std::pair{12, 24}, std::pair{24, 48}, std::pair{48, 64}}) {
    linalg::Layer layer = linalg::convolution(in, out, 3, 3);
    layer.stride = 2;
    network.layers.push_back(std::move(layer));
  }
  linalg::Layer all = linalg::convolution(64, 128, 4, 4);
  all.pad_y = all.pad_x = 0;
  network.layers.push_back(std::move(all));
  network.layers.push_back(linalg::convolution(128, 2 * points, 1, 1, false));
  return network;
}

// Fits of faces by a descent that was trained on other faces.
class Fits {
 public:
  Fits(const std::vector<TrainingFace>& faces, const Eigen::Matrix2Xd& mean,
       const VisibilityOptions& options, Progress& progress, const std::stop_token& stop)
      : faces_(faces), mean_(mean), options_(options) {
    int number = -1;  // number of this face, or of the face it was made from
    for (const TrainingFace& face : faces) {
      if (!face.mirrored && !face.turned) ++number;
      number_.push_back(std::max(0, number));
    }
    TARSIER_REQUIRE(number >= 9, "{} faces: ten at least are needed", number + 1);
    for (int half = 0; half < 2; ++half) {
      std::vector<TrainingFace> training_faces;
      for (std::size_t f = 0; f < faces.size(); ++f)
        if (number_[f] % 2 != half) training_faces.push_back(faces[f]);
      DescentOptions descent;
      descent.folds = 2;
      descent.seed = options.seed;
      descents_[static_cast<std::size_t>(half)] = train_descent(
          training_faces, scattered_starts(training_faces, mean, kStarts, options.seed), descent,
          progress, stop);
    }
  }

  // Numbers of the faces for training the network, or of the held-out ones.
  [[nodiscard]] std::vector<std::size_t> numbers(bool held_out) const {
    std::vector<std::size_t> out;
    for (std::size_t f = 0; f < faces_.size(); ++f)
      if ((number_[f] % kHoldOut == kHoldOut - 1) == held_out) out.push_back(f);
    return out;
  }

  // The network's input and target: n times 1 (hidden) or 0, n times the log of the error.
  void make(std::size_t f, Rng& rng, linalg::Example& example) const {
    thread_local DescentWorkspace descent_workspace;
    thread_local FaceInput input;
    const TrainingFace& face = faces_[f];
    const auto n = static_cast<std::size_t>(mean_.cols());
    std::vector<bool> hidden(n, false);
    cv::Mat gray = face.gray;
    if (rng.uniform() < options_.occluded) {
      gray = gray.clone();
      const int others = static_cast<int>(faces_.size()) - 1;
      const auto other = (f + static_cast<std::size_t>(rng.integer(1, others))) % faces_.size();
      hidden = draw_occlusion(gray, face.points, faces_[other].gray, rng);
    }
    const Start start = scattered_starts({face}, mean_, 1, rng()).front();
    const Eigen::Matrix2Xd fit = fit_descent(descents_[static_cast<std::size_t>(number_[f] % 2)],
                                             gray, start.points, descent_workspace);
    face_input(mean_, gray, fit, kVisibilitySide, kVisibilityScale, input);
    example.shape = {1, kVisibilitySide, kVisibilitySide};
    example.input = input.values;
    example.target.resize(2 * n);
    const double size = shape_size(fit);
    for (std::size_t p = 0; p < n; ++p) {
      const auto column = static_cast<Eigen::Index>(p);
      const double error = (fit.col(column) - face.points.col(column)).norm() / size;
      example.target[p] = hidden[p] ? 1.0F : 0.0F;
      example.target[n + p] = static_cast<float>(std::log(std::clamp(error, kMinError, 2.0)));
    }
  }

 private:
  const std::vector<TrainingFace>& faces_;
  const Eigen::Matrix2Xd& mean_;
  const VisibilityOptions& options_;
  std::vector<int> number_;
  std::array<Descent, 2> descents_;  // [k]: for faces whose number modulo 2 is k
};

// Negative log likelihood of the hidden flags, plus the errors' Huber loss; means over the points.
double visibility_loss(const linalg::Example& example, const std::vector<float>& output,
                       std::vector<float>& derivative) {
  const std::size_t n = output.size() / 2;
  derivative.resize(output.size());
  double loss = 0;
  for (std::size_t p = 0; p < n; ++p) {
    loss += linalg::logistic_loss(output[p], example.target[p], derivative[p]);
    const double of_error =
        linalg::huber(output[n + p] - example.target[n + p], kHuberThreshold, derivative[n + p]);
    loss += static_cast<double>(kErrorWeight) * of_error;
    derivative[n + p] *= kErrorWeight;
  }
  const float share = 1 / static_cast<float>(n);
  for (float& one : derivative) one *= share;
  return loss / static_cast<double>(n);
}

// The network's output for held-out faces, with the ground truth.
struct HeldOutOutputs {
  std::vector<std::vector<float>> output;
  std::vector<std::vector<float>> target;
};

// Maximum likelihood a, b of P(hidden) = 1 / (1 + exp(-(a h + b))) (Platt 1999), by Newton's
// method.
void calibrate_hidden(const HeldOutOutputs& held_out, VisibilityModel& model) {
  double& a = model.hidden_slope;
  double& b = model.hidden_offset;
  const auto n = static_cast<std::size_t>(model.points());
  for (int iteration = 0; iteration < 30; ++iteration) {
    double ga = 0;
    double gb = 0;
    double haa = 1e-9;
    double hab = 0;
    double hbb = 1e-9;
    for (std::size_t i = 0; i < held_out.output.size(); ++i) {
      for (std::size_t p = 0; p < n; ++p) {
        const auto h = static_cast<double>(held_out.output[i][p]);
        const double probability = logistic(a * h + b);
        const double w = probability * (1 - probability);
        const double e = probability - static_cast<double>(held_out.target[i][p]);
        ga += e * h;
        gb += e;
        haa += w * h * h;
        hab += w * h;
        hbb += w;
      }
    }
    const double det = haa * hbb - hab * hab;
    if (!(det > 0)) break;
    const double da = std::clamp((hbb * ga - hab * gb) / det, -1.0, 1.0);
    const double db = std::clamp((haa * gb - hab * ga) / det, -1.0, 1.0);
    a = std::clamp(a - da, 0.01, 20.0);
    b = std::clamp(b - db, -20.0, 20.0);
    if (std::abs(da) + std::abs(db) < 1e-6) break;
  }
}

void calibrate_sigma(const HeldOutOutputs& held_out, VisibilityModel& model) {
  const auto n = static_cast<std::size_t>(model.points());
  std::vector<float> residuals;
  for (std::size_t i = 0; i < held_out.output.size(); ++i)
    for (std::size_t p = 0; p < n; ++p)
      residuals.push_back(held_out.target[i][n + p] - held_out.output[i][n + p]);
  const auto quantile =
      residuals.begin() +
      static_cast<std::ptrdiff_t>(kSigmaQuantile * static_cast<double>(residuals.size() - 1));
  std::nth_element(residuals.begin(), quantile, residuals.end());
  model.sigma_offset =
      std::clamp(static_cast<double>(*quantile) + std::log(kErrorRatio), -10.0, 10.0);
}

}  // namespace

VisibilityModel train_visibility_model(const std::vector<TrainingFace>& faces,
                                       const VisibilityOptions& options, Progress& progress,
                                       const std::stop_token& stop) {
  options.check();
  VisibilityModel model;
  model.mean = mean_shape(faces);
  const Fits fits(faces, model.mean, options, progress, stop);
  model.network = untrained_visibility_network(model.points());
  Rng rng = Rng(options.seed).fork(3);
  linalg::initialize(model.network, rng);
  const std::vector<std::size_t> training_numbers = fits.numbers(false);
  linalg::TrainOptions training;
  training.steps = options.steps;
  training.seed = options.seed;
  const auto make = [&](std::int64_t, Rng& own, linalg::Example& example) {
    fits.make(training_numbers[static_cast<std::size_t>(
                  own.integer(0, static_cast<int>(training_numbers.size()) - 1))],
              own, example);
  };
  const auto loss = [](const linalg::Example& example, const std::vector<float>& output,
                       linalg::Shape, std::vector<float>& derivative) {
    return visibility_loss(example, output, derivative);
  };
  linalg::train(model.network, training, "visibility", make, loss, progress, stop);
  linalg::round_to_half(model.network);  // as it will be stored

  const std::vector<std::size_t> held_out_numbers = fits.numbers(true);
  HeldOutOutputs held_out;
  held_out.output.resize(kExamplesPerFace * held_out_numbers.size());
  held_out.target.resize(held_out.output.size());
  const Rng root = Rng(options.seed).fork(4);
  cv::parallel_for_(
      cv::Range(0, static_cast<int>(held_out.output.size())), [&](const cv::Range& range) {
        linalg::Workspace workspace;
        linalg::Example example;
        for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
          const auto k = static_cast<std::size_t>(i);
          Rng own = root.fork(k);
          fits.make(held_out_numbers[k / kExamplesPerFace], own, example);
          held_out.output[k] =
              linalg::run(model.network, example.input.data(), example.shape, workspace);
          held_out.target[k] = example.target;
        }
      });
  throw_if_stopped(stop);
  calibrate_hidden(held_out, model);
  calibrate_sigma(held_out, model);
  return model;
}

VisibilityModel train_visibility_model(const shape::LandmarkSet& set, bool mirror,
                                       const VisibilityOptions& options, Progress& progress,
                                       const std::stop_token& stop,
                                       std::vector<std::string>& skipped) {
  const std::vector<TrainingFace> faces =
      load_framed_faces(set, mirror, options.seed, progress, stop, skipped);
  return train_visibility_model(faces, options, progress, stop);
}

}  // namespace tarsier::face::regression
