// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/seam_levelling.h"

#include <cmath>
#include <cstddef>

namespace tarsier::sfm {
namespace {

constexpr double kAnchor = 1e-4;
constexpr int kIterations = 1000;
constexpr double kSolverTolerance = 1e-4;  // relative to the right side

// A symmetric sparse matrix by rows: the diagonal and the other entries.
struct Matrix {
  std::vector<double> diagonal;
  std::vector<std::size_t> first;
  std::vector<int> column;
  std::vector<double> value;

  void multiply(const std::vector<double>& x, std::vector<double>& y) const {
    for (std::size_t i = 0; i < diagonal.size(); ++i) {
      double sum = diagonal[i] * x[i];
      for (std::size_t k = first[i]; k < first[i + 1]; ++k)
        sum += value[k] * x[static_cast<std::size_t>(column[k])];
      y[i] = sum;
    }
  }
};

Matrix matrix_of(const SeamProblem& problem) {
  const auto nodes = static_cast<std::size_t>(problem.nodes);
  Matrix matrix;
  matrix.diagonal.assign(nodes, kAnchor);
  matrix.first.assign(nodes + 1, 0);
  const auto each = [&](const auto& take) {
    for (const auto& [a, b] : problem.edges) {
      take(static_cast<std::size_t>(a), b, problem.smoothness);
      take(static_cast<std::size_t>(b), a, problem.smoothness);
    }
    for (const SeamProblem::Seam& seam : problem.seams) {
      take(static_cast<std::size_t>(seam.a), seam.b, 1.0);
      take(static_cast<std::size_t>(seam.b), seam.a, 1.0);
    }
  };
  each([&](std::size_t row, int, double weight) {
    matrix.diagonal[row] += weight;
    ++matrix.first[row + 1];
  });
  for (std::size_t i = 0; i < nodes; ++i) matrix.first[i + 1] += matrix.first[i];
  matrix.column.resize(matrix.first.back());
  matrix.value.resize(matrix.first.back());
  std::vector<std::size_t> next(matrix.first.begin(), matrix.first.end() - 1);
  each([&](std::size_t row, int column, double weight) {
    matrix.column[next[row]] = column;
    matrix.value[next[row]++] = -weight;
  });
  return matrix;
}

double dot(const std::vector<double>& a, const std::vector<double>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

std::vector<double> solve(const Matrix& matrix, const std::vector<double>& right) {
  const std::size_t nodes = right.size();
  std::vector<double> x(nodes, 0);
  std::vector<double> residual = right;
  std::vector<double> scaled(nodes);
  std::vector<double> direction(nodes, 0);
  std::vector<double> image(nodes);
  double before = 0;
  const double enough = kSolverTolerance * kSolverTolerance * dot(right, right);
  for (int step = 0; step < kIterations && dot(residual, residual) > enough; ++step) {
    for (std::size_t i = 0; i < nodes; ++i) scaled[i] = residual[i] / matrix.diagonal[i];
    const double now = dot(residual, scaled);
    const double keep = step == 0 ? 0 : now / before;
    before = now;
    for (std::size_t i = 0; i < nodes; ++i) direction[i] = scaled[i] + keep * direction[i];
    matrix.multiply(direction, image);
    const double length = now / dot(direction, image);
    if (!std::isfinite(length)) break;
    for (std::size_t i = 0; i < nodes; ++i) {
      x[i] += length * direction[i];
      residual[i] -= length * image[i];
    }
  }
  return x;
}

}  // namespace

std::vector<cv::Vec3f> level_seams(const SeamProblem& problem) {
  std::vector<cv::Vec3f> offsets(static_cast<std::size_t>(problem.nodes), cv::Vec3f::all(0));
  if (problem.seams.empty()) return offsets;
  const Matrix matrix = matrix_of(problem);
  for (int channel = 0; channel < 3; ++channel) {
    std::vector<double> right(offsets.size(), 0);
    for (const SeamProblem::Seam& seam : problem.seams) {
      right[static_cast<std::size_t>(seam.a)] += static_cast<double>(seam.step[channel]);
      right[static_cast<std::size_t>(seam.b)] -= static_cast<double>(seam.step[channel]);
    }
    const std::vector<double> solution = solve(matrix, right);
    for (std::size_t i = 0; i < offsets.size(); ++i)
      offsets[i][channel] = static_cast<float>(solution[i]);
  }
  return offsets;
}

}  // namespace tarsier::sfm
