// Joint positions of a whole robot: annik_core/solver/search.py in C++, where it is explained.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "nearest.hpp"
#include "refinement.hpp"

namespace annik {

// What is left of a pose without the motions of a first and a last joint, which find their own
// positions: they turn it about, or move it along, an axis that does not depend on the others.
class ReducedPose {
 public:
  ReducedPose() = default;
  ReducedPose(const Chain& chain, double length)
      : base_(chain.joints.front().placement),
        tool_(chain.end_effector),
        first_turns_(chain.joints.front().turns),
        last_turns_(chain.size() > 1 && chain.joints.back().turns),
        last_joint_(chain.size() - 1),
        scale_(1.0 / length) {}

  std::size_t width() const { return last_turns_ ? 6 : 12; }

  // Whether a target finds the position of a joint, by :meth:`align`.
  bool finds(std::size_t joint) const {
    return joint == 0 || (joint == last_joint_ && last_turns_);
  }

  // Position and axes of the last joint's frame, scaled; without the first joint's motion.
  Features of(const Placement& target) const {
    const Placement last = last_frame(target);
    Vector3 position = scale_ * last.position;
    double cosine = 1.0, sine = 0.0;
    if (first_turns_) {
      // In the half plane of the position; close to the axis that plane means little.
      const double radius = std::hypot(position[0], position[1], SOFT);
      cosine = position[0] / radius, sine = position[1] / radius;
      position = {std::hypot(position[0], position[1]), 0.0, position[2]};
    } else {
      position[2] = 0.0;
    }
    Features features{position[0], position[1], position[2]};
    std::size_t at = 3;
    const auto put = [&](const Vector3& v) {
      features[at++] = cosine * v[0] + sine * v[1];
      features[at++] = cosine * v[1] - sine * v[0];
      features[at++] = v[2];
    };
    put(last.rotation.z);
    if (!last_turns_) put(last.rotation.x), put(last.rotation.y);
    return features;
  }

  // Moves the first and last joint of joint positions that reach ``reached`` towards ``target``.
  void align(const Placement& reached, const Placement& target, Joints& positions) const {
    Placement from = last_frame(reached);
    const Placement to = last_frame(target);
    if (first_turns_) {
      double cosine = 0.0, sine = 0.0;
      const auto add = [&](const Vector3& a, const Vector3& b, double weight) {
        cosine += weight * (a[0] * b[0] + a[1] * b[1]);
        sine += weight * (a[0] * b[1] - a[1] * b[0]);
      };
      add(from.position, to.position, scale_ * scale_);
      add(from.rotation.z, to.rotation.z, 1.0);
      if (!last_turns_) add(from.rotation.x, to.rotation.x, 1.0);
      const double angle = std::atan2(sine, cosine);
      positions[0] += angle;
      from = Placement{rotation_about({0.0, 0.0, angle}), {0.0, 0.0, 0.0}} * from;
    } else {
      positions[0] += to.position[2] - from.position[2];
    }
    if (last_turns_) {
      const Vector3 x = from.rotation.inverse_times(to.rotation.x);
      const Vector3 y = from.rotation.inverse_times(to.rotation.y);
      positions[last_joint_] += std::atan2(x[1] - y[0], x[0] + y[1]);
    }
  }

 private:
  static constexpr double SOFT = 0.05;

  // Of the last joint, in the first one's.
  Placement last_frame(const Placement& target) const {
    const Rotation rotation = target.rotation * tool_.rotation.inverse();
    const Vector3 position = target.position - rotation * tool_.position;
    return {base_.rotation.inverse_times(rotation),
            base_.rotation.inverse_times(position - base_.position)};
  }

