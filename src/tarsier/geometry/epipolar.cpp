// SPDX-License-Identifier: MIT
#include "tarsier/geometry/epipolar.h"

#include "tarsier/core/require.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <utility>

namespace tarsier::geometry {
namespace {

constexpr int kMaxDegree = 10;
constexpr double kMaxRoot = 100;

// --- polynomials in x, y, z of degree 1, 2 and 3, as rows of coefficients ---

using Linear = Eigen::Matrix<double, 1, 4>;  // x y z 1
using Quadratic = Eigen::Matrix<double, 1, 10>;
using Cubic = Eigen::Matrix<double, 1, 20>;

struct Monomial {
  int x, y, z;
  friend constexpr bool operator==(const Monomial&, const Monomial&) = default;
  friend constexpr Monomial operator+(const Monomial& a, const Monomial& b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
  }
};
constexpr std::array<Monomial, 4> kLinear{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, 0}}};
constexpr std::array<Monomial, 10> kQuadratic{{{2, 0, 0},
                                               {1, 1, 0},
                                               {1, 0, 1},
                                               {1, 0, 0},
                                               {0, 2, 0},
                                               {0, 1, 1},
                                               {0, 1, 0},
                                               {0, 0, 2},
                                               {0, 0, 1},
                                               {0, 0, 0}}};
// In the order of elimination: the first ten are expressed by the others.
constexpr std::array<Monomial, 20> kCubic{{{3, 0, 0}, {0, 3, 0}, {2, 1, 0}, {1, 2, 0}, {2, 0, 1},
                                           {2, 0, 0}, {0, 2, 1}, {0, 2, 0}, {1, 1, 1}, {1, 1, 0},
                                           {1, 0, 2}, {1, 0, 1}, {1, 0, 0}, {0, 1, 2}, {0, 1, 1},
                                           {0, 1, 0}, {0, 0, 3}, {0, 0, 2}, {0, 0, 1}, {0, 0, 0}}};

// Index of the product of two monomials.
template <std::size_t N, std::size_t M, std::size_t K>
constexpr auto product_indices(const std::array<Monomial, N>& a, const std::array<Monomial, M>& b,
                               const std::array<Monomial, K>& product) {
  std::array<std::array<int, M>, N> indices{};
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t j = 0; j < M; ++j)
      for (std::size_t k = 0; k < K; ++k)
        if (product[k] == a[i] + b[j]) indices[i][j] = static_cast<int>(k);
  return indices;
}
constexpr auto kLinearProducts = product_indices(kLinear, kLinear, kQuadratic);
constexpr auto kQuadraticProducts = product_indices(kQuadratic, kLinear, kCubic);

// sum += factor a b
void add_product(Quadratic& sum, const Linear& a, const Linear& b, double factor = 1) {
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j)
      sum[kLinearProducts[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)]] +=
          factor * a[i] * b[j];
}
void add_product(Cubic& sum, const Quadratic& a, const Linear& b) {
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 4; ++j)
      sum[kQuadraticProducts[static_cast<std::size_t>(i)][static_cast<std::size_t>(j)]] +=
          a[i] * b[j];
}

using Row9 = std::array<double, 9>;
using Vector9 = Eigen::Matrix<double, 9, 1>;

// The row of x' E x = 0 for E in row-major order.
Row9 equation(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return {b[0] * a[0], b[0] * a[1], b[0], b[1] * a[0], b[1] * a[1], b[1], a[0], a[1], 1};
}

double dot(const Row9& a, const Row9& b, std::size_t from) {
  double sum = 0;
  for (std::size_t k = from; k < 9; ++k) sum += a[k] * b[k];
  return sum;
}

// Reflection x - 2 v (v.x) / (v.v), applied to the elements from `from` on.
void reflect(Row9& x, const Row9& v, double v_dot_v, std::size_t from) {
  const double factor = 2 * dot(v, x, from) / v_dot_v;
  for (std::size_t k = from; k < 9; ++k) x[k] -= factor * v[k];
}

