// SPDX-License-Identifier: MIT
#include "tarsier/face/regression/patches.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/patch_image.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <exception>
#include <utility>
#include <vector>

namespace tarsier::face::regression {
namespace {

constexpr int kMaxPatchSide = 51;  // as in PatchOptions::fields()
// Last step, relative to the first one.
constexpr double kLastStep = 1e-3;

using PatchRows = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// A face from which windows are cut.
struct Source {
  detail::Reduced image;
  Eigen::Matrix2Xd points;  // px of image.gray
  double a = 1;             // from the patches' frame to px of image.gray: scale and rotation ..
  double b = 0;             // .. as a complex number a + i b
};

Source source_of(const TrainingFace& face, const Eigen::Matrix2Xd& reference, double reach) {
  const shape::Similarity2d image_from_frame = shape::fit_similarity(reference, face.points);
  const double scale = image_from_frame.scale();
  const Eigen::Vector2d low = face.points.rowwise().minCoeff().array() - reach * scale;
  const Eigen::Vector2d high = face.points.rowwise().maxCoeff().array() + reach * scale;
  const cv::Point first(static_cast<int>(std::floor(low.x())),
                        static_cast<int>(std::floor(low.y())));
  const cv::Point last(static_cast<int>(std::ceil(high.x())),
                       static_cast<int>(std::ceil(high.y())));
  Source source;
  detail::reduce(face.gray, cv::Rect(first, last + cv::Point(1, 1)), scale, source.image);
  const detail::Reduced& image = source.image;
  source.points = face.points;
  source.points.row(0).array() -= image.origin.x;
  source.points.row(1).array() -= image.origin.y;
  source.points /= image.step;
  source.a = image_from_frame.a / image.step;
  source.b = image_from_frame.b / image.step;
  return source;
}

// log(1 + gray) of the side x side window of the patches' frame that is centred exactly on the
// point.
void cut_window(const Source& source, Eigen::Index point, int side, float* out) {
  const cv::Mat& gray = source.image.gray;
  const double last_x = gray.cols - 1;
  const double last_y = gray.rows - 1;
  const int half = side / 2;
  for (int y = -half; y <= half; ++y) {
    for (int x = -half; x <= half; ++x) {
      const double u =
          std::clamp(source.points(0, point) + source.a * x - source.b * y, 0.0, last_x);
      const double v =
          std::clamp(source.points(1, point) + source.b * x + source.a * y, 0.0, last_y);
      const int u0 = static_cast<int>(u);
      const int v0 = static_cast<int>(v);
      const int u1 = std::min(u0 + 1, gray.cols - 1);
      const double fu = u - u0;
      const double fv = v - v0;
      const auto* upper = gray.ptr<std::uint8_t>(v0);
      const auto* lower = gray.ptr<std::uint8_t>(std::min(v0 + 1, gray.rows - 1));
      const double top = upper[u0] + fu * (upper[u1] - upper[u0]);
      const double bottom = lower[u0] + fu * (lower[u1] - lower[u0]);
      *out++ = std::log1p(static_cast<float>(top + fv * (bottom - top)));
    }
  }
}

// One row per position of a patch in the window: mean 0, norm 1 (0 if flat).
void normalised_patches(const float* window, int side, int patch, PatchRows& rows) {
  const int positions = side - patch + 1;
  Eigen::Index row = 0;
  for (int y = 0; y < positions; ++y) {
    for (int x = 0; x < positions; ++x, ++row) {
      for (int py = 0; py < patch; ++py) {
        rows.row(row).segment(py * patch, patch) =
            Eigen::Map<const Eigen::RowVectorXf>(window + (y + py) * side + x, patch);
      }
      rows.row(row).array() -= rows.row(row).mean();
      const float norm = rows.row(row).norm();
      rows.row(row) *= norm > 1e-3F ? 1 / norm : 0;
    }
  }
}

// The training data of one point.
struct PatchTrainer {
  const std::vector<Source>& sources;
  const PatchOptions& options;
  Eigen::VectorXf desired;
  const std::stop_token& stop;

  [[nodiscard]] int window() const { return options.patch + options.search - 1; }
  [[nodiscard]] Eigen::Index taps() const {
    return static_cast<Eigen::Index>(options.patch) * options.patch;
  }
  [[nodiscard]] Eigen::Index positions() const {
    return static_cast<Eigen::Index>(options.search) * options.search;
  }

