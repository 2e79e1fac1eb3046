// SPDX-License-Identifier: MIT
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/regression/patch_image.h"
#include "tarsier/face/regression/patches.h"
#include "tarsier/linalg/decompositions.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

namespace tarsier::face::regression {
namespace detail {

namespace {

// Below this variance of log(1 + gray) a window is flat: only rounding errors remain.
constexpr double kFlat = 1e-6;

// Computes kOverread results at once, so that they stay in registers over all taps.
void correlate_block(const float* in, std::size_t stride, const float* patch, int side,
                     float* out) {
  float sums[kOverread] = {};
  for (int y = 0; y < side; ++y) {
    const float* row = in + static_cast<std::size_t>(y) * stride;
    for (int x = 0; x < side; ++x) {
      const float tap = *patch++;
      for (int k = 0; k < kOverread; ++k) sums[k] += tap * row[x + k];
    }
  }
  for (int k = 0; k < kOverread; ++k) out[k] = sums[k];
}

}  // namespace

void reduce(const cv::Mat& gray, const cv::Rect& around, double scale, Reduced& out) {
  const cv::Rect whole(0, 0, gray.cols, gray.rows);
  cv::Rect part = around & whole;
  if (part.width < 2 || part.height < 2) part = whole;
  const int max_step = std::max(1, std::min(part.width, part.height) / 2);
  const int step =
      static_cast<int>(std::clamp(std::round(scale), 1.0, static_cast<double>(max_step)));
  part.width -= part.width % step;
  part.height -= part.height % step;
  out.step = step;
  out.origin = {part.x + (step - 1) / 2.0, part.y + (step - 1) / 2.0};
  if (step == 1) {
    out.gray = gray(part);
  } else {
    cv::resize(gray(part), out.gray, cv::Size(part.width / step, part.height / step), 0, 0,
               cv::INTER_AREA);
  }
}

const float* log_table() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = std::log1p(static_cast<float>(i));
    return values;
  }();
  return table.data();
}

void inverse_norms(const cv::Mat& logs, int spare, int side, cv::Mat& scratch, cv::Mat& out) {
  const int width = logs.cols - spare;
  const int rows = logs.rows - side + 1;
  const int cols = width - side + 1;
  out.create(rows, cols, CV_32FC1);
  // Running sums of each column over `side` rows, and of the squares.
  scratch.create(2, width, CV_64FC1);
  scratch.setTo(0);
  auto* sums = scratch.ptr<double>(0);
  auto* squares = scratch.ptr<double>(1);
  const double taps = static_cast<double>(side) * side;
  for (int y = 0; y < logs.rows; ++y) {
    const auto* entering = logs.ptr<float>(y);
    const float* leaving = y >= side ? logs.ptr<float>(y - side) : nullptr;
    for (int x = 0; x < width; ++x) {
      const auto value = static_cast<double>(entering[x]);
      const double old = leaving != nullptr ? static_cast<double>(leaving[x]) : 0;
      sums[x] += value - old;
      squares[x] += value * value - old * old;
    }
    if (y < side - 1) continue;
    auto* row = out.ptr<float>(y - side + 1);
    double sum = 0;
    double square = 0;
    for (int x = 0; x < width; ++x) {
      sum += sums[x] - (x >= side ? sums[x - side] : 0);
      square += squares[x] - (x >= side ? squares[x - side] : 0);
      if (x < side - 1) continue;
      const double spread = square - sum * sum / taps;
      row[x - side + 1] = spread > kFlat * taps ? static_cast<float>(1 / std::sqrt(spread)) : 0.0F;
    }
  }
}

void correlate(const float* in, std::size_t in_stride, const float* patch, int side, int rows,
               int cols, float* out, std::size_t out_stride) {
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols; x += kOverread)
      correlate_block(in + x, in_stride, patch, side, out + x);
    in += in_stride;
    out += out_stride;
  }
}

double width_of(const Eigen::Matrix2Xd& points) {
  return points.row(0).maxCoeff() - points.row(0).minCoeff();
}

