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
// revisited", IJCV 2004). The warp is N(W(x; p); q): W piecewise affine with the shape's modes,
// N the similarity of their eq. 42, both as steps of the points in the mean frame.
namespace tarsier::face::appearance {

enum class Method {
  kProjectOut,   // steepest-descent images of the mean with the modes projected out (their eq. 41),
                 // everything but a few products precomputed
  kAlternating,  // of mean + modes c, c and the warp in turn, each exact for the other: what the
                 // simultaneous fit finds (Papandreou and Maragos, CVPR 2008; Tzimiropoulos and
                 // Pantic, ICCV 2013, "fast-SIC"). Dearer, and better on what the model has not
                 // seen
};

enum class FitStatus {
  kConverged,   // steps below the tolerance
  kIterations,  // the iterations ran out
  kDiverged,    // the error rose, or the shape left the crop; the best state is returned
};
[[nodiscard]] std::string_view name_of(FitStatus status);

struct FitOptions {
  Method method = Method::kProjectOut;
  // Per level at most.
  int iterations = 50;
  // Mean step of the points below which a fit has converged, px of the frame.
  double tolerance = 0.02;
  // Change of the error below which a fit has converged; 0: the steps decide.
  double error_tolerance = 0;
  // |b_i| <= sigmas * deviation_i for each mode.
  double sigmas = 3;
  // Pull of b towards 0: its variance against the texture noise, times this (neighbouring pixels
  // err alike, so well above 1 is right).
  double shape_prior = 50;
  // The same for c; 0: modes are projected out entirely.
  double texture_prior = 0;
  // Alternating: the steepest-descent images are computed again where the texture has changed by
  // more than this share since; 0: always.
  double refresh = 0.1;
  // Pixels that the model does not explain count less (Huber, "Robust statistics", 1981); the
  // Hessian is computed again each time.
  bool robust = false;
  // Share of the shape's variance whose modes take part at the coarsest level; all do at the
  // finest.
  double coarse_modes = 1;
  // Level to begin at; -1: the last. Level 0 is the finest.
  int coarsest = -1;
  // Level to end at.
  int finest = 0;
  // Keep the points of each iteration.
  bool trace = false;

  [[nodiscard]] OptionFields fields() {
    return {{"iterations", iterations, range(1, 10000), "--iterations", "at most, for each level"},
            {"tolerance", tolerance, above(0)},
            {"error_tolerance", error_tolerance, at_least(0)},
            {"sigmas", sigmas, above(0), "--sigmas",
             "how far a shape mode may go, standard deviations"},
            {"shape_prior", shape_prior, at_least(0), "--shape-prior",
             "pull towards the mean shape, in units of the texture's noise; 0: none"},
            {"texture_prior", texture_prior, at_least(0)},
            {"refresh", refresh, at_least(0), "--refresh",
             "alternating: share of change of the texture at which its images are made again"},
            {"robust", robust, "--robust", "pixels that fit badly (hidden) count less"},
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
  double error = 1;    // RMS of the texture that the model does not explain / RMS of the texture
                       // less its offset; 0..1
  int iterations = 0;  // all levels together
  FitStatus status = FitStatus::kIterations;  // of the finest level
  // Nothing like the model is there: error above model.lost_error, less than half of it in the
  // image, a mesh that folds, no gain, or a shape that left its crop.
  bool lost = false;
  double inside = 1;  // share of the frame in the image
  std::vector<FitStep> trace;
};

struct FitLevel;

// What the alternating fit precomputes for a texture.
struct FitTemplate {
  const FitLevel* level = nullptr;  // nullptr: of none
  Eigen::VectorXf c;                // of mean and modes, 1 + m
  Eigen::MatrixXf descent;          // N x K, steepest-descent images of the texture
  Eigen::MatrixXf projected;        // the same with the modes projected out; robust only
  Eigen::MatrixXf overlap;          // (1 + m) x K: modes' . descent
  linalg::Cholesky solver;
};

// All that a fit writes to; nothing is allocated in the iterations of the plain project-out fit
// once one has run (the alternating one needs buffers of Eigen's matrix product). One for each
// thread.
struct FitWorkspace {
  Upright upright;
  std::vector<FrameSampler::Affine> maps;
  std::vector<std::uint8_t> inside;
  std::vector<float> buffer;
  Eigen::VectorXf seen;
  Eigen::VectorXf residual;
  Eigen::VectorXf weights;             // of pixels
  Eigen::VectorXf target;              // gain mean + modes c
  Eigen::VectorXf products;            // SD . error
  Eigen::VectorXf along;               // basis . seen
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

// What can be precomputed. Immutable; shared by threads; refers to the model, which must live on.
class Fitter {
 public:
  Fitter(const AppearanceModel& model, const FitOptions& options);
  ~Fitter();
  Fitter(Fitter&&) noexcept;
  Fitter& operator=(Fitter&&) noexcept;

  // `image`: CV_8UC1 or CV_8UC3; `start`: 2 x n, px of it. Throws std::invalid_argument for
  // points that are not finite, coincide, or of another number.
  [[nodiscard]] FitResult fit(const cv::Mat& image, const Eigen::Matrix2Xd& start,
                              FitWorkspace& workspace) const;

  // The same in the next frame of a video: the alternating fit begins with the texture that
  // `workspace` has from the last fit, at the finest level alone.
  [[nodiscard]] FitResult follow(const cv::Mat& image, const Eigen::Matrix2Xd& start,
                                 FitWorkspace& workspace) const;

  // From several starts: each is fitted down to the level before the finest, the best two by error
  // to the end; the one with the least error.
  [[nodiscard]] FitResult fit_best(const cv::Mat& image,
                                   const std::vector<Eigen::Matrix2Xd>& starts,
                                   FitWorkspace& workspace) const;

  [[nodiscard]] const AppearanceModel& model() const;
  [[nodiscard]] const FitOptions& options() const;
  [[nodiscard]] const FitLevel& level(int index) const;  // for tests and timing

 private:
  FitResult run(const cv::Mat& image, const Eigen::Matrix2Xd& start, int coarsest, int finest,
                bool with_last, FitWorkspace& workspace) const;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier::face::appearance
