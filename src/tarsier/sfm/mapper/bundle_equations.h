// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/bundle_cost.h"
#include "tarsier/sfm/mapper/bundle_solver.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

// The inside of the bundle adjustment: its unknowns, and the linear equations of a step.
namespace tarsier::sfm {

// The rows of a matrix of mixed second derivatives: 6 of a pose or up to 9 of a lens.
using MatrixNx3 = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3>;

// The variables are the poses that move, then the lenses. A pose has six numbers: a small rotation about the camera's
// centre (radians, camera frame), then the centre (world). A lens has those of `free_numbers`.
struct BundleVariables {
  explicit BundleVariables(const BundleProblem& problem);

  [[nodiscard]] int size_of(int variable) const { return variable < poses ? 6 : lens_size; }
  [[nodiscard]] int offset_of(int variable) const {
    return variable < poses ? 6 * variable : 6 * poses + (variable - poses) * lens_size;
  }
  // Where the numbers of the block of two entries k <= l of a point begin.
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
  // Where the numbers of the block of a variable with itself begin.
  [[nodiscard]] std::size_t diagonal_offset(int variable) const {
    return blocks[static_cast<std::size_t>(diagonal[static_cast<std::size_t>(variable)])].offset;
  }

  // Where the numbers of a block of J^T J begin: that of a pose with itself, or one whose column is a lens. A pose has no
  // other ones before points are eliminated.
  [[nodiscard]] std::size_t pose_place(int pose) const {
    return 36 * static_cast<std::size_t>(pose);
  }
  [[nodiscard]] std::size_t lens_place(std::size_t offset) const {
    return pose_place(poses) + offset - lens_offset;
  }

  // A variable that a point is seen by.
  struct Entry {
    int variable = 0;
    std::size_t offset = 0;  // in NormalEquations::mixed
  };
  // Of the camera system: variables (row <= column), and where its numbers lie, column by column.
  struct Block {
    int row = 0;
    int column = 0;
    std::size_t offset = 0;
  };

  int poses = 0;  // that move: variables 0 .. poses - 1
  int count = 0;
  int lens_size = 0;
  int size = 0;  // numbers of all variables
  std::ptrdiff_t moving_points = 0;
  std::vector<int> pose_variable;  // of each pose, or -1
  std::vector<int> lens_variable;  // of each lens, or -1
  std::vector<Entry> entries;      // of each point, by variable
  std::vector<std::size_t>
      entry_first;  // those of point p: entry_first[p] to entry_first[p + 1] - 1
  std::vector<std::size_t> pair_first;  // likewise in pair_block
  std::vector<int> pose_entry;          // of each observation: among its point's entries, or -1
  std::vector<int> lens_entry;
  // The blocks of each pair of a point's entries, or of all variables, whichever takes less memory; the other is empty.
  std::vector<int> pair_block;
  std::vector<std::uint32_t> block_offsets;  // at column * count + row
  std::vector<std::size_t> order;  // of points: those that touch the same blocks follow each other
  std::vector<Block> blocks;       // column by column, rows ascending
  std::vector<int> diagonal;       // block of each variable
  std::size_t block_numbers = 0;   // of all blocks
  std::size_t lens_offset = 0;     // where those of the columns of lenses begin
  std::size_t mixed_numbers = 0;   // of all entries

 private:
  void number_variables(const BundleProblem& problem);
  void find_entries(const BundleProblem& problem);
  void find_blocks(const BundleProblem& problem);
};

// The sum of the squares of residuals J d + r, by the step d: J^T J and J^T r.
struct NormalEquations {
  std::vector<double> blocks;  // J^T J: BundleVariables::pose_place(), lens_place()
  std::vector<double> mixed;   // of a variable (rows) and a point
  Eigen::VectorXd gradient;
  Eigen::VectorXd scale;  // the diagonal of J^T J
  std::vector<Eigen::Matrix3d> point_hessian;
  std::vector<Eigen::Vector3d> point_gradient;
};

// The equations at a state. `curvature`: of the loss along a residual, at least this share of that across, (0, 1].
void linearize(const BundleProblem& problem, const BundleVariables& variables,
               const BundleState& state, double curvature, NormalEquations& equations);

struct BundleStep {
  Eigen::VectorXd variables;
  std::vector<Eigen::Vector3d> points;
};

// The state after `share` of a step.
BundleState moved_by(const BundleProblem& problem, const BundleVariables& variables,
                     const BundleState& now, const BundleStep& step, double share);

// J^T r'' of the variables and the points: with d the step, h a small share of it and r the residuals,
// r'' = 2/h ((r(x + h d) - r(x)) / h - J d) is their second derivative along the step. The loss keeps its weights
// meanwhile. False where a point comes to lie behind a camera.
bool second_derivative(const BundleProblem& problem, const BundleVariables& variables,
                       const BundleState& now, const BundleStep& step, double curvature,
                       Eigen::VectorXd& gradient, std::vector<Eigen::Vector3d>& point_gradient);

}  // namespace tarsier::sfm