// An orthonormal basis of the null space of n rows, by Householder reflections (Golub and Van Loan,
// 5.2); false for non-finite rows. Written out, because Eigen's templates of these sizes take ten
// seconds to compile.
template <std::size_t N>
bool null_space(std::array<Row9, N> rows, std::array<Row9, 9 - N>& basis) {
  std::array<double, N> lengths;  // squared lengths of the reflection vectors; 0: none
  for (std::size_t i = 0; i < N; ++i) {
    Row9& v = rows[i];
    const double norm = std::sqrt(dot(v, v, i));
    if (!std::isfinite(norm)) return false;
    v[i] += v[i] < 0 ? -norm : norm;
    lengths[i] = dot(v, v, i);
    for (std::size_t j = i + 1; j < N && lengths[i] > 0; ++j) reflect(rows[j], v, lengths[i], i);
  }
  for (std::size_t k = 0; k < basis.size(); ++k) {
    basis[k].fill(0);
    basis[k][N + k] = 1;
    for (std::size_t i = N; i-- > 0;)
      if (lengths[i] > 0) reflect(basis[k], rows[i], lengths[i], i);
  }
  return true;
}

Eigen::Matrix3d matrix_of(const Vector9& rows) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
}

using Equations = std::array<Cubic, 10>;

// The ten equations: det E = 0, and the nine elements of (E E' - trace(E E') / 2) E.
Equations constraints(const std::array<std::array<Linear, 3>, 3>& e) {
  Equations equations;
  std::array<std::array<Quadratic, 3>, 3> square;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = i; j < 3; ++j) {
      Quadratic sum = Quadratic::Zero();
      for (std::size_t k = 0; k < 3; ++k) add_product(sum, e[i][k], e[j][k]);
      square[i][j] = square[j][i] = sum;
    }
  }
  const Quadratic half_trace = (square[0][0] + square[1][1] + square[2][2]) / 2;
  for (std::size_t i = 0; i < 3; ++i) square[i][i] -= half_trace;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      Cubic sum = Cubic::Zero();
      for (std::size_t k = 0; k < 3; ++k) add_product(sum, square[i][k], e[k][j]);
      equations[3 * i + j] = sum;
    }
  }
  Cubic determinant = Cubic::Zero();
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t l = (k + 1) % 3;
    const std::size_t m = (k + 2) % 3;
    Quadratic minor = Quadratic::Zero();
    add_product(minor, e[1][l], e[2][m]);
    add_product(minor, e[1][m], e[2][l], -1);
    add_product(determinant, minor, e[0][k]);
  }
  equations[9] = determinant;
  return equations;
}

// Gauss-Jordan elimination with row pivoting: the first ten unknowns get the identity matrix and
// are expressed by the others. False if the equations do not determine them.
bool eliminate(Equations& equations) {
  for (int i = 0; i < 10; ++i) {
    const auto row = static_cast<std::size_t>(i);
    std::size_t pivot = row;
    for (std::size_t r = row + 1; r < 10; ++r)
      if (std::abs(equations[r][i]) > std::abs(equations[pivot][i])) pivot = r;
    std::swap(equations[row], equations[pivot]);
    const double divisor = equations[row][i];
    if (divisor == 0 || !std::isfinite(divisor)) return false;
    for (int c = i; c < 20; ++c) equations[row][c] /= divisor;
    for (std::size_t r = 0; r < 10; ++r) {
      const double factor = equations[r][i];
      if (r == row || factor == 0) continue;
      for (int c = i; c < 20; ++c) equations[r][c] -= factor * equations[row][c];
    }
  }
  return true;
}

// --- polynomials in one variable, by ascending powers ---

template <std::size_t N, std::size_t M>
std::array<double, N + M - 1> product(const std::array<double, N>& a,
                                      const std::array<double, M>& b) {
  std::array<double, N + M - 1> result{};
  for (std::size_t i = 0; i < N; ++i)
    for (std::size_t j = 0; j < M; ++j) result[i + j] += a[i] * b[j];
  return result;
}

template <std::size_t N>
double value_at(const std::array<double, N>& c, double z) {
  double sum = 0;
  for (std::size_t k = N; k-- > 0;) sum = sum * z + c[k];
  return sum;
}

struct Polynomial {
  std::array<double, kMaxDegree + 1> c{};
  int degree = 0;

  [[nodiscard]] double operator()(double z) const {
    double sum = c[static_cast<std::size_t>(degree)];
    for (int k = degree - 1; k >= 0; --k) sum = sum * z + c[static_cast<std::size_t>(k)];
    return sum;
  }
};

