// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/training_face.h"
#include "tarsier/face/shape/shape_model.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <string>
#include <vector>

// Patch models: for each point a small linear filter whose response is highest at the point
// (constrained local models: Cristinacce and Cootes, BMVC 2006; correlation filters: Bolme et al.,
// CVPR 2010).
namespace tarsier::face::landmarks {

enum class PatchMethod {
  kStochastic,  // gradient descent on the squared difference to the wished response
  kRidge,       // the same least squares in closed form: one ridge regression for each point
  kAverage,     // the mean patch ("generative"): for comparison
};

// Every method works on log(1 + gray), and on windows of the patch's size without their mean and of
// norm 1, as the responses of the fit do. Stochastic and ridge minimise, over all faces and places
// of the search window,
//   sum (patch . window - wished)^2 + lambda energy |patch|^2,
// `energy` being the mean square of a pixel, summed over all windows.
struct PatchOptions {
  PatchMethod method = PatchMethod::kRidge;
  int patch = 11;           // px, side of a patch, odd
  int search = 21;          // px, side of the window of responses in training, odd
  double face_width = 70;   // px, width of the mean shape at which patches work
  double variance = 0.7;    // px^2, of the wished Gaussian response
  double lambda = 0.1;      // weight of the regularisation
  double first_step = 0.5;  // of the descent, share of the largest that cannot diverge; it
                            // falls to a thousandth of it
  int samples = 1000;       // steps of the descent for each point
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
  Eigen::Matrix2Xd reference;    // 2 x n, px: the mean shape, face_width wide, centred on 0
  std::vector<cv::Mat> patches;  // n of CV_32FC1, patch x patch, mean 0, norm 1
  [[nodiscard]] int points() const { return static_cast<int>(patches.size()); }
  [[nodiscard]] int side() const { return patches.empty() ? 0 : patches[0].cols; }
  void check() const;
};

// Training windows are cut from each face in the frame of `reference` (similarity of the face's
// points to it, sub-pixel, pixel centres at integers, so that the point is exactly at the middle).
// The result does not depend on the number of threads. Throws Interrupted, std::invalid_argument.
[[nodiscard]] PatchModels train_patches(const std::vector<TrainingFace>& faces,
                                        const shape::ShapeModel& shape, const PatchOptions& options,
                                        Progress& progress, const std::stop_token& stop);

// Normalised correlation of a patch with log(1 + gray) at each place of a window (CV_8UC1 or CV_32F
// grey values), CV_32FC1 of window - patch + 1, in -1..1.
[[nodiscard]] cv::Mat patch_response(const cv::Mat& patch, const cv::Mat& window);

// Where a point wants to go within its window of responses.
enum class PatchTarget {
  kPeak,       // the highest response, sub-pixel
  kMeanShift,  // the mean of the window under response and a kernel around where the point is now
               // (Saragih et al., "Deformable model fitting by regularized landmark mean-shift",
               // IJCV 2011)
};

struct PatchFitOptions {
  PatchTarget target = PatchTarget::kMeanShift;
  std::vector<int> search = {21, 11, 7};  // px, side of the window of responses at each level, odd
  int iterations = 10;                    // at most at each level
  double tolerance = 1e-3;  // stop a level when no point moves more than this share of face width
  bool robust = true;       // points weighted by how well they agree with the shape
  double sigmas = 3;        // clamping of the shape
  double sharpness = 40;    // kMeanShift: a place counts by exp(sharpness * response)
  double spread = 0.3;      // kMeanShift: deviation of the kernel, share of the window
  double noise = 10;        // px^2, of a point, against the shape's variance

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
  Eigen::VectorXd peaks;    // n, response at each point, -1..1
  double score = 0;         // mean of the peaks
};

// Buffers, reused from call to call. One for each thread.
struct PatchWorkspace {
  cv::Mat frame;
  cv::Mat logs;
  std::vector<cv::Mat> buffers;
};

// Fits from `start` (px of `gray`): at each level, the image is brought into the patches' frame
// by the shape's similarity, every point goes to the peak of its response (sub-pixel), and the
// shape model takes the points to the nearest plausible shape (weighted by the peaks, robustly).
// Made for speed: one warp a level, integer windows, no allocation in the loop.
[[nodiscard]] PatchFit fit_patches(const PatchModels& model, const shape::ShapeModel& shape,
                                   const PatchFitOptions& options, const cv::Mat& gray,
                                   const Eigen::Matrix2Xd& start, PatchWorkspace& workspace,
                                   DebugSink* debug = nullptr);

// Composite of all patches at their places on the mean face (CV_8UC3, zoomed), the one of `point`
// framed (-1: none).
[[nodiscard]] cv::Mat draw_patches(const PatchModels& model, const shape::ShapeModel& shape,
                                   int point, int zoom);
// One patch, `side` px wide: its weights (bright: wants light there), and beside them the gradient
// of the weights, direction as hue and strength as brightness (CV_8UC3).
[[nodiscard]] cv::Mat draw_patch(const PatchModels& model, int point, int side);

// What a patch sees around a point of an image, in the frame of the patches.
struct PointResponse {
  cv::Mat window;    // CV_8UC1, search x search; the point is in the middle
  cv::Mat response;  // CV_32FC1, search x search, -1..1
  cv::Point peak;    // of the response
  double best = 0;   // there
};
[[nodiscard]] std::vector<PointResponse> point_responses(const PatchModels& model,
                                                         const cv::Mat& gray,
                                                         const Eigen::Matrix2Xd& points,
                                                         int search);
// The two images beside each other, `side` px each: crosses at the point, a disk at the peak
// (CV_8UC3).
[[nodiscard]] cv::Mat draw_response(const PointResponse& response, int side);
// The responses of all points around `points` on an image, as a sheet of n cells.
[[nodiscard]] cv::Mat draw_responses(const PatchModels& model, const cv::Mat& gray,
                                     const Eigen::Matrix2Xd& points, int search);

[[nodiscard]] nlohmann::json to_json(const PatchModels& model);
[[nodiscard]] PatchModels patch_models_from_json(const nlohmann::json& value,
                                                 const std::string& path);

}  // namespace tarsier::face::landmarks
