// The paper's gantry: six transmissions, eq. (1)-(4).

#pragma once

#include <array>
#include <cmath>
#include <utility>

#include "geometry.hpp"

namespace annik {

// x, y, z [m], roll, pitch, yaw [rad]; or drive angles [rad].
using Six = std::array<double, 6>;

inline Six six_from(const double* numbers) {
  Six six;
  std::copy_n(numbers, 6, six.begin());
  return six;
}

struct Bounds {
  Six lower{}, upper{};

  // Not those with a NaN.
  bool contain(const Six& numbers) const {
    bool inside = true;
    for (std::size_t i = 0; i < 6; ++i)
      inside = inside && lower[i] <= numbers[i] && numbers[i] <= upper[i];
    return inside;
  }
};

struct Gantry {
  Six ratio{}, offset{};

  // Of a checked pose; see annik_core.pose.roll_pitch_yaw.
  static Six task_coordinates(const double* pose) {
    const double x = pose[3], y = pose[4], z = pose[5], w = pose[6];
    const double half_sum = std::atan2(x + z, w - y), half_difference = std::atan2(z - x, w + y);
    const double turn = 6.283185307179586;
    const double pitch =
        2.0 * std::atan2(std::hypot(w + y, z - x), std::hypot(w - y, x + z)) - 0.25 * turn;
    return {pose[0], pose[1], pose[2], std::remainder(half_sum - half_difference, turn), pitch,
            std::remainder(half_sum + half_difference, turn)};
  }

  // Distance [m] and angle [rad] from the pose at drive angles to a target.
  std::pair<double, double> residuals(const Six& angles, const double* target) const {
    Six task;
    for (std::size_t i = 0; i < 6; ++i) task[i] = ratio[i] * angles[i] + offset[i];
    const double sr = std::sin(0.5 * task[3]), cr = std::cos(0.5 * task[3]);
    const double sp = std::sin(0.5 * task[4]), cp = std::cos(0.5 * task[4]);
    const double sy = std::sin(0.5 * task[5]), cy = std::cos(0.5 * task[5]);
    const double e = sr * cp * cy - cr * sp * sy, f = cr * sp * cy + sr * cp * sy;
    const double g = cr * cp * sy - sr * sp * cy, h = cr * cp * cy + sr * sp * sy;
    const double a = target[3], b = target[4], c = target[5], d = target[6];
    // The quaternion of the target times the conjugate of that which is reached.
    const Vector3 vector{a * h - d * e - b * g + c * f, b * h - d * f - c * e + a * g,
                         c * h - d * g - a * f + b * e};
    const double scalar = a * e + b * f + c * g + d * h;
    const Vector3 way = Vector3{target[0], target[1], target[2]} - Vector3{task[0], task[1], task[2]};
    return {norm(way), 2.0 * std::atan2(norm(vector), std::abs(scalar))};
  }
};

}  // namespace annik