  Placement base_, tool_;
  bool first_turns_ = true, last_turns_ = true;
  std::size_t last_joint_ = 0;
  double scale_ = 1.0;
};

struct Solution {
  Joints joint_positions;
  double position_residual, orientation_residual;
  bool allowed;  // within the limits
  Refinement::Direction singularity;
  double radius;  // within which there is no other
};

// Where a search ended. ``effort``: starts or steps that it took.
struct Found {
  Joints joint_positions;
  double position_residual, orientation_residual;
  std::size_t effort;
  bool found;
};

class Search {
 public:
  // ``refinement``: its bounds are the joint limits. ``length``: that counts as much as a radian.
  Search(Refinement refinement, std::size_t examples, double length)
      : within_(refinement),
        around_(std::move(refinement)),
        drawn_(examples),
        length_(length),
        reduced_(within_.chain, length) {
    for (const std::size_t joint : around_.free) {
      double &low = around_.lower[joint], &high = around_.upper[joint];
      const bool round = around_.free.size() <= 6 || high - low >= FULL_TURN;
      if (turns(joint) && round) low = -INFINITY, high = INFINITY;
    }
    std::size_t base = 1;
    for (const std::size_t joint : within_.free) {
      if (reduced_.finds(joint)) continue;
      const auto divides = [&](const auto& other) { return base % other.second == 0; };
      do ++base; while (std::any_of(spread_.begin(), spread_.end(), divides));
      spread_.push_back({joint, base});
    }
    std::vector<Features> points;
    for (std::size_t index = 0; index < examples; ++index) {
      const Joints example = spread(index);
      const Placement reached = within_.chain.pose(example);
      const Features features = reduced_.of(reached);
      if (!finite(features)) continue;
      examples_.push_back(example);
      reached_.push_back(reached);
      points.push_back(features);
    }
    nearest_ = NearestPoints(std::move(points), reduced_.width());
  }

  // The first solution that is found within the limits.
  Found first(const Placement& target, const std::vector<Joints>& starts, std::size_t most) const {
    std::vector<Solution> found;
    std::size_t taken = 0;
    run(target, starts, most, 0.0, true, found, taken);
    for (const Solution& one : found)
      if (one.allowed)
        return {one.joint_positions, one.position_residual, one.orientation_residual, taken, true};
    return {{}, 0.0, 0.0, taken, false};
  }

  // All solutions. ``spacing``: of redundant joints, the distance between solutions.
  std::vector<Solution> all(const Placement& target, const std::vector<Joints>& starts,
                            std::size_t most, double spacing, std::size_t& taken) const {
    std::vector<Solution> found;
    run(target, starts, most, within_.free.size() > 6 ? spacing : 0.0, false, found, taken);
    const auto outside = [](const Solution& solution) { return !solution.allowed; };
    found.erase(std::remove_if(found.begin(), found.end(), outside), found.end());
    return found;
  }

  // Solutions in the turns that are nearest to joint positions, those nearest to them first, by the
  // joint that moves most.
  void order(std::vector<Solution>& found, const Placement& target, const Joints& near) const {
    for (Solution& solution : found) {
      Joints& at = solution.joint_positions;
      const Joints before = at;
      for (const std::size_t joint : within_.free) {
        if (!turns(joint)) continue;
        const double low = std::ceil((within_.lower[joint] - at[joint]) / FULL_TURN);
        const double high = std::floor((within_.upper[joint] - at[joint]) / FULL_TURN);
        const double wanted = std::nearbyint((near[joint] - at[joint]) / FULL_TURN);
        at[joint] += FULL_TURN * std::clamp(wanted, std::min(low, 0.0), std::max(high, 0.0));
      }
      if (!within_.same(at, before)) measure(solution, target);
    }
    const auto away = [&](const Solution& solution) {
      double most = 0.0;
      for (std::size_t joint = 0; joint < within_.chain.size(); ++joint)
        most = std::max(most, std::abs(solution.joint_positions[joint] - near[joint]));
      return most;
    };
    std::stable_sort(found.begin(), found.end(), [&](const Solution& a, const Solution& b) {
      return away(a) < away(b);
    });
  }

  // Along the straight line from the pose at ``previous``, as far as the joints move steadily, and
  // to a near target not much further than the line needs.
  Found follow(const Joints& previous, const Placement& target) const {
    const Placement from = within_.chain.pose(previous);
    Linearisation linear;
    within_.chain.linearise(previous, target, linear);
    const Twist way = linear.twist;
    Joints positions = previous;
    std::size_t steps = 0;
    double done = 0.0, part = 1.0;
    for (int tries = 0; tries < MOST_PARTS; ++tries) {
      const bool last = done + part >= 1.0;
      const Placement goal = last ? target : from * exponential(way, done + part);
      within_.chain.linearise(positions, goal, linear);
      Joints predicted = positions;
      if (!within_.step(linear, linear.squared(), predicted)) break;
      // At a singularity, what rounding leaves of an error would turn some joints far.
      const bool reached = linear.squared() <= within_.tolerance * within_.tolerance;
      if (reached && longest(positions, predicted) > ROUNDING) predicted = positions;
      avoid_limits(linear, positions, predicted);
      const Refined refined = within_.search(predicted, goal, within_.max_newton_steps);
      steps += refined.newton_steps + 1;
      if (refined.converged && steady(positions, predicted, refined.joint_positions)) {
        positions = refined.joint_positions;
        if (last && leaps(previous, from, positions, target)) {
          positions = previous;
          break;
        }
        if (last)
          return {positions, refined.position_residual, refined.orientation_residual, steps, true};
        done += part;
        part *= 2.0;
      } else {
        part *= 0.5;
        if (part < LEAST_PART) break;
      }
    }
    within_.chain.linearise(positions, target, linear);
    return {positions, linear.position_residual(), linear.orientation_residual(), steps, false};
  }

