// Rotations, poses and twists.
//
// A pose is x, y, z [m] and a unit quaternion x, y, z, w. A twist is three linear numbers [m] and
// three angular ones [rad].

#pragma once

#include <algorithm>
#include <array>
#include <cmath>

namespace annik {

using Vector3 = std::array<double, 3>;
using Twist = std::array<double, 6>;
using Pose = std::array<double, 7>;

inline Vector3 operator+(const Vector3& a, const Vector3& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

inline Vector3 operator-(const Vector3& a, const Vector3& b) {
  return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
}

inline Vector3 operator*(double factor, const Vector3& a) {
  return {factor * a[0], factor * a[1], factor * a[2]};
}

inline double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}

inline double norm(const Vector3& a) { return std::sqrt(dot(a, a)); }

// A rotation matrix by its columns: the rotated axes.
struct Rotation {
  Vector3 x{1.0, 0.0, 0.0}, y{0.0, 1.0, 0.0}, z{0.0, 0.0, 1.0};

  Vector3 operator*(const Vector3& v) const { return v[0] * x + v[1] * y + v[2] * z; }
  Rotation operator*(const Rotation& other) const {
    return {*this * other.x, *this * other.y, *this * other.z};
  }
  Rotation inverse() const {
    return {{x[0], y[0], z[0]}, {x[1], y[1], z[1]}, {x[2], y[2], z[2]}};
  }
  Vector3 inverse_times(const Vector3& v) const { return {dot(x, v), dot(y, v), dot(z, v)}; }
  Rotation inverse_times(const Rotation& other) const {
    return {inverse_times(other.x), inverse_times(other.y), inverse_times(other.z)};
  }
};

struct Placement {
  Rotation rotation;
  Vector3 position{0.0, 0.0, 0.0};

  Placement operator*(const Placement& other) const {
    return {rotation * other.rotation, position + rotation * other.position};
  }
};

// The rotation by a unit quaternion x, y, z, w.
inline Rotation rotation_of(const double* quaternion) {
  const double x = quaternion[0], y = quaternion[1], z = quaternion[2], w = quaternion[3];
  return {{1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)},
          {2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)},
          {2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)}};
}

// The unit quaternion x, y, z, w, w >= 0, of a rotation: from the largest of its four numbers.
inline std::array<double, 4> quaternion_of(const Rotation& r) {
  const double xx = r.x[0], yy = r.y[1], zz = r.z[2];
  const std::array<double, 4> squares{1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz,
                                      1.0 + xx + yy + zz};
  const double xy = r.x[1] + r.y[0], xz = r.x[2] + r.z[0], yz = r.y[2] + r.z[1];
  const double wx = r.y[2] - r.z[1], wy = r.z[0] - r.x[2], wz = r.x[1] - r.y[0];
  std::array<double, 4> q;
  switch (std::max_element(squares.begin(), squares.end()) - squares.begin()) {
    case 0: q = {squares[0], xy, xz, wx}; break;
    case 1: q = {xy, squares[1], yz, wy}; break;
    case 2: q = {xz, yz, squares[2], wz}; break;
    default: q = {wx, wy, wz, squares[3]};
  }
  double length = std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  if (q[3] < 0.0) length = -length;
  for (double& part : q) part /= length;
  return q;
}

// Rodrigues' formula.
inline Rotation rotation_about(const Vector3& vector) {
  const double angle = norm(vector);
  const double half_sine = std::sin(0.5 * angle);
  const double factor = angle > 0.0 ? half_sine / angle : 0.5;
  const double quaternion[] = {factor * vector[0], factor * vector[1], factor * vector[2],
                               std::cos(0.5 * angle)};
  return rotation_of(quaternion);
}

// The rotation vector, its norm in [0, pi].
inline Vector3 rotation_vector(const Rotation& r) {
  const auto [x, y, z, w] = quaternion_of(r);
  const Vector3 axis{x, y, z};
  const double sine = norm(axis);
  // For small angles 2 atan2(sine, cosine) / sine is 2.
  return (sine > 0.0 ? 2.0 * std::atan2(sine, w) / sine : 2.0) * axis;
}

// The logarithm of SE(3): the constant twist that moves the identity to a placement.
inline Twist logarithm(const Placement& placement) {
  const Vector3 angular = rotation_vector(placement.rotation);
  const double angle = norm(angular);
  const double factor =
      angle < 1e-3 ? 1.0 / 12.0 + angle * angle / 720.0
                   : (1.0 - 0.5 * angle / std::tan(0.5 * angle)) / (angle * angle);
  const Vector3 turned = cross(angular, placement.position);
  const Vector3 linear = placement.position - 0.5 * turned + factor * cross(angular, turned);
  return {linear[0], linear[1], linear[2], angular[0], angular[1], angular[2]};
}

// The exponential of SE(3): the inverse of the logarithm, of a part of a twist.
inline Placement exponential(const Twist& twist, double part) {
  const Vector3 angular = part * Vector3{twist[3], twist[4], twist[5]};
  const Vector3 linear = part * Vector3{twist[0], twist[1], twist[2]};
  const double angle = norm(angular);
  const double first = angle < 1e-3 ? 0.5 - angle * angle / 24.0
                                    : (1.0 - std::cos(angle)) / (angle * angle);
  const double second = angle < 1e-3 ? 1.0 / 6.0 - angle * angle / 120.0
                                     : (angle - std::sin(angle)) / (angle * angle * angle);
  const Vector3 turned = cross(angular, linear);
  return {rotation_about(angular),
          linear + first * turned + second * cross(angular, turned)};
}

}  // namespace annik