double parabola_peak(double left, double center, double right) {
  const double curve = left - 2 * center + right;
  return curve < -1e-12 ? std::clamp(0.5 * (left - right) / curve, -0.5, 0.5) : 0;
}

}  // namespace detail

namespace {

using detail::kOverread;

// Shape parameters and pose in the patches' frame: x = T(mean + modes b), T = (a, b, tx, ty).
struct Pose {
  shape::Similarity2d frame_from_model;
  Eigen::VectorXd b;
};

// Regularised Gauss-Newton steps towards weighted targets.
class ShapeSolver {
 public:
  ShapeSolver(const shape::ShapeModel& shape, double noise, double sigmas)
      : shape_(shape),
        sigmas_(sigmas),
        jacobian_(2 * shape.points(), 4 + shape.mode_count()),
        weighted_(jacobian_.rows(), jacobian_.cols()),
        prior_(4 + shape.mode_count()) {
    prior_.setZero();
    for (int k = 0; k < shape.mode_count(); ++k)
      prior_[4 + k] = noise / std::max(shape.deviation[k] * shape.deviation[k], 1e-12);
  }

  // Least squares over the points: weight |target - x|^2, and the prior on b.
  void step(const Eigen::Matrix2Xd& targets, const Eigen::VectorXd& weights, Pose& pose) {
    const Eigen::Index n = shape_.points();
    const Eigen::Index modes = shape_.mode_count();
    shape::Similarity2d& t = pose.frame_from_model;
    local_ = shape_.mean;
    local_.reshaped() += shape_.modes * pose.b;
    residual_.resize(2 * n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double x = local_(0, i);
      const double y = local_(1, i);
      jacobian_.block<1, 4>(2 * i, 0) << x, -y, 1, 0;
      jacobian_.block<1, 4>(2 * i + 1, 0) << y, x, 0, 1;
      jacobian_.block(2 * i, 4, 1, modes) =
          t.a * shape_.modes.row(2 * i) - t.b * shape_.modes.row(2 * i + 1);
      jacobian_.block(2 * i + 1, 4, 1, modes) =
          t.b * shape_.modes.row(2 * i) + t.a * shape_.modes.row(2 * i + 1);
      residual_[2 * i] = targets(0, i) - (t.a * x - t.b * y + t.tx);
      residual_[2 * i + 1] = targets(1, i) - (t.b * x + t.a * y + t.ty);
      weighted_.row(2 * i) = weights[i] * jacobian_.row(2 * i);
      weighted_.row(2 * i + 1) = weights[i] * jacobian_.row(2 * i + 1);
    }
    normal_.noalias() = weighted_.transpose() * jacobian_;
    normal_.diagonal() += prior_;
    normal_.diagonal().array() += 1e-9 * (1 + normal_.diagonal().maxCoeff());
    right_.noalias() = weighted_.transpose() * residual_;
    right_.tail(modes) -= prior_.tail(modes).cwiseProduct(pose.b);
    const Eigen::VectorXd change = linalg::solve_symmetric(normal_, right_);
    if (!change.allFinite()) return;
    t.a += change[0];
    t.b += change[1];
    t.tx += change[2];
    t.ty += change[3];
    pose.b += change.tail(modes);
    shape::clamp(shape_, pose.b, sigmas_);
  }

  [[nodiscard]] Eigen::Matrix2Xd points(const Pose& pose) {
    local_ = shape_.mean;
    local_.reshaped() += shape_.modes * pose.b;
    return pose.frame_from_model(local_);
  }

