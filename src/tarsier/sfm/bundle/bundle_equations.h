// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/bundle/bundle_cost.h"
#include "tarsier/sfm/bundle/bundle_solver.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

// Internal to bundle adjustment: its unknowns, and the linear equations of a step.
namespace tarsier::sfm {

// Rows of mixed second derivatives with a point: 6 for a pose or up to 9 for a lens.
using MatrixNx3 = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3>;

// The variables are the moving poses, then the lenses. A pose has six numbers: a small rotation
// about the camera centre (radians, camera frame), then the centre (world). A lens has those of
// `free_parameters`.
struct BundleVariables {
  explicit BundleVariables(const BundleProblem& problem);

  [[nodiscard]] int size_of(int variable) const { return variable < poses ? 6 : lens_size; }
  [[nodiscard]] int offset_of(int variable) const {
    return variable < poses ? 6 * variable : 6 * poses + (variable - poses) * lens_size;
  }
  // Offset of the block for two entries k <= l of a point.
  [[nodiscard]] std::size_t offset_of(std::size_t point, int k, int l) const {
    const auto column = static_cast<std::size_t>(l);
    if (!block_offsets.empty()) {
      const Entry* of_point = entries.data() + entry_first[point];
      return block_offsets[static_cast<std::size_t>(of_point[l].variable) *
                               static_cast<std::size_t>(count) +
                           static_cast<std::size_t>(of_point[k].variable)];
    }
    const int block =
        pair_block[pair_first[point] + column * (column + 1) / 2 + static_cast<std::size_t>(k)];
    return blocks[static_cast<std::size_t>(block)].offset;
  }
  // Offset of a variable's diagonal block.
  [[nodiscard]] std::size_t diagonal_offset(int variable) const {
    return blocks[static_cast<std::size_t>(diagonal[static_cast<std::size_t>(variable)])].offset;
  }

  // Offset of a block of J^T J: a pose's diagonal block, or one whose column is a lens. Before
  // points are eliminated, poses have no other blocks.
  [[nodiscard]] std::size_t pose_block_offset(int pose) const {
    return 36 * static_cast<std::size_t>(pose);
  }
  [[nodiscard]] std::size_t lens_block_offset(std::size_t offset) const {
    return pose_block_offset(poses) + offset - lens_offset;
  }

  // A variable that affects the observations of a point.
  struct Entry {
    int variable = 0;
    std::size_t offset = 0;  // in NormalEquations::mixed
  };
  // A block of the camera system: variables (row <= column), and the offset of its numbers,
  // column-major.
  struct Block {
    int row = 0;
    int column = 0;
    std::size_t offset = 0;
  };

  int poses = 0;  // moving poses: variables 0 .. poses - 1
  int count = 0;
  int lens_size = 0;
  int size = 0;  // sum of the sizes of all variables
  std::ptrdiff_t moving_points = 0;
  std::vector<int> pose_variable;  // for each pose, or -1
  std::vector<int> lens_variable;  // for each lens, or -1
  std::vector<Entry> entries;      // for each point, sorted by variable
  // those of point p: entry_first[p] to entry_first[p + 1] - 1
  std::vector<std::size_t> entry_first;
  std::vector<std::size_t> pair_first;  // likewise for pair_block
  std::vector<int> pose_entry;  // for each observation: index among its point's entries, or -1
  std::vector<int> lens_entry;
  // The blocks of each pair of a point's entries, or of all pairs of variables, whichever needs
  // less memory; the other one is empty.
  std::vector<int> pair_block;
  std::vector<std::uint32_t> block_offsets;  // at column * count + row
  std::vector<std::size_t> order;  // of the points: points that use the same blocks are adjacent
  std::vector<Block> blocks;       // by column, rows ascending
  std::vector<int> diagonal;       // for each variable: its diagonal block
  std::size_t block_values = 0;    // numbers in all blocks
  std::size_t lens_offset = 0;     // begin of the numbers of lens columns
  std::size_t mixed_values = 0;    // numbers of all entries

 private:
  void number_variables(const BundleProblem& problem);
  void find_entries(const BundleProblem& problem);
  void find_blocks(const BundleProblem& problem);
};

// The sum of squared residuals |J d + r|^2 for the step d: J^T J and J^T r.
struct NormalEquations {
  std::vector<double> blocks;  // J^T J: BundleVariables::pose_block_offset(), lens_block_offset()
  std::vector<double> mixed;   // for a variable (rows) and a point
  Eigen::VectorXd gradient;
  Eigen::VectorXd scale;  // the diagonal of J^T J
  std::vector<Eigen::Matrix3d> point_hessian;
  std::vector<Eigen::Vector3d> point_gradient;
};

// Computes the equations at a state. `curvature`: min ratio of the loss's curvature along a
// residual to that perpendicular to it, (0, 1].
void linearize(const BundleProblem& problem, const BundleVariables& variables,
               const BundleState& state, double curvature, NormalEquations& equations);

struct BundleStep {
  Eigen::VectorXd variables;
  std::vector<Eigen::Vector3d> points;
};

// The state after `share` of a step.
BundleState moved_by(const BundleProblem& problem, const BundleVariables& variables,
                     const BundleState& now, const BundleStep& step, double share);

// Computes J^T r'' for the variables and the points. With the step d, a small share h of it and the
// residuals r, r'' = 2/h ((r(x + h d) - r(x)) / h - J d) is their second derivative along the step.
// The weights of the loss are kept. False where a point moves behind a camera.
bool second_derivative(const BundleProblem& problem, const BundleVariables& variables,
                       const BundleState& now, const BundleStep& step, double curvature,
                       Eigen::VectorXd& gradient, std::vector<Eigen::Vector3d>& point_gradient);

}  // namespace tarsier::sfm