  [[nodiscard]] Eigen::VectorXd stochastic(Eigen::Index point) const;
  [[nodiscard]] Eigen::VectorXd ridge(Eigen::Index point) const;
  [[nodiscard]] Eigen::VectorXd average(Eigen::Index point) const;
};

Eigen::VectorXd PatchTrainer::stochastic(Eigen::Index point) const {
  Rng rng = Rng(options.seed).fork(static_cast<std::uint64_t>(point));
  std::vector<float> window_values(static_cast<std::size_t>(window()) *
                                   static_cast<std::size_t>(window()));
  PatchRows rows(positions(), taps());
  Eigen::VectorXf patch = Eigen::VectorXf::Zero(taps());
  // Rows have norm 1, so no eigenvalue of their squares exceeds the number of rows. Steps up to 1 /
  // positions therefore cannot diverge.
  double step = options.first_step / static_cast<double>(positions());
  const double weight =
      options.lambda * static_cast<double>(positions()) / static_cast<double>(taps());
  const double fall = std::pow(kLastStep, 1.0 / options.samples);
  for (int k = 0; k < options.samples && !stop.stop_requested(); ++k, step *= fall) {
    const auto pick =
        static_cast<std::size_t>(rng.integer(0, static_cast<int>(sources.size()) - 1));
    cut_window(sources[pick], point, window(), window_values.data());
    normalised_patches(window_values.data(), window(), options.patch, rows);
    const Eigen::VectorXf error = rows * patch - desired;
    patch *= static_cast<float>(1 - step * weight);
    patch.noalias() -= static_cast<float>(step) * (rows.transpose() * error);
  }
  return patch.cast<double>();
}

Eigen::VectorXd PatchTrainer::ridge(Eigen::Index point) const {
  std::vector<float> window_values(static_cast<std::size_t>(window()) *
                                   static_cast<std::size_t>(window()));
  PatchRows rows(positions(), taps());
  Eigen::MatrixXd normal = Eigen::MatrixXd::Zero(taps(), taps());
  Eigen::VectorXd right = Eigen::VectorXd::Zero(taps());
  Eigen::MatrixXf part(taps(), taps());
  for (const Source& source : sources) {
    if (stop.stop_requested()) return right;
    cut_window(source, point, window(), window_values.data());
    normalised_patches(window_values.data(), window(), options.patch, rows);
    // Single precision is enough for one face, but not for the sum of thousands.
    part.setZero();
    part.selfadjointView<Eigen::Lower>().rankUpdate(rows.transpose());
    normal.triangularView<Eigen::Lower>() += part.cast<double>();
    right += (rows.transpose() * desired).cast<double>();
  }
  normal.diagonal().array() +=
      std::max(options.lambda, 1e-12) * normal.trace() / static_cast<double>(taps()) + 1e-12;
  return linalg::solve_symmetric(normal, right);
}

Eigen::VectorXd PatchTrainer::average(Eigen::Index point) const {
  std::vector<float> window_values(static_cast<std::size_t>(taps()));
  PatchRows row(1, taps());
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(taps());
  for (const Source& source : sources) {
    if (stop.stop_requested()) break;
    cut_window(source, point, options.patch, window_values.data());
    normalised_patches(window_values.data(), options.patch, options.patch, row);
    sum += row.row(0).transpose().cast<double>();
  }
  return sum;
}

// The desired response: a Gaussian around the middle.
Eigen::VectorXf desired_response(const PatchOptions& options) {
  const int half = options.search / 2;
  Eigen::VectorXf desired(static_cast<Eigen::Index>(options.search) * options.search);
  Eigen::Index index = 0;
  for (int y = -half; y <= half; ++y)
    for (int x = -half; x <= half; ++x)
      desired[index++] = static_cast<float>(std::exp(-(x * x + y * y) / (2 * options.variance)));
  return desired;
}

// Mean 0, norm 1. A patch without training signal (flat images) stays 0 and gives no response.
cv::Mat normalised_patch(Eigen::VectorXd patch, int side) {
  patch.array() -= patch.mean();
  const double norm = patch.norm();
  if (norm > 1e-12) patch /= norm;
  cv::Mat out(side, side, CV_32FC1);
  for (int y = 0, i = 0; y < side; ++y)
    for (int x = 0; x < side; ++x, ++i) out.at<float>(y, x) = static_cast<float>(patch[i]);
  return out;
}

// Runs `work(index)` for 0..count-1 on all threads. After a stop request or an exception, skips the
// rest and then throws.
template <typename Work>
void in_parallel(int count, const std::stop_token& stop, const Work& work) {
  std::atomic<bool> failed = false;
  std::exception_ptr error;
  cv::parallel_for_(
      cv::Range(0, count),
      [&](const cv::Range& range) {
        for (int i = range.start; i < range.end; ++i) {
          if (failed || stop.stop_requested()) return;
          try {
            work(i);
          } catch (...) {
            if (!failed.exchange(true)) error = std::current_exception();
          }
        }
      },
      count);
  if (error) std::rethrow_exception(error);
  throw_if_stopped(stop);
}

}  // namespace

void PatchModels::check() const {
  TARSIER_REQUIRE(!patches.empty() && reference.cols() == points(),
                  "{} patches, {} points in the reference", patches.size(), reference.cols());
  TARSIER_REQUIRE(reference.allFinite() && reference.cwiseAbs().maxCoeff() <= 1000,
                  "the reference is not finite and within 1000 px");
  const double width = detail::width_of(reference);
  TARSIER_REQUIRE(width >= 29 && width <= 401, "the reference is {} px wide, not 30..400", width);
  const int size = side();
  TARSIER_REQUIRE(size >= 3 && size <= kMaxPatchSide && size % 2 == 1,
                  "patches are {} px wide, not odd and in 3..{}", size, kMaxPatchSide);
  for (const cv::Mat& patch : patches) {
    TARSIER_REQUIRE(patch.type() == CV_32FC1 && patch.cols == size && patch.rows == size,
                    "a patch is {}x{}, type {}, not {}x{} floats", patch.cols, patch.rows,
                    patch.type(), size, size);
    TARSIER_REQUIRE(patch.isContinuous() && cv::checkRange(patch), "a patch is not finite");
    const double norm = cv::norm(patch);
    TARSIER_REQUIRE(
        (norm < 1e-6 || std::abs(norm - 1) < 1e-3) && std::abs(cv::sum(patch)[0]) < 1e-3 * size,
        "a patch is not of mean 0 and norm 1");
  }
}

PatchModels train_patches(const std::vector<TrainingFace>& faces, const shape::ShapeModel& shape,
                          const PatchOptions& options, Progress& progress,
                          const std::stop_token& stop) {
  options.check();
  shape.check();
  TARSIER_REQUIRE(!faces.empty(), "no faces");
  for (const TrainingFace& face : faces) {
    require_gray(face.gray);
    TARSIER_REQUIRE(face.points.cols() == shape.points() && face.points.allFinite() &&
                        face.points.cwiseAbs().maxCoeff() < 1e6,
                    "{}: {} points where the shape has {}, or one missing or far outside",
                    face.name, face.points.cols(), shape.points());
  }
  const double width = detail::width_of(shape.mean);
  TARSIER_REQUIRE(width > 1e-9, "the mean shape has no width");

  PatchModels model;
  model.method = options.method;
  model.reference = shape.mean * (options.face_width / width);
  model.patches.resize(static_cast<std::size_t>(shape.points()));

  std::vector<Source> sources(faces.size());
  in_parallel(static_cast<int>(faces.size()), stop, [&](int i) {
    const auto k = static_cast<std::size_t>(i);
    sources[k] = source_of(faces[k], model.reference, options.patch + options.search);
  });

  const PatchTrainer trainer{sources, options, desired_response(options), stop};
  progress.begin("patches", shape.points(), "points");
  in_parallel(shape.points(), stop, [&](int i) {
    Eigen::VectorXd patch;
    switch (options.method) {
      case PatchMethod::kStochastic:
        patch = trainer.stochastic(i);
        break;
      case PatchMethod::kRidge:
        patch = trainer.ridge(i);
        break;
      case PatchMethod::kAverage:
        patch = trainer.average(i);
        break;
    }
    model.patches[static_cast<std::size_t>(i)] = normalised_patch(std::move(patch), options.patch);
    progress.advance();
  });
  progress.end();
  return model;
}

}  // namespace tarsier::face::regression
