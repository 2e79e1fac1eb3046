// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Patch models: for each point, a small linear filter whose response is highest at the point
// (constrained local models: Cristinacce and Cootes, BMVC 2006; correlation filters: Bolme et al.,
// CVPR 2010).
namespace tarsier::face::regression {

enum class PatchMethod {
  kStochastic,  // gradient descent on the squared difference to the desired response
  // The same least squares in closed form: one ridge regression per point.
  kRidge,
  kAverage,  // the mean patch ("generative"), for comparison
};

// All methods work on log(1 + gray), and on windows of the patch's size with mean 0 and norm 1,
// like the responses of the fit. Stochastic and ridge minimise, over all faces and positions in the
// search window,
//   sum (patch . window - desired)^2 + lambda energy |patch|^2,
// where `energy` is the mean square of a pixel, summed over all windows.
struct PatchOptions {
  PatchMethod method = PatchMethod::kRidge;
  int patch = 11;          // px, side of a patch, odd
  int search = 21;         // px, side of the response window in training, odd
  double face_width = 70;  // px, width of the mean shape in the patches' frame
  double variance = 0.7;   // px^2, of the desired Gaussian response
  double lambda = 0.1;     // weight of the regularisation
  // Of the descent, relative to the largest step that cannot diverge; it falls to a thousandth of
  // this.
  double first_step = 0.5;
  int samples = 1000;  // steps of the descent per point
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"patch", patch, odd_range(3, 51), "--patch", "side of a patch, px"},
            {"search", search, odd_range(3, 51)},
            {"face_width", face_width, range(30, 400)},
            {"variance", variance, above(0, 1000)},
            {"lambda", lambda, range(0, 10)},
            {"first_step", first_step, above(0, 1)},
            {"samples", samples, range(1, 10'000'000)}};
  }
  void check() const { check_fields(*this); }
};

struct PatchModels {
  PatchMethod method = PatchMethod::kRidge;
  // 2 x n, px: the mean shape, face_width wide, centred at 0.
  Eigen::Matrix2Xd reference;
  std::vector<cv::Mat> patches;  // n of CV_32FC1, patch x patch, mean 0, norm 1
  [[nodiscard]] int points() const { return static_cast<int>(patches.size()); }
  [[nodiscard]] int side() const { return patches.empty() ? 0 : patches[0].cols; }
  void check() const;
};

// Training windows are cut from each face in the frame of `reference` (by the similarity of the
// face's points to it, sub-pixel, pixel centres at integers), so that the point is exactly in the
// middle. The result does not depend on the number of threads. Throws Interrupted,
// std::invalid_argument.
[[nodiscard]] PatchModels train_patches(const std::vector<TrainingFace>& faces,
                                        const shape::ShapeModel& shape, const PatchOptions& options,
                                        Progress& progress, const std::stop_token& stop);

// Normalised correlation of a patch with log(1 + gray) at each position in a window (CV_8UC1 or
// CV_32F grey values). CV_32FC1 of size window - patch + 1, in -1..1.
[[nodiscard]] cv::Mat patch_response(const cv::Mat& patch, const cv::Mat& window);

// Target of a point within its response window.
enum class PatchTarget {
  kPeak,  // the highest response, sub-pixel
  // The mean of the window, weighted by the response and a kernel around the current point (Saragih
  // et al., "Deformable model fitting by regularized landmark mean-shift", IJCV 2011).
  kMeanShift,
};

struct PatchFitOptions {
  PatchTarget target = PatchTarget::kMeanShift;
  // px, side of the response window at each level, odd.
  std::vector<int> search = {21, 11, 7};
  int iterations = 10;  // max number at each level
  // A level stops when no point moves more than this share of the face width.
  double tolerance = 1e-3;
  bool robust = true;     // weight points by their agreement with the shape
  double sigmas = 3;      // limit of the shape parameters
  double sharpness = 40;  // kMeanShift: a position's weight is exp(sharpness * response)
  double spread = 0.3;    // kMeanShift: deviation of the kernel, share of the window
  double noise = 10;      // px^2, variance of a point, relative to the shape's variance

  [[nodiscard]] OptionFields fields() {
    return {{"search", search, odd_range(3, 101)},   {"iterations", iterations, range(1, 1000)},
            {"tolerance", tolerance, range(0, 1)},   {"sigmas", sigmas, above(0, 100)},
            {"sharpness", sharpness, above(0, 100)}, {"spread", spread, range(0.05, 2)},
            {"noise", noise, range(0, 1000)}};
  }
  void check() const;
};

struct PatchFit {
  Eigen::Matrix2Xd points;  // px of the image
  Eigen::VectorXd peaks;    // n, peak response of each point, -1..1
  double score = 0;         // mean of the peaks
};

// Buffers that are reused between calls. One per thread.
struct PatchWorkspace {
  cv::Mat frame;
  cv::Mat logs;
  std::vector<cv::Mat> buffers;
};

// Fits the points from `start` (px of `gray`). At each level, the image is warped into the patches'
// frame by the shape's similarity. Each point gets a target from its response. The shape model then
// moves the points to the nearest plausible shape (weighted by the responses, robustly). Optimised
// for speed: one warp per level, integer windows, no allocation in the loop.
[[nodiscard]] PatchFit fit_patches(const PatchModels& model, const shape::ShapeModel& shape,
                                   const PatchFitOptions& options, const cv::Mat& gray,
                                   const Eigen::Matrix2Xd& start, PatchWorkspace& workspace,
                                   DebugSink* debug = nullptr);

// All patches at their positions on the mean face (CV_8UC3, zoomed), with the patch of `point`
// framed (-1: none).
[[nodiscard]] cv::Mat draw_patches(const PatchModels& model, const shape::ShapeModel& shape,
                                   int point, int zoom);
// One patch, `side` px wide (CV_8UC3): on the left its weights (bright: responds to light), on the
// right the gradient of the weights, with direction as hue and strength as brightness.
[[nodiscard]] cv::Mat draw_patch(const PatchModels& model, int point, int side);

// The response of a patch around a point of an image, in the frame of the patches.
struct PointResponse {
  cv::Mat window;    // CV_8UC1, search x search; the point is in the middle
  cv::Mat response;  // CV_32FC1, search x search, -1..1
  cv::Point peak;    // of the response
  double best = 0;   // response at the peak
};
[[nodiscard]] std::vector<PointResponse> point_responses(const PatchModels& model,
                                                         const cv::Mat& gray,
                                                         const Eigen::Matrix2Xd& points,
                                                         int search);
// The two images side by side, `side` px each: crosses at the point, a disk at the peak (CV_8UC3).
[[nodiscard]] cv::Mat draw_response(const PointResponse& response, int side);
// The responses of all points around `points` in an image, in a grid of n cells.
[[nodiscard]] cv::Mat draw_responses(const PatchModels& model, const cv::Mat& gray,
                                     const Eigen::Matrix2Xd& points, int search);

[[nodiscard]] nlohmann::json to_json(const PatchModels& model);
[[nodiscard]] PatchModels patch_models_from_json(const nlohmann::json& value,
                                                 const std::string& path);

}  // namespace tarsier::face::regression