  // Whether the straight joint motion between two joint positions passes no singularity. It may
  // begin or end at one: branches meet there.
  bool same_branch(const Joints& a, const Joints& b) const {
    if (within_.free.size() != 6) return true;
    double least = 0.0, most = 0.0;
    for (int i = 0; i <= SAMPLES; ++i) {
      Joints between = a;
      for (const std::size_t joint : within_.free)
        between[joint] += i * (b[joint] - a[joint]) / SAMPLES;
      Jacobian jacobian, columns;
      within_.chain.jacobian(between, jacobian);
      for (std::size_t k = 0; k < 6; ++k) columns[k] = jacobian[within_.free[k]];
      Column none{};
      const double determinant = eliminate_six(columns, none);
      least = std::min(least, determinant);
      most = std::max(most, determinant);
    }
    return std::min(-least, most) <= SINGULAR * std::max(-least, most);
  }

 private:
  static constexpr std::size_t FEW = 8, NEAREST = 192, BATCH = 8;
  static constexpr int IDLE_BATCHES = 2, ODD_BATCHES = 16, MOST_STEPS = 20, PATIENCE = 6;
  static constexpr double FAR = 1.0, LEAST_RADIUS = 2e-4, GREATEST_RADIUS = 0.05;
  static constexpr double APART = 0.8, FINE = 1e-9, FOUND = 1e-6, EDGE = 1e-7;
  static constexpr int MOST_PARTS = 64, SAMPLES = 16;
  static constexpr double LEAST_PART = 1.0 / 512.0, STEADY = 0.5, SMALL = 1e-3,
                          LONG = 0.5;
  static constexpr double NEAR = 0.2, LEAP = 1.5, ROUNDING = 1e-4, SINGULAR = 1e-6;
  static constexpr double MARGIN = 0.1, AVOID = 0.4, LEAST_DAMPING = 1e-9;

  // Redundant joints near a limit are moved away from it while the others move, without a motion
  // of the end effector: a joint that stops at its limit would make the others move at once.
  void avoid_limits(const Linearisation& linear, const Joints& from, Joints& predicted) const {
    const std::vector<std::size_t>& free = within_.free;
    if (free.size() <= 6) return;
    Joints away{};
    double motion = 0.0, most = 0.0;
    for (std::size_t i = 0; i < free.size(); ++i) {
      const std::size_t joint = free[i];
      const double low = within_.lower[joint], high = within_.upper[joint];
      const double zone = MARGIN * std::min(high - low, FULL_TURN);
      away[i] = std::max(0.0, 1.0 - (predicted[joint] - low) / zone) -
                std::max(0.0, 1.0 - (high - predicted[joint]) / zone);
      motion = std::max(motion, std::abs(predicted[joint] - from[joint]));
    }
    // Less what moves the end effector.
    Jacobian columns;
    Twist moved{};
    for (std::size_t i = 0; i < free.size(); ++i) {
      columns[i] = linear.jacobian[free[i]];
      for (std::size_t row = 0; row < 6; ++row) moved[row] += columns[i][row] * away[i];
    }
    Joints back;
    if (!damped_least_squares(columns, moved, free.size(), LEAST_DAMPING, back)) return;
    for (std::size_t i = 0; i < free.size(); ++i) most = std::max(most, std::abs(away[i] -= back[i]));
    const double share = AVOID * motion * std::min(1.0, most) / std::max(most, 1e-9);
    for (std::size_t i = 0; i < free.size(); ++i) predicted[free[i]] += share * away[i];
    predicted = within_.projected(predicted);
  }