 private:
  const shape::ShapeModel& shape_;
  double sigmas_;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> jacobian_;
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> weighted_;
  Eigen::VectorXd prior_;
  Eigen::Matrix2Xd local_;
  Eigen::MatrixXd normal_;
  Eigen::VectorXd residual_;
  Eigen::VectorXd right_;
};

// The image in the patches' frame.
struct Frame {
  cv::Size size;
  Eigen::Vector2d centre;
};

// The responses of all points: `side` rows per point, one point below the other.
struct Responses {
  int side = 0;
  cv::Mat values;           // CV_32FC1, n * side x side + kOverread
  Eigen::Matrix2Xd corner;  // position of each point's first response in the frame
  [[nodiscard]] const float* row(Eigen::Index point, int y) const {
    return values.ptr<float>(static_cast<int>(point) * side + y);
  }
};

void warp(const detail::Reduced& image, const shape::Similarity2d& image_from_frame, cv::Size size,
          PatchWorkspace& workspace) {
  const double step = image.step;
  const cv::Matx23d map(image_from_frame.a / step, -image_from_frame.b / step,
                        (image_from_frame.tx - image.origin.x) / step, image_from_frame.b / step,
                        image_from_frame.a / step, (image_from_frame.ty - image.origin.y) / step);
  cv::warpAffine(image.gray, workspace.frame, map, size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP,
                 cv::BORDER_REPLICATE);
  workspace.logs.create(size.height, size.width + kOverread, CV_32FC1);
  const float* table = detail::log_table();
  for (int y = 0; y < size.height; ++y) {
    const auto* from = workspace.frame.ptr<std::uint8_t>(y);
    auto* to = workspace.logs.ptr<float>(y);
    for (int x = 0; x < size.width; ++x) to[x] = table[from[x]];
    std::fill(to + size.width, to + size.width + kOverread, 0.0F);
  }
}

// Computes responses in windows around the (rounded) points.
void respond(const PatchModels& model, const Eigen::Matrix2Xd& points, PatchWorkspace& workspace,
             Responses& out) {
  const int side = model.side();
  const int half = side / 2 + out.side / 2;
  const cv::Mat& logs = workspace.logs;
  const int width = logs.cols - kOverread;
  cv::Mat& inverse = workspace.buffers[1];
  detail::inverse_norms(logs, kOverread, side, workspace.buffers[0], inverse);
  out.values.create(model.points() * out.side, out.side + kOverread, CV_32FC1);
  out.corner.resize(2, points.cols());
  for (int i = 0; i < model.points(); ++i) {
    const int x = static_cast<int>(std::lround(
                      std::clamp(points(0, i), static_cast<double>(half), width - 1.0 - half))) -
                  half;
    const int y = static_cast<int>(std::lround(std::clamp(points(1, i), static_cast<double>(half),
                                                          logs.rows - 1.0 - half))) -
                  half;
    out.corner(0, i) = x + side / 2;
    out.corner(1, i) = y + side / 2;
    auto* values = out.values.ptr<float>(i * out.side);
    detail::correlate(logs.ptr<float>(y) + x, logs.step1(),
                      model.patches[static_cast<std::size_t>(i)].ptr<float>(), side, out.side,
                      out.side, values, out.values.step1());
    for (int v = 0; v < out.side; ++v) {
      auto* row = out.values.ptr<float>(i * out.side + v);
      const float* scale = inverse.ptr<float>(y + v) + x;
      for (int u = 0; u < out.side; ++u) row[u] = std::clamp(row[u] * scale[u], -1.0F, 1.0F);
    }
  }
}

// The position of a point's highest response, px of the frame; returns the response.
double find_peak(const Responses& responses, Eigen::Index point, Eigen::Vector2d& at) {
  const int side = responses.side;
  float best = -2;
  int bx = 0;
  int by = 0;
  for (int y = 0; y < side; ++y) {
    const float* row = responses.row(point, y);
    for (int x = 0; x < side; ++x) {
      if (row[x] <= best) continue;
      best = row[x];
      bx = x;
      by = y;
    }
  }
  const auto value = [&](int x, int y) { return static_cast<double>(responses.row(point, y)[x]); };
  at = responses.corner.col(point) + Eigen::Vector2d(bx, by);
  const auto peak = static_cast<double>(best);
  if (bx > 0 && bx < side - 1)
    at.x() += detail::parabola_peak(value(bx - 1, by), peak, value(bx + 1, by));
  if (by > 0 && by < side - 1)
    at.y() += detail::parabola_peak(value(bx, by - 1), peak, value(bx, by + 1));
  return peak;
}

// The response at a position in the frame, interpolated.
double response_at(const Responses& responses, Eigen::Index point, const Eigen::Vector2d& at) {
  const double last = responses.side - 1;
  const double x = std::clamp(at.x() - responses.corner(0, point), 0.0, last);
  const double y = std::clamp(at.y() - responses.corner(1, point), 0.0, last);
  const int x0 = std::min(static_cast<int>(x), responses.side - 2);
  const int y0 = std::min(static_cast<int>(y), responses.side - 2);
  const double fx = x - x0;
  const double fy = y - y0;
  const float* upper = responses.row(point, y0) + x0;
  const float* lower = responses.row(point, y0 + 1) + x0;
  const auto mix = [](float a, float b, double f) {
    return static_cast<double>(a) + f * (static_cast<double>(b) - static_cast<double>(a));
  };
  return (1 - fy) * mix(upper[0], upper[1], fx) + fy * mix(lower[0], lower[1], fx);
}

// Converts responses to probabilities (up to a factor), separately for each point.
void to_probabilities(const Responses& responses, int points, double sharpness, Responses& out) {
  out.side = responses.side;
  out.corner = responses.corner;
  out.values.create(responses.values.size(), CV_32FC1);
  for (int i = 0; i < points * out.side; ++i) {
    const auto* from = responses.values.ptr<float>(i);
    auto* to = out.values.ptr<float>(i);
    for (int x = 0; x < out.side; ++x) to[x] = std::exp(static_cast<float>(sharpness) * from[x]);
  }
}

// Mean of the window, weighted by the probabilities and a Gaussian with that variance around `at`.
Eigen::Vector2d shifted_mean(const Responses& probabilities, Eigen::Index point,
                             const Eigen::Vector2d& at, double variance,
                             std::vector<float>& kernel) {
  const int side = probabilities.side;
  const Eigen::Vector2d local = at - probabilities.corner.col(point);
  // Outside the window all weights could vanish, so the nearest position in the window is used.
  const Eigen::Vector2d around = local.cwiseMax(0.0).cwiseMin(side - 1.0);
  kernel.resize(static_cast<std::size_t>(2 * side));
  for (int k = 0; k < side; ++k) {
    const double dx = k - around.x();
    const double dy = k - around.y();
    kernel[static_cast<std::size_t>(k)] = static_cast<float>(std::exp(-dx * dx / (2 * variance)));
    kernel[static_cast<std::size_t>(side + k)] =
        static_cast<float>(std::exp(-dy * dy / (2 * variance)));
  }
  double total = 0;
  double sum_x = 0;
  double sum_y = 0;
  for (int y = 0; y < side; ++y) {
    const float* row = probabilities.row(point, y);
    float weight = 0;
    float moment = 0;
    for (int x = 0; x < side; ++x) {
      const float w = row[x] * kernel[static_cast<std::size_t>(x)];
      weight += w;
      moment += w * static_cast<float>(x);
    }
    const auto down = static_cast<double>(kernel[static_cast<std::size_t>(side + y)]);
    total += down * static_cast<double>(weight);
    sum_x += down * static_cast<double>(moment);
    sum_y += down * static_cast<double>(weight) * y;
  }
  if (!(total > 0)) return at;
  return probabilities.corner.col(point) + Eigen::Vector2d(sum_x / total, sum_y / total);
}

// Distances below this share of the window do not count as disagreement: the points may still be
// converging, such as those of an opening mouth.
constexpr double kMinDisagreement = 0.1;

// Geman and McClure's weight, with a scale from the median distance, at least `min_scale`.
void reweight(const Eigen::Matrix2Xd& targets, const Eigen::Matrix2Xd& points, double min_scale,
              std::vector<double>& scratch, Eigen::VectorXd& weights) {
  const Eigen::VectorXd squares = (targets - points).colwise().squaredNorm();
  scratch.assign(squares.begin(), squares.end());
  const auto median = scratch.begin() + static_cast<std::ptrdiff_t>(scratch.size() / 2);
  std::nth_element(scratch.begin(), median, scratch.end());
  const double scale = 4 * std::max(*median, min_scale * min_scale);
  for (Eigen::Index i = 0; i < weights.size(); ++i) {
    const double share = scale / (scale + squares[i]);
    weights[i] *= share * share;
  }
}

}  // namespace

void PatchFitOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!search.empty() && search.size() <= 20, "{} levels", search.size());
}

cv::Mat patch_response(const cv::Mat& patch, const cv::Mat& window) {
  TARSIER_REQUIRE(patch.dims == 2 && patch.type() == CV_32FC1 && patch.cols == patch.rows &&
                      patch.cols >= 3 && patch.isContinuous(),
                  "{}x{}, type {} is not a patch", patch.cols, patch.rows, patch.type());
  TARSIER_REQUIRE(window.dims == 2 && (window.type() == CV_8UC1 || window.type() == CV_32FC1) &&
                      window.cols >= patch.cols && window.rows >= patch.rows,
                  "a window of {}x{}, type {} for a patch of {}", window.cols, window.rows,
                  window.type(), patch.cols);
  cv::Mat logs(window.rows, window.cols + kOverread, CV_32FC1, cv::Scalar(0));
  for (int y = 0; y < window.rows; ++y) {
    auto* to = logs.ptr<float>(y);
    for (int x = 0; x < window.cols; ++x) {
      to[x] = window.type() == CV_8UC1 ? detail::log_table()[window.at<std::uint8_t>(y, x)]
                                       : std::log1p(std::max(0.0F, window.at<float>(y, x)));
    }
  }
  cv::Mat scratch;
  cv::Mat inverse;
  detail::inverse_norms(logs, kOverread, patch.cols, scratch, inverse);
  cv::Mat wide(inverse.rows, inverse.cols + kOverread, CV_32FC1);
  detail::correlate(logs.ptr<float>(), logs.step1(), patch.ptr<float>(), patch.cols, inverse.rows,
                    inverse.cols, wide.ptr<float>(), wide.step1());
  cv::Mat out = wide.colRange(0, inverse.cols).mul(inverse);
  return cv::max(cv::min(out, 1.0), -1.0);
}

