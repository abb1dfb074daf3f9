// Refines joint positions on the forward kinematics: annik_core/solver/refinement.py in C++, step
// by step, where every decision is explained.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "chain.hpp"

namespace annik {

struct Refined {
  Joints joint_positions;
  double position_residual, orientation_residual;
  int newton_steps;
  bool converged;
};

class Refinement {
 public:
  Chain chain;
  Joints lower{}, upper{};
  std::vector<std::size_t> free;  // joints that are not locked
  int max_newton_steps = 10;
  double tolerance = 5e-7;

  Refined refine(const Joints& start, const Placement& target) const {
    const Joints begin = projected(start);
    const Refined found = search(begin, target, max_newton_steps);
    if (std::isnan(found.position_residual) || found.converged ||
        found.newton_steps == max_newton_steps)
      return found;
    return beyond_singularities(begin, target, found);
  }

  Joints projected(Joints positions) const {
    // NaN stays NaN.
    for (std::size_t joint = 0; joint < chain.size(); ++joint) {
      if (positions[joint] < lower[joint]) positions[joint] = lower[joint];
      if (positions[joint] > upper[joint]) positions[joint] = upper[joint];
    }
    return positions;
  }

  bool same(const Joints& a, const Joints& b) const {
    return std::equal(a.begin(), a.begin() + chain.size(), b.begin());
  }

  Refined search(const Joints& start, const Placement& target, int most) const {
    Joints positions = start;
    double last = std::numeric_limits<double>::infinity();
    int steps = 0;
    Linearisation linear;
    while (true) {
      chain.linearise(positions, target, linear);
      const double squared = linear.squared();
      const bool stuck = steps >= PATIENCE && squared > STUCK * last;
      // Not '<=', so that NaN ends it too.
      if (!(squared > tolerance * tolerance) || steps >= most || stuck) break;
      if (!step(linear, squared, positions)) break;
      last = squared;
      ++steps;
    }
    const double position = linear.position_residual();
    const double orientation = linear.orientation_residual();
    return {positions, position, orientation, steps,
            position <= tolerance && orientation <= tolerance};
  }

  // One step inside the box. False if it can't be computed; then the positions stay.
  bool step(const Linearisation& linear, double squared, Joints& positions) const {
    Jacobian columns;
    for (std::size_t i = 0; i < free.size(); ++i) columns[i] = linear.jacobian[free[i]];
    const double damping = DAMPING * squared + LEAST_DAMPING;
    Joints motion;
    if (!(squared < NEAR && short_newton_step(columns, linear.twist, motion)) &&
        !damped_least_squares(columns, linear.twist, free.size(), damping, motion))
      return false;
    Joints candidate = positions;
    bool inside = true;
    for (std::size_t i = 0; i < free.size(); ++i) {
      candidate[free[i]] += motion[i];
      inside = inside && lower[free[i]] <= candidate[free[i]] && candidate[free[i]] <= upper[free[i]];
    }
    if (!inside && !stop_at_bounds(linear, damping, positions, candidate)) return false;
    positions = candidate;
    return true;
  }

  // Where the nearest singularity is: a unit vector of the free joints, and how far along it.
  struct Direction {
    Joints unit{};
    double distance = 0.0;
  };

  Joints moved(Joints positions, const Direction& direction, double length) const {
    for (std::size_t i = 0; i < free.size(); ++i)
      positions[free[i]] += length * direction.unit[i];
    return positions;
  }

  // Distance 0 if there is none.
  Direction from_singularity(const Joints& positions, const Placement& target) const {
    const auto columns_at = [&](const Joints& at) {
      Linearisation linear;
      chain.linearise(at, target, linear);
      Jacobian columns;
      for (std::size_t i = 0; i < free.size(); ++i) columns[i] = linear.jacobian[free[i]];
      return columns;
    };
    const LeastSingularValue least = least_singular_value(columns_at(positions), free.size());
    Direction along{least.right, 0.0};
    const Jacobian ahead = columns_at(moved(positions, along, STEP));
    const Jacobian behind = columns_at(moved(positions, along, -STEP));
    double derivative = 0.0;
    for (std::size_t i = 0; i < free.size(); ++i)
      derivative += (dot(ahead[i], least.left) - dot(behind[i], least.left)) * least.right[i];
    derivative /= 2.0 * STEP;
    if (std::abs(derivative) < LEAST_DERIVATIVE) return along;
    if (derivative > 0.0)
      for (double& part : along.unit) part = -part;
    along.distance = least.value / std::abs(derivative);
    return along;
  }