// Sturm's chain: a polynomial, its derivative, and then the negated remainders of the two
// polynomials before. The number of sign changes at a minus that at b is the number of roots in
// between.
class SturmChain {
 public:
  explicit SturmChain(const Polynomial& p) {
    chain_[0] = p;
    Polynomial& slope = chain_[1];
    slope.degree = p.degree - 1;
    for (int k = 0; k < p.degree; ++k)
      slope.c[static_cast<std::size_t>(k)] = (k + 1) * p.c[static_cast<std::size_t>(k + 1)];
    length_ = 2;
    while (chain_[static_cast<std::size_t>(length_ - 1)].degree > 0 && divide()) {
    }
  }

  [[nodiscard]] int changes(double z) const {
    int count = 0;
    bool was_negative = false;
    bool any = false;
    for (int k = 0; k < length_; ++k) {
      const double value = chain_[static_cast<std::size_t>(k)](z);
      if (value == 0) continue;
      count += any && (value < 0) != was_negative ? 1 : 0;
      was_negative = value < 0;
      any = true;
    }
    return count;
  }

  [[nodiscard]] const Polynomial& polynomial() const { return chain_[0]; }
  [[nodiscard]] const Polynomial& slope() const { return chain_[1]; }

 private:
  bool divide() {
    Polynomial rest = chain_[static_cast<std::size_t>(length_ - 2)];
    const Polynomial& by = chain_[static_cast<std::size_t>(length_ - 1)];
    for (int shift = rest.degree - by.degree; shift >= 0; --shift) {
      const double factor = rest.c[static_cast<std::size_t>(by.degree + shift)] /
                            by.c[static_cast<std::size_t>(by.degree)];
      for (int k = 0; k <= by.degree; ++k)
        rest.c[static_cast<std::size_t>(k + shift)] -= factor * by.c[static_cast<std::size_t>(k)];
    }
    rest.degree = by.degree - 1;
    double max_coefficient = 0;
    for (int k = 0; k <= rest.degree; ++k)
      max_coefficient = std::max(max_coefficient, std::abs(rest.c[static_cast<std::size_t>(k)]));
    if (!(max_coefficient > 0) || !std::isfinite(max_coefficient)) return false;
    while (rest.degree > 0 &&
           std::abs(rest.c[static_cast<std::size_t>(rest.degree)]) < 1e-14 * max_coefficient)
      --rest.degree;
    for (int k = 0; k <= rest.degree; ++k) rest.c[static_cast<std::size_t>(k)] /= -max_coefficient;
    chain_[static_cast<std::size_t>(length_++)] = rest;
    return true;
  }

  std::array<Polynomial, kMaxDegree + 1> chain_;
  int length_ = 0;
};

// The single root in low..high: by bisection until the signs differ, then by Newton's method within
// the bracket.
double refined_root(const SturmChain& chain, double low, double high) {
  const Polynomial& p = chain.polynomial();
  double at_low = p(low);
  double at_high = p(high);
  if (at_high == 0) return high;
  // A double root has no sign change.
  for (int k = 0; k < 60 && (at_low < 0) == (at_high < 0); ++k) {
    const double middle = 0.5 * (low + high);
    if (chain.changes(low) != chain.changes(middle)) {
      high = middle;
      at_high = p(high);
    } else {
      low = middle;
      at_low = p(low);
    }
  }
  double root = 0.5 * (low + high);
  for (int k = 0; k < 60; ++k) {
    const double value = p(root);
    if (value == 0) return root;
    ((value < 0) == (at_low < 0) ? low : high) = root;
    const double slope = chain.slope()(root);
    double next = root - value / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - root) <= 1e-12 * (1 + std::abs(root))) return next;
    root = next;
  }
  return root;
}

int isolate_roots(const SturmChain& chain, double low, int at_low, double high, int at_high,
                  int depth, std::span<double> roots) {
  const int count = at_low - at_high;
  if (count <= 0 || roots.empty()) return 0;
  if (count == 1 || depth == 0) {
    roots[0] = refined_root(chain, low, high);
    return 1;
  }
  const double middle = 0.5 * (low + high);
  const int at_middle = chain.changes(middle);
  const int left = isolate_roots(chain, low, at_low, middle, at_middle, depth - 1, roots);
  return left + isolate_roots(chain, middle, at_middle, high, at_high, depth - 1,
                              roots.subspan(static_cast<std::size_t>(left)));
}

}  // namespace

