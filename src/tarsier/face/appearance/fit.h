// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/appearance/frame_sampler.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Core>

#include <memory>
#include <string_view>
#include <vector>

// Fitting by inverse compositional image alignment (Matthews and Baker, "Active appearance models
// revisited", IJCV 2004). The warp is N(W(x; p); q): W is piecewise affine with the shape's modes,
// N is the similarity of their eq. 42. Both are steps of the points in the mean frame.
namespace tarsier::face::appearance {

enum class Method {
  // Steepest-descent images of the mean with the modes projected out (their eq. 41). Everything
  // except a few products is precomputed.
  kProjectOut,
  // Steepest-descent images of mean + modes c. c and the warp are solved in turn, each exactly
  // given the other, which gives the result of the simultaneous fit (Papandreou and Maragos, CVPR
  // 2008; Tzimiropoulos and Pantic, ICCV 2013, "fast-SIC"). Slower, and better on unseen faces.
  kAlternating,
};

enum class FitStatus {
  kConverged,   // the step is below the tolerance
  kIterations,  // max number of iterations reached
  kDiverged,    // the error rose, or the shape left the crop; the best state is returned
};
[[nodiscard]] std::string_view name_of(FitStatus status);

struct FitOptions {
  Method method = Method::kProjectOut;
  // Max number per level.
  int iterations = 50;
  // Convergence: max mean step of the points, px of the frame.
  double tolerance = 0.02;
  // Convergence: max change of the error; 0 disables this test.
  double error_tolerance = 0;
  // |b_i| <= sigmas * deviation_i for each mode.
  double sigmas = 3;
  // Regularisation of b: its variance relative to the texture noise, times this factor. Errors of
  // neighbouring pixels are correlated, so that values well above 1 are appropriate.
  double shape_prior = 50;
  // The same for c; 0: the modes are projected out completely.
  double texture_prior = 0;
  // Alternating: the steepest-descent images are recomputed when the texture has changed by more
  // than this share; 0: always.
  double refresh = 0.1;
  // Down-weights pixels that the model does not explain (Huber, "Robust statistics", 1981). The
  // Hessian is then recomputed in each iteration.
  bool robust = false;
  // Share of the shape's variance in the modes that are used at the coarsest level; the finest
  // level uses all modes.
  double coarse_modes = 1;
  // Level to start at; -1: the last. Level 0 is the finest.
  int coarsest = -1;
  // Level to end at.
  int finest = 0;
  // Store the points of each iteration.
  bool trace = false;