 private:
  static constexpr double DAMPING = 0.01, LEAST_DAMPING = 1e-12, NEAR = 0.01, SHORT = 0.04;
  static constexpr double STUCK = 0.5, SAME = 1e-9;
  static constexpr int PATIENCE = 3;
  static constexpr double STEP = 1e-4, DISTANCES = 3.0, FARTHEST = 1.5, LEAST_DERIVATIVE = 1e-9;

  bool short_newton_step(const Jacobian& columns, const Twist& twist, Joints& motion) const {
    if (free.size() != 6 || !solve_six(columns, twist, motion)) return false;
    double length = 0.0;
    for (std::size_t i = 0; i < 6; ++i) length += motion[i] * motion[i];
    return length < SHORT;
  }

  // Joints that would leave the box stop at their bounds, and the others are solved for again.
  bool stop_at_bounds(const Linearisation& linear, double damping, const Joints& positions,
                      Joints& candidate) const {
    std::vector<std::size_t> moving = free;
    Twist twist = linear.twist;
    for (std::size_t round = 0; round < free.size(); ++round) {
      std::vector<std::size_t> inside;
      for (std::size_t joint : moving) {
        const double wanted = candidate[joint];
        if (!(wanted < lower[joint] || wanted > upper[joint])) {
          inside.push_back(joint);
          continue;
        }
        candidate[joint] = std::min(std::max(wanted, lower[joint]), upper[joint]);
        for (std::size_t row = 0; row < 6; ++row)
          twist[row] -= linear.jacobian[joint][row] * (candidate[joint] - positions[joint]);
      }
      if (inside.size() == moving.size() || inside.empty()) break;
      moving = inside;
      Jacobian columns;
      for (std::size_t i = 0; i < moving.size(); ++i) columns[i] = linear.jacobian[moving[i]];
      Joints motion;
      if (!damped_least_squares(columns, twist, moving.size(), damping, motion)) return false;
      for (std::size_t i = 0; i < moving.size(); ++i)
        candidate[moving[i]] = positions[moving[i]] + motion[i];
    }
    return true;
  }

  // Search anew beyond the nearest singularities, with the steps that are left.
  Refined beyond_singularities(const Joints& begin, const Placement& target, Refined first) const {
    struct Start {
      Joints positions;
      double distance;
    };
    std::vector<Joints> known{begin, first.joint_positions};
    std::vector<Start> starts;
    Linearisation linear;
    for (const Joints& from : {begin, first.joint_positions}) {
      const Joints beyond = projected(reflected(from, target));
      // Where there is no singularity it would be the same search again.
      const auto near = [](double x, double y) { return std::abs(x - y) <= SAME; };
      if (std::any_of(known.begin(), known.end(), [&](const Joints& other) {
            return std::equal(other.begin(), other.begin() + chain.size(), beyond.begin(), near);
          }))
        continue;
      known.push_back(beyond);
      chain.linearise(beyond, target, linear);
      starts.push_back({beyond, linear.squared()});
    }
    std::stable_sort(starts.begin(), starts.end(), [](const Start& a, const Start& b) {
      return a.distance < b.distance;
    });
    for (const Start& start : starts) {
      const int left = max_newton_steps - first.newton_steps;
      Refined found = search(start.positions, target, left);
      first.newton_steps += found.newton_steps;
      found.newton_steps = first.newton_steps;
      if (found.converged) return found;
    }
    // Without convergence the first search is reported.
    return first;
  }

  // Joint positions beyond the nearest singularity; the same if there is none.
  Joints reflected(const Joints& positions, const Placement& target) const {
    const Direction away = from_singularity(positions, target);
    return moved(positions, away, std::min(FARTHEST, DISTANCES * away.distance));
  }
};

}  // namespace annik