int real_roots(std::span<const double> coefficients, double low, double high,
               std::span<double> roots) {
  TARSIER_REQUIRE(coefficients.size() >= 2 && coefficients.size() <= kMaxDegree + 1 &&
                      roots.size() + 1 >= coefficients.size(),
                  "a polynomial of {} coefficients", coefficients.size());
  Polynomial p;
  double max_coefficient = 0;
  for (const double c : coefficients) max_coefficient = std::max(max_coefficient, std::abs(c));
  if (!(max_coefficient > 0) || !std::isfinite(max_coefficient)) return 0;
  for (std::size_t k = 0; k < coefficients.size(); ++k) p.c[k] = coefficients[k] / max_coefficient;
  p.degree = static_cast<int>(coefficients.size()) - 1;
  while (p.degree > 0 && std::abs(p.c[static_cast<std::size_t>(p.degree)]) < 1e-14) --p.degree;
  if (p.degree == 0) return 0;
  const SturmChain chain(p);
  return isolate_roots(chain, low, chain.changes(low), high, chain.changes(high), 50, roots);
}

int five_point(const std::array<Eigen::Vector2d, 5>& first,
               const std::array<Eigen::Vector2d, 5>& second,
               std::array<Eigen::Matrix3d, kMaxEssentials>& essentials) {
  std::array<Row9, 5> rows;
  for (std::size_t i = 0; i < 5; ++i) rows[i] = equation(first[i], second[i]);
  std::array<Row9, 4> null;
  if (!null_space(rows, null)) return 0;

  std::array<std::array<Linear, 3>, 3> e;
  for (std::size_t i = 0; i < 9; ++i)
    e[i / 3][i % 3] = Linear(null[0][i], null[1][i], null[2][i], null[3][i]);
  Equations equations = constraints(e);
  if (!eliminate(equations)) return 0;

  // Rows 4 to 9 are x2z, x2, y2z, y2, xyz, xy. Subtracting z times the second from the first, and
  // so on, gives three equations in x, y, 1 with polynomials in z.
  std::array<std::array<double, 4>, 3> x_terms;
  std::array<std::array<double, 4>, 3> y_terms;
  std::array<std::array<double, 5>, 3> constant_terms;
  for (int k = 0; k < 3; ++k) {
    const auto s = static_cast<std::size_t>(k);
    const double* const u = equations[4 + 2 * s].data() + 10;
    const double* const v = equations[5 + 2 * s].data() + 10;
    x_terms[s] = {u[2], u[1] - v[2], u[0] - v[1], -v[0]};
    y_terms[s] = {u[5], u[4] - v[5], u[3] - v[4], -v[3]};
    constant_terms[s] = {u[9], u[8] - v[9], u[7] - v[8], u[6] - v[7], -v[6]};
  }
  std::array<double, 11> determinant{};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t l = (k + 1) % 3;
    const std::size_t m = (k + 2) % 3;
    const auto lm = product(x_terms[l], y_terms[m]);
    const auto ml = product(x_terms[m], y_terms[l]);
    std::array<double, 7> minor{};
    for (std::size_t i = 0; i < 7; ++i) minor[i] = lm[i] - ml[i];
    const auto term = product(minor, constant_terms[k]);
    for (std::size_t i = 0; i < 11; ++i) determinant[i] += term[i];
  }
  std::array<double, kMaxDegree> roots{};
  const int count = real_roots(determinant, -kMaxRoot, kMaxRoot, roots);
  int found = 0;
  for (int r = 0; r < count; ++r) {
    const double z = roots[static_cast<std::size_t>(r)];
    Eigen::Matrix3d b;
    for (int k = 0; k < 3; ++k) {
      const auto s = static_cast<std::size_t>(k);
      b.row(k) << value_at(x_terms[s], z), value_at(y_terms[s], z), value_at(constant_terms[s], z);
    }
    // (x, y, 1) is orthogonal to two rows: the longest of the three cross products is the most
    // accurate.
    Eigen::Vector3d best = Eigen::Vector3d::Zero();
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d cross = b.row(k).cross(b.row((k + 1) % 3));
      if (cross.squaredNorm() > best.squaredNorm()) best = cross;
    }
    if (best[2] == 0) continue;
    Vector9 numbers;
    for (std::size_t i = 0; i < 9; ++i)
      numbers[static_cast<Eigen::Index>(i)] = null[0][i] * best[0] / best[2] +
                                              null[1][i] * best[1] / best[2] + null[2][i] * z +
                                              null[3][i];
    const double norm = numbers.norm();
    if (!(norm > 0) || !std::isfinite(norm)) continue;
    essentials[static_cast<std::size_t>(found++)] = matrix_of(numbers / norm);
  }
  return found;
}

