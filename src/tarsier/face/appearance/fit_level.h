// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"

#include <Eigen/Core>

#include <vector>

// Internals of the fit at one resolution level. Parameters are the coefficients of
// shape::combined_basis in px of the frame: first the four of the similarity, then the modes. A
// step of the parameters moves the points of the frame by basis * step.
namespace tarsier::face::appearance {

struct FitLevel {
  const AppearanceModel* model = nullptr;
  const Texture* texture = nullptr;
  FrameSampler sampler;
  CropFrame crop;
  int index = 0;  // 0: the finest
  int channels = 1;
  int parameters = 4;     // K: 4 + number of modes used at this level
  double unit = 1;        // RMS of a texture with gain 1 and the usual c
  Eigen::Matrix2Xd mean;  // the shape's mean, px of the frame, centred on 0
  double mean_square = 1;
  Eigen::MatrixXd basis;       // 2n x K
  Eigen::MatrixXd all_basis;   // 2(n + outer) x K
  Eigen::MatrixXf jacobian_x;  // pixels x K: dx of N(W(x)) by the parameters
  Eigen::MatrixXf jacobian_y;
  // Neighbours of a pixel for derivatives (the pixel itself if there is none) and 1 / their
  // distance.
  struct Neighbours {
    int left, right, above, below;
    float per_x, per_y;
  };
  std::vector<Neighbours> neighbours;
  Eigen::MatrixXf modes;         // N x (1 + m): mean / |mean|, then the modes; orthonormal
  Eigen::VectorXf mode_weights;  // 1 + m: share that is projected out
  Eigen::VectorXd shape_prior;   // K: added to the Hessian's diagonal
  // For project-out:
  Eigen::MatrixXf descent;          // N x K, steepest-descent images of the mean, projected
  Eigen::MatrixXd inverse_hessian;  // K x K

  FitLevel(const AppearanceModel& whole, const Texture& level_texture)
      : model(&whole), texture(&level_texture), sampler(level_texture.warp) {}
};

[[nodiscard]] FitLevel make_level(const AppearanceModel& model, const Texture& texture,
                                  const FitOptions& options, int modes);

// Steepest-descent images of a template (N numbers): N x K.
void steepest_descent(const FitLevel& level, const float* target, Eigen::MatrixXf& out);

// State of a fit at one level: points in px of the crop.
struct LevelState {
  double scale = 1;
  double error = 1;
  double gain = 0;
  double offset = 0;
  double inside = 1;
};

// Warps and normalises: sets workspace.sampled (RMS level.unit) and workspace.mode_coefficients
// (its coefficients of the modes).
void sample_texture(const FitLevel& level, FitWorkspace& workspace, LevelState& state);

// Sets the initial texture of the alternating fit, workspace.c: the mean texture, or the best one
// for the current warp.
void init_texture(const FitLevel& level, FitWorkspace& workspace, bool from_mean);
// The template of workspace.c; recomputed if c has changed or the template is of another level.
const FitTemplate& template_of(const FitLevel& level, const FitOptions& options,
                               FitWorkspace& workspace);

// Compute the step of the parameters, workspace.step.
void solve_project_out(const FitLevel& level, FitWorkspace& workspace);
void solve_alternating(const FitLevel& level, const FitOptions& options, FitWorkspace& workspace);
void solve_robust(const FitLevel& level, FitWorkspace& workspace, const Eigen::MatrixXf& descent);

// Composes the warp with the inverse of the step; sets workspace.points and p (sections 4.2 and
// 4.3). False if the result is invalid.
bool update_warp(const FitLevel& level, const FitOptions& options, FitWorkspace& workspace);

// Sets the points from the similarity (about the mean of the points) and p.
void set_points(const FitLevel& level, double a, double b, const Eigen::Vector2d& center,
                FitWorkspace& workspace);

}  // namespace tarsier::face::appearance
