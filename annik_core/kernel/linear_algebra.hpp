// Small dense linear algebra: six equations, a few joints. Matrices are column by column.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>

namespace annik {

constexpr std::size_t MAX_JOINTS = 32;

using Joints = std::array<double, MAX_JOINTS>;
using Column = std::array<double, 6>;
// 6 x n.
using Jacobian = std::array<Column, MAX_JOINTS>;

inline double dot(const Column& a, const Column& b) {
  double sum = 0.0;
  for (std::size_t row = 0; row < 6; ++row) sum += a[row] * b[row];
  return sum;
}

// Elimination of six equations A x = b with row exchanges, to an upper triangle. The sign of A's
// determinant, 0 if A is singular.
inline int eliminate_six(Jacobian& a, Column& b) {
  int sign = 1;
  for (std::size_t k = 0; k < 6; ++k) {
    std::size_t pivot = k;
    for (std::size_t row = k + 1; row < 6; ++row)
      if (std::abs(a[k][row]) > std::abs(a[k][pivot])) pivot = row;
    if (!(std::abs(a[k][pivot]) > 0.0)) return 0;
    if (pivot != k) {
      for (std::size_t column = k; column < 6; ++column) std::swap(a[column][k], a[column][pivot]);
      std::swap(b[k], b[pivot]);
      sign = -sign;
    }
    if (a[k][k] < 0.0) sign = -sign;
    const double inverse = 1.0 / a[k][k];
    for (std::size_t row = k + 1; row < 6; ++row) {
      const double factor = a[k][row] * inverse;
      for (std::size_t column = k + 1; column < 6; ++column)
        a[column][row] -= factor * a[column][k];
      b[row] -= factor * b[k];
    }
  }
  return sign;
}

// Solves A x = b of six equations. False if A is singular.
inline bool solve_six(Jacobian a, Column b, Joints& x) {
  if (eliminate_six(a, b) == 0) return false;
  for (std::size_t k = 6; k-- > 0;) {
    double sum = b[k];
    for (std::size_t column = k + 1; column < 6; ++column) sum -= a[column][k] * x[column];
    x[k] = sum / a[k][k];
  }
  return true;
}

// The x of least |A x - b|^2 + damping |x|^2, A of n columns: Cholesky's factors of the normal
// equations. False if they are not positive definite.
inline bool damped_least_squares(const Jacobian& a, const Column& b, std::size_t n, double damping,
                                 Joints& x) {
  std::array<Joints, MAX_JOINTS> factor;
  for (std::size_t row = 0; row < n; ++row) {
    for (std::size_t column = 0; column <= row; ++column) {
      double sum = dot(a[row], a[column]) + (row == column ? damping : 0.0);
      for (std::size_t k = 0; k < column; ++k) sum -= factor[row][k] * factor[column][k];
      if (row != column) {
        factor[row][column] = sum / factor[column][column];
      } else {
        if (!(sum > 0.0)) return false;
        factor[row][row] = std::sqrt(sum);
      }
    }
    double sum = dot(a[row], b);
    for (std::size_t k = 0; k < row; ++k) sum -= factor[row][k] * x[k];
    x[row] = sum / factor[row][row];
  }
  for (std::size_t row = n; row-- > 0;) {
    for (std::size_t k = row + 1; k < n; ++k) x[row] -= factor[k][row] * x[k];
    x[row] /= factor[row][row];
  }
  return true;
}

// One-sided Jacobi: rotates pairs of the columns of A (m x n) until they are orthogonal, which
// makes them singular vectors times singular values, and rotates V, at first the identity, along.
template <std::size_t Rows, std::size_t Columns>
void orthogonalise(std::array<std::array<double, Rows>, Columns>& a,
                   std::array<std::array<double, Columns>, Columns>& v, std::size_t m,
                   std::size_t n) {
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) v[i][j] = i == j ? 1.0 : 0.0;
  for (int sweep = 0; sweep < 30; ++sweep) {
    bool rotated = false;
    for (std::size_t i = 0; i + 1 < n; ++i) {
      for (std::size_t j = i + 1; j < n; ++j) {
        double ii = 0.0, jj = 0.0, ij = 0.0;
        for (std::size_t row = 0; row < m; ++row) {
          ii += a[i][row] * a[i][row];
          jj += a[j][row] * a[j][row];
          ij += a[i][row] * a[j][row];
        }
        if (!(std::abs(ij) > 4e-16 * std::sqrt(ii * jj))) continue;  // rounding
        rotated = true;
        const double ratio = (jj - ii) / (2.0 * ij);
        // Without hypot, which is slow: an infinite ratio gives a tangent of 0, as it should.
        const double tangent =
            std::copysign(1.0, ratio) / (std::abs(ratio) + std::sqrt(1.0 + ratio * ratio));
        const double cosine = 1.0 / std::sqrt(1.0 + tangent * tangent), sine = cosine * tangent;
        const auto rotate = [&](double& first, double& second) {
          const double before = first;
          first = cosine * before - sine * second;
          second = sine * before + cosine * second;
        };
        for (std::size_t row = 0; row < m; ++row) rotate(a[i][row], a[j][row]);
        for (std::size_t row = 0; row < n; ++row) rotate(v[i][row], v[j][row]);
      }
    }
    if (!rotated) return;
  }
}