PatchFit fit_patches(const PatchModels& model, const shape::ShapeModel& shape,
                     const PatchFitOptions& options, const cv::Mat& gray,
                     const Eigen::Matrix2Xd& start, PatchWorkspace& workspace, DebugSink* debug) {
  options.check();
  require_gray(gray);
  const int n = model.points();
  TARSIER_REQUIRE(n > 0 && shape.points() == n && start.cols() == n,
                  "{} patches, a shape of {} points, a start of {}", n, shape.points(),
                  start.cols());
  TARSIER_REQUIRE(start.allFinite() && start.cwiseAbs().maxCoeff() < 1e6,
                  "the start is not finite and near the image");

  const int widest = *std::max_element(options.search.begin(), options.search.end());
  const double scale = detail::width_of(model.reference) / detail::width_of(shape.mean);
  const double reach = widest / 2 + model.side() / 2 + 2 + 0.1 * detail::width_of(model.reference);
  const Eigen::Vector2d low = model.reference.rowwise().minCoeff().array() - reach;
  const Eigen::Vector2d high = model.reference.rowwise().maxCoeff().array() + reach;
  const cv::Size size(static_cast<int>(std::ceil(high.x() - low.x())) + 1,
                      static_cast<int>(std::ceil(high.y() - low.y())) + 1);
  const shape::Similarity2d frame_from_mean{scale, 0, -low.x(), -low.y()};

  shape::ShapeFit begin = shape::fit_shape(shape, start, {}, options.sigmas);
  shape::Similarity2d image_from_model = begin.image_from_model;
  TARSIER_REQUIRE(image_from_model.scale() > 1e-6, "the start has no extent");
  Pose pose{frame_from_mean, std::move(begin.b)};
  shape::Similarity2d image_from_frame = image_from_model * frame_from_mean.inverse();

  detail::Reduced image;
  if (workspace.buffers.size() < 4) workspace.buffers.resize(4);
  image.gray = workspace.buffers[3];
  {
    // Margin for changes of scale, rotation and position over the levels.
    Eigen::Matrix2Xd corners(2, 4);
    const double w = size.width;
    const double h = size.height;
    corners << -0.2 * w, 1.2 * w, -0.2 * w, 1.2 * w, -0.2 * h, -0.2 * h, 1.2 * h, 1.2 * h;
    const Eigen::Matrix2Xd seen = image_from_frame(corners);
    const auto whole = [](double value) {
      return static_cast<int>(std::round(std::clamp(value, -1e6, 2e6)));
    };
    const cv::Point first(whole(seen.row(0).minCoeff()), whole(seen.row(1).minCoeff()));
    const cv::Point last(whole(seen.row(0).maxCoeff()), whole(seen.row(1).maxCoeff()));
    detail::reduce(gray, cv::Rect(first, last), image_from_frame.scale(), image);
    if (image.step > 1) workspace.buffers[3] = image.gray;
  }

  ShapeSolver solver(shape, options.noise, options.sigmas);
  Responses responses;
  Responses probabilities;
  responses.values = workspace.buffers[2];
  if (workspace.buffers.size() < 5) workspace.buffers.resize(5);
  probabilities.values = workspace.buffers[4];
  Eigen::Matrix2Xd targets(2, n);
  Eigen::VectorXd weights(n);
  Eigen::VectorXd heights(n);
  std::vector<double> scratch;
  std::vector<float> kernel;
  Eigen::Matrix2Xd points = solver.points(pose);
  const double still = options.tolerance * detail::width_of(model.reference);

  for (std::size_t level = 0; level < options.search.size(); ++level) {
    if (level > 0) {
      image_from_frame = image_from_model * frame_from_mean.inverse();
      pose.frame_from_model = frame_from_mean;
      points = solver.points(pose);
    }
    warp(image, image_from_frame, size, workspace);
    if (debug != nullptr) debug->image("patches/frame", workspace.frame);
    responses.side = options.search[level];
    respond(model, points, workspace, responses);
    const bool shifting = options.target == PatchTarget::kMeanShift;
    if (shifting) {
      to_probabilities(responses, n, options.sharpness, probabilities);
    } else {
      for (Eigen::Index i = 0; i < n; ++i) {
        Eigen::Vector2d at;
        heights[i] = std::max(0.01, find_peak(responses, i, at));
        targets.col(i) = at;
      }
    }
    const double deviation = options.spread * responses.side;
    for (int iteration = 0; iteration < options.iterations; ++iteration) {
      if (shifting) {
        for (Eigen::Index i = 0; i < n; ++i) {
          targets.col(i) =
              shifted_mean(probabilities, i, points.col(i), deviation * deviation, kernel);
          heights[i] = std::max(0.01, response_at(responses, i, targets.col(i)));
        }
      }
      weights = heights;
      // In the first step there is no fitted shape that points could disagree with.
      if (options.robust && (shifting || iteration > 0))
        reweight(targets, points, kMinDisagreement * responses.side, scratch, weights);
      solver.step(targets, weights / std::max(weights.mean(), 1e-9), pose);
      const Eigen::Matrix2Xd moved = solver.points(pose);
      const double max_move = (moved - points).colwise().norm().maxCoeff();
      points = moved;
      if (max_move <= still) break;
    }
    image_from_model = image_from_frame * pose.frame_from_model;
    if (!(image_from_model.scale() > 1e-6)) break;  // degenerate shape
  }
  workspace.buffers[2] = responses.values;
  workspace.buffers[4] = probabilities.values;

  PatchFit fit;
  fit.points = image_from_frame(points);
  fit.peaks.resize(n);
  for (Eigen::Index i = 0; i < n; ++i) fit.peaks[i] = response_at(responses, i, points.col(i));
  fit.score = fit.peaks.mean();
  return fit;
}

}  // namespace tarsier::face::regression