  [[nodiscard]] OptionFields fields() {
    return {{"iterations", iterations, range(1, 10000), "--iterations",
             "maximum number of iterations a level"},
            {"tolerance", tolerance, above(0)},
            {"error_tolerance", error_tolerance, at_least(0)},
            {"sigmas", sigmas, above(0), "--sigmas",
             "maximum absolute value of a shape mode, standard deviations"},
            {"shape_prior", shape_prior, at_least(0), "--shape-prior",
             "weight of the shape prior, in units of the texture noise; 0: none"},
            {"texture_prior", texture_prior, at_least(0)},
            {"refresh", refresh, at_least(0), "--refresh",
             "alternating: relative texture change at which the steepest-descent images are "
             "recomputed"},
            {"robust", robust, "--robust", "give badly fitting (occluded) pixels less weight"},
            {"coarse_modes", coarse_modes, above(0, 1)}};
  }
  void check() const;
};

struct FitStep {
  int level = 0;
  double error = 0;
  Eigen::Matrix2Xd points;  // px of the image
};

struct FitResult {
  Eigen::Matrix2Xd points;  // 2 x n, px of the image
  shape::ShapeFit shape;    // similarity, b
  Eigen::VectorXd c;        // appearance parameters (eq. 40)
  double offset = 0;        // of the texture
  double gain = 0;
  double start_error = 1;  // at the start of the finest level
  // RMS of the unexplained texture / RMS of the texture minus its offset; 0..1.
  double error = 1;
  int iterations = 0;                         // sum over all levels
  FitStatus status = FitStatus::kIterations;  // of the finest level
  // The object is not there: error above model.lost_error, less than half of the frame in the
  // image, a folded mesh, no gain, or a shape that left its crop.
  bool lost = false;
  double inside = 1;  // share of the frame in the image
  std::vector<FitStep> trace;
};

struct FitLevel;

// Precomputed data of the alternating fit for a texture.
struct FitTemplate {
  const FitLevel* level = nullptr;  // nullptr: not set
  Eigen::VectorXf c;                // of mean and modes, 1 + m
  Eigen::MatrixXf descent;          // N x K, steepest-descent images of the texture
  Eigen::MatrixXf projected;        // the same with the modes projected out; robust only
  Eigen::MatrixXf overlap;          // (1 + m) x K: modes' . descent
  linalg::Cholesky solver;
};

// Buffers of a fit. The iterations of the plain project-out fit allocate nothing after the first
// fit (the alternating fit needs buffers of Eigen's matrix product). One per thread.
struct FitWorkspace {
  UprightCrop upright;
  std::vector<FrameSampler::Affine> maps;
  std::vector<std::uint8_t> inside;
  std::vector<float> buffer;
  Eigen::VectorXf sampled;
  Eigen::VectorXf residual;
  Eigen::VectorXf weights;             // per pixel
  Eigen::VectorXf target;              // gain mean + modes c
  Eigen::VectorXf products;            // SD . error
  Eigen::VectorXf mode_coefficients;   // basis . sampled
  Eigen::VectorXf c;                   // of mean and modes
  std::vector<FitTemplate> templates;  // of the levels
  Eigen::MatrixXf descent;             // N x K
  Eigen::MatrixXf scaled_overlap;
  Eigen::MatrixXf normal;  // K x K
  Eigen::MatrixXd hessian;
  Eigen::VectorXd right;
  Eigen::VectorXd step;
  linalg::Cholesky solver;
  Eigen::Matrix2Xd frame_step;
  Eigen::Matrix2Xd points;
  Eigen::Matrix2Xd last_points;
  Eigen::Matrix2Xd best_points;
  Eigen::Matrix2Xd all_points;
  Eigen::VectorXd p;
  Eigen::VectorXd best_p;
};

// Precomputed data of the fit. Immutable and thread-safe. Refers to the model, which must outlive
// it.
class Fitter {
 public:
  Fitter(const AppearanceModel& model, const FitOptions& options);
  ~Fitter();
  Fitter(Fitter&&) noexcept;
  Fitter& operator=(Fitter&&) noexcept;

  // `image`: CV_8UC1 or CV_8UC3; `start`: 2 x n, px. Throws std::invalid_argument for points that
  // are not finite, coincide, or have another number.
  [[nodiscard]] FitResult fit(const cv::Mat& image, const Eigen::Matrix2Xd& start,
                              FitWorkspace& workspace) const;

  // The same for the next frame of a video. Works at the finest level only; the alternating fit
  // starts with the texture of the last fit in `workspace`.
  [[nodiscard]] FitResult follow(const cv::Mat& image, const Eigen::Matrix2Xd& start,
                                 FitWorkspace& workspace) const;

  // Fits from several starts down to the level before the finest, continues with the two best ones
  // to the finest level, and returns the one with the smallest error.
  [[nodiscard]] FitResult fit_best(const cv::Mat& image,
                                   const std::vector<Eigen::Matrix2Xd>& starts,
                                   FitWorkspace& workspace) const;

  [[nodiscard]] const AppearanceModel& model() const;
  [[nodiscard]] const FitOptions& options() const;
  [[nodiscard]] const FitLevel& level(int index) const;  // for tests and timing

 private:
  FitResult run(const cv::Mat& image, const Eigen::Matrix2Xd& start, int coarsest, int finest,
                bool reuse_texture, FitWorkspace& workspace) const;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face::appearance