// The least of the min(6, n) singular values of A, and its singular vectors u and v.
struct LeastSingularValue {
  double value = 0.0;
  Column left{};
  Joints right{};
};

// The places of vectors, the longest first.
template <typename Vector>
std::array<std::size_t, MAX_JOINTS> by_length(const Vector* vectors, std::size_t count) {
  std::array<std::pair<double, std::size_t>, MAX_JOINTS> squares;
  for (std::size_t i = 0; i < count; ++i) {
    double square = 0.0;
    for (double part : vectors[i]) square += part * part;
    squares[i] = {std::isnan(square) ? 0.0 : -square, i};  // NaN has no place in an order
  }
  std::sort(squares.begin(), squares.begin() + count);
  std::array<std::size_t, MAX_JOINTS> places;
  for (std::size_t i = 0; i < count; ++i) places[i] = squares[i].second;
  return places;
}

// The unit vector that is orthogonal to five others, which are orthogonal to one another.
inline Column sixth_direction(std::array<Column, 5> others) {
  Column free;
  free.fill(1.0);  // how much of each axis the others leave
  for (Column& other : others) {
    const double length = std::sqrt(dot(other, other));
    for (std::size_t row = 0; row < 6; ++row) {
      if (length > 0.0) other[row] /= length;
      free[row] -= other[row] * other[row];
    }
  }
  Column sixth{};
  sixth[std::max_element(free.begin(), free.end()) - free.begin()] = 1.0;
  for (int again = 0; again < 2; ++again) {
    for (const Column& other : others) {
      const double part = dot(sixth, other);
      for (std::size_t row = 0; row < 6; ++row) sixth[row] -= part * other[row];
    }
    const double length = std::sqrt(dot(sixth, sixth));
    for (double& part : sixth) part /= length;
  }
  return sixth;
}

inline LeastSingularValue least_singular_value(const Jacobian& a, std::size_t n) {
  // The rotations of the columns of A are its right vectors: to rounding even where the singular
  // value is zero. So are the rotations of its rows, the left ones; where the columns give five of
  // these, the sixth is what is orthogonal to them.
  Jacobian columns = a;
  std::array<Joints, MAX_JOINTS> right;
  orthogonalise(columns, right, 6, n);
  const auto order = by_length(columns.data(), n);
  LeastSingularValue least;
  least.right = right[order[std::min<std::size_t>(6, n) - 1]];
  // What is not used must not count.
  for (std::size_t joint = n; joint < MAX_JOINTS; ++joint) least.right[joint] = 0.0;
  if (n >= 6) {
    std::array<Column, 5> others;
    for (std::size_t i = 0; i < 5; ++i) others[i] = columns[order[i]];
    least.left = sixth_direction(others);
  } else {
    std::array<Joints, 6> rows{};
    for (std::size_t row = 0; row < 6; ++row)
      for (std::size_t column = 0; column < n; ++column) rows[row][column] = a[column][row];
    std::array<Column, 6> left;
    orthogonalise(rows, left, n, 6);
    least.left = left[by_length(rows.data(), 6)[n - 1]];
  }
  double value = 0.0;
  for (std::size_t column = 0; column < n; ++column)
    value += dot(a[column], least.left) * least.right[column];
  if (value < 0.0)
    for (double& part : least.left) part = -part;
  least.value = std::abs(value);
  return least;
}

}  // namespace annik