  // Whether a joint moved much further to a near target than the first order says at both ends.
  bool leaps(const Joints& previous, const Placement& from, const Joints& to,
             const Placement& target) const {
    const double motion = longest(previous, to);
    Linearisation linear;
    const auto needed = [&](const Joints& at, const Placement& goal) {
      Joints moved = at;
      within_.chain.linearise(at, goal, linear);
      return within_.step(linear, linear.squared(), moved) ? longest(at, moved) : 0.0;
    };
    const double first = needed(previous, target);
    if (linear.position_residual() / length_ + linear.orientation_residual() > NEAR) return false;
    return motion > LEAP * first + ROUNDING && motion > LEAP * needed(to, from) + ROUNDING;
  }

  double longest(const Joints& a, const Joints& b) const {
    double motion = 0.0;
    for (const std::size_t joint : within_.free)
      motion = std::max(motion, std::abs(a[joint] - b[joint]));
    return motion;
  }

  bool turns(std::size_t joint) const { return within_.chain.joints[joint].turns; }

  void run(const Placement& target, const std::vector<Joints>& starts, std::size_t most,
           double spacing, bool one, std::vector<Solution>& found, std::size_t& taken) const {
    taken = 0;
    // True if that was enough.
    const auto enough = [&] {
      return taken >= most || (one && !found.empty() && found.back().allowed);
    };
    const auto try_start = [&](const Joints& start) {
      ++taken;
      descend(start, target, spacing, one, found);
      return enough();
    };
    for (const Joints& start : starts)
      if (try_start(start)) return;
    std::vector<std::pair<double, std::size_t>> near;
    const Features features = reduced_.of(target);
    if (!finite(features)) return;
    // A few are enough for one solution, and found sooner.
    if (one) {
      nearest_.find(features, FEW, near);
      for (const auto& [squared, index] : near)
        if (try_start(from_example(index, target))) return;
    }
    nearest_.find(features, NEAREST, near);
    // The first and the last joint follow from the others.
    std::vector<const Joints*> tried;
    for (const auto& [squared, index] : near) {
      const Joints& example = examples_[index];
      const auto close = [&](const Joints* other) {
        for (std::size_t joint = 1; joint + 1 < within_.chain.size(); ++joint)
          if (std::abs(example[joint] - (*other)[joint]) > APART) return false;
        return true;
      };
      if (std::any_of(tried.begin(), tried.end(), close)) continue;
      tried.push_back(&example);
      if (try_start(from_example(index, target))) return;
    }
    std::size_t reflected = 0;
    const auto reflect = [&] {
      for (; reflected < found.size(); ++reflected) {
        const Solution from = found[reflected];
        const double distance = from.singularity.distance;
        if (distance > 0.0 && distance < FAR &&
            try_start(within_.moved(from.joint_positions, from.singularity, 3.0 * distance)))
          return true;
      }
      return false;
    };
    if (reflect()) return;
    std::size_t index = drawn_;
    // With six joints, solutions come in pairs, but for those at a singularity.
    const auto most_idle = [&] {
      return within_.free.size() == 6 && found.size() % 2 ? ODD_BATCHES : IDLE_BATCHES;
    };
    for (int idle = 0; idle < most_idle();) {
      const std::size_t before = found.size();
      for (std::size_t i = 0; i < BATCH; ++i)
        if (try_start(towards(spread(index++), target))) return;
      if (reflect()) return;
      idle = found.size() > before || (one && taken < most) ? 0 : idle + 1;
    }
  }

  // With the first and last joint moved so that the pose is nearer to the target.
  Joints towards(Joints positions, const Placement& target) const {
    reduced_.align(within_.chain.pose(positions), target, positions);
    return positions;
  }

  Joints from_example(std::size_t index, const Placement& target) const {
    Joints start = examples_[index];
    reduced_.align(reached_[index], target, start);
    return start;
  }