int seven_point(const std::array<Eigen::Vector2d, 7>& first,
                const std::array<Eigen::Vector2d, 7>& second,
                std::array<Eigen::Matrix3d, kMaxFundamentals>& fundamentals) {
  std::array<Row9, 7> rows;
  for (std::size_t i = 0; i < 7; ++i) rows[i] = equation(first[i], second[i]);
  std::array<Row9, 2> null;
  if (!null_space(rows, null)) return 0;
  const Eigen::Matrix3d f = matrix_of(Eigen::Map<const Vector9>(null[0].data()));
  const Eigen::Matrix3d g = matrix_of(Eigen::Map<const Vector9>(null[1].data()));
  // det (a f + g) = a3 det f + a2 trace(adj(f) g) + a trace(adj(g) f) + det g
  const auto adjugate = [](const Eigen::Matrix3d& m) {
    Eigen::Matrix3d result;
    result.row(0) = m.col(1).cross(m.col(2));
    result.row(1) = m.col(2).cross(m.col(0));
    result.row(2) = m.col(0).cross(m.col(1));
    return result;
  };
  const std::array<double, 4> cubic{g.determinant(), (adjugate(g) * f).trace(),
                                    (adjugate(f) * g).trace(), f.determinant()};
  // If a is above 1, solves for f + g / a with the reversed cubic, whose root is equally well
  // determined.
  const std::array<double, 4> reversed{cubic[3], cubic[2], cubic[1], cubic[0]};
  int count = 0;
  for (const bool is_small_root : {true, false}) {
    std::array<double, 3> roots{};
    const int found = real_roots(is_small_root ? cubic : reversed, -1, 1, roots);
    for (int r = 0; r < found && count < kMaxFundamentals; ++r) {
      const double root = roots[static_cast<std::size_t>(r)];
      const Eigen::Matrix3d sum =
          (is_small_root ? root : 1.0) * f + (is_small_root ? 1.0 : root) * g;
      fundamentals[static_cast<std::size_t>(count++)] = sum / sum.norm();
    }
  }
  return count;
}

bool four_point(const std::array<Eigen::Vector2d, 4>& first,
                const std::array<Eigen::Vector2d, 4>& second, Eigen::Matrix3d& homography) {
  // For each image, the matrix that maps the basis and (1, 1, 1) to the four points.
  const auto basis = [](const std::array<Eigen::Vector2d, 4>& p, Eigen::Matrix3d& m) {
    m << p[0].homogeneous(), p[1].homogeneous(), p[2].homogeneous();
    const Eigen::Vector3d weights(p[3].homogeneous().dot(m.col(1).cross(m.col(2))),
                                  p[3].homogeneous().dot(m.col(2).cross(m.col(0))),
                                  p[3].homogeneous().dot(m.col(0).cross(m.col(1))));
    const double area = std::abs(m.determinant());
    m = m * weights.asDiagonal();
    const double scale = std::max(area, weights.cwiseAbs().maxCoeff());
    return std::min(area, weights.cwiseAbs().minCoeff()) > 1e-9 * scale && scale > 0;
  };
  Eigen::Matrix3d a;
  Eigen::Matrix3d b;
  if (!basis(first, a) || !basis(second, b)) return false;
  homography = b * a.inverse();
  const double norm = homography.norm();
  if (!(norm > 0) || !std::isfinite(norm)) return false;
  homography /= norm;
  return true;
}

Eigen::Matrix3d essential_of(const Rigid3& second_from_first) {
  const Eigen::Vector3d& t = second_from_first.translation;
  Eigen::Matrix3d cross;
  cross << 0, -t[2], t[1], t[2], 0, -t[0], -t[1], t[0], 0;
  return cross * second_from_first.rotation;
}

std::array<Rigid3, 4> motions_of(const Eigen::Matrix3d& essential) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(essential, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  Eigen::Matrix3d v = svd.matrixV();
  if (u.determinant() < 0) u.col(2) *= -1;
  if (v.determinant() < 0) v.col(2) *= -1;
  Eigen::Matrix3d quarter_turn;
  quarter_turn << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const Eigen::Matrix3d one = u * quarter_turn * v.transpose();
  const Eigen::Matrix3d other = u * quarter_turn.transpose() * v.transpose();
  const Eigen::Vector3d t = u.col(2);
  return {Rigid3{one, t}, Rigid3{one, -t}, Rigid3{other, t}, Rigid3{other, -t}};
}

}  // namespace tarsier::geometry