  // Newton's method from one start, to a solution that is not known; with ``one``, it may end the
  // search.
  void descend(const Joints& start, const Placement& target, double spacing, bool one,
               std::vector<Solution>& found) const {
    const auto known = [&](const Joints& at) {
      return std::any_of(found.begin(), found.end(), [&](const Solution& solution) {
        return near(at, solution.joint_positions, std::max(spacing, solution.radius));
      });
    };
    Joints positions = around_.projected(start);
    if (known(positions)) return;
    double last = INFINITY;
    Linearisation linear;
    for (int steps = 0;; ++steps) {
      around_.chain.linearise(positions, target, linear);
      const double squared = linear.squared();
      // Rounding may keep it above what is fine.
      const bool at_rest = squared < FOUND * FOUND && squared > 0.25 * last;
      if (!(squared > FINE * FINE) || at_rest) break;
      if (steps >= MOST_STEPS || (steps >= PATIENCE && squared > 0.5 * last)) return;
      if (!around_.step(linear, squared, positions) || known(positions)) return;
      last = squared;
    }
    if (!(linear.squared() < FOUND * FOUND) || known(positions)) return;
    Solution solution{in_turn(positions), 0.0, 0.0, true, {}, GREATEST_RADIUS};
    Joints& at = solution.joint_positions;
    // Rounding takes every other solution at a limit beyond it.
    const Joints inside = within_.projected(at);
    solution.allowed = longest(inside, at) <= EDGE;
    if (solution.allowed) at = inside;
    measure(solution, target);
    if (!one || !solution.allowed) {
      solution.singularity = around_.from_singularity(at, target);
      const double part = 0.25 * solution.singularity.distance;
      if (part > 0.0) solution.radius = std::clamp(part, LEAST_RADIUS, GREATEST_RADIUS);
    }
    found.push_back(solution);
  }

  // The residuals of exactly the joint positions that are returned.
  void measure(Solution& solution, const Placement& target) const {
    Linearisation linear;
    within_.chain.linearise(solution.joint_positions, target, linear);
    solution.position_residual = linear.position_residual();
    solution.orientation_residual = linear.orientation_residual();
  }

  // Turning joints within half a turn of the middle of their limits.
  Joints in_turn(Joints positions) const {
    for (const std::size_t joint : within_.free) {
      if (!turns(joint)) continue;
      const double middle = 0.5 * (within_.lower[joint] + within_.upper[joint]);
      positions[joint] -= FULL_TURN * std::nearbyint((positions[joint] - middle) / FULL_TURN);
    }
    return positions;
  }

  bool near(const Joints& a, const Joints& b, double distance) const {
    for (const std::size_t joint : within_.free) {
      double away = std::abs(a[joint] - b[joint]);
      if (away <= distance) continue;
      // Most are less than a turn apart, and need no rounding.
      if (!turns(joint) || away < FULL_TURN - distance) return false;
      away -= FULL_TURN * std::nearbyint(away / FULL_TURN);
      if (std::abs(away) > distance) return false;
    }
    return true;
  }

  // Whether Newton's method ended near its first step, which was not long.
  bool steady(const Joints& from, const Joints& predicted, const Joints& to) const {
    double motion = 0.0, correction = 0.0;
    for (const std::size_t joint : within_.free) {
      motion = std::max(motion, std::abs(predicted[joint] - from[joint]));
      correction = std::max(correction, std::abs(to[joint] - predicted[joint]));
    }
    return motion <= LONG && correction <= STEADY * motion + SMALL;
  }

  // The points of a Halton sequence within the limits, or in the turn in their middle, where the
  // joints stay that a target finds by itself.
  Joints spread(std::size_t index) const {
    Joints result{};
    for (std::size_t joint = 0; joint < within_.chain.size(); ++joint)
      result[joint] = 0.5 * (within_.lower[joint] + within_.upper[joint]);
    for (const auto& [joint, base] : spread_) {
      double digits = 0.0, scale = 1.0;
      for (std::size_t rest = index + 1; rest > 0; rest /= base) {
        digits = digits * base + rest % base;
        scale *= base;
      }
      const double width = within_.upper[joint] - within_.lower[joint];
      result[joint] += (digits / scale - 0.5) * (turns(joint) ? std::min(width, FULL_TURN) : width);
    }
    return result;
  }

  Refinement within_, around_;  // with the limits; turning joints without them
  std::size_t drawn_;  // points of the sequence that are examples
  double length_;      // that counts as much as a radian
  std::vector<Joints> examples_;
  std::vector<Placement> reached_;
  ReducedPose reduced_;
  std::vector<std::pair<std::size_t, std::size_t>> spread_;  // joints, and a prime number each
  NearestPoints nearest_;
};

}  // namespace annik
