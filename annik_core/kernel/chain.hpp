// Forward kinematics of a serial chain, with the corrections of a calibrated robot.

#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "geometry.hpp"
#include "linear_algebra.hpp"

namespace annik {

constexpr double FULL_TURN = 6.283185307179586476925286766559;

// A joint turns about or moves along the z axis of its frame.
struct Joint {
  Placement placement;  // in the frame of the joint before
  bool turns = true;
};

// actual = q + sum of output * tanh(input * x + bias), x = (q - centre) / half_width.
struct JointNetworks {
  std::size_t hidden = 0;
  std::vector<double> input, bias, output;  // joint by joint
};

// actual = q + sum over orders k of sines * sin(k frequency q) + cosines * cos(k frequency q).
struct JointHarmonics {
  std::size_t orders = 0;
  Joints frequencies{};
  std::vector<double> sines, cosines;  // order by order
};

// Turns of the joints of a nominal chain under the weight of what follows them.
struct Deflection {
  std::vector<Joint> joints;
  Placement end_effector;
  Vector3 gravity{};
  std::vector<double> compliances;  // joint by joint, of the places after it
};

// motion = output tanh(input x + bias), a twist in the end effector's frame.
struct PoseNetwork {
  std::size_t hidden = 0;
  std::vector<double> input, bias, output;  // unit by unit: joints, one, six
};

// A point of the unit circle.
struct Phase {
  double cosine, sine;

  Phase operator*(const Phase& other) const {
    return {cosine * other.cosine - sine * other.sine, sine * other.cosine + cosine * other.sine};
  }
};

inline Phase phase_at(double angle) { return {std::cos(angle), std::sin(angle)}; }

using Phases = std::array<Phase, MAX_JOINTS>;

// motion = cosines cos(waves q) + sines sin(waves q), a twist in the end effector's frame. The
// phase of a wave is the product of those of single joints, which the waves share.
struct PoseHarmonics {
  struct Single {
    std::size_t joint;
    double frequency;  // > 0
  };
  struct Factor {
    std::size_t single;
    double direction;  // 1 or -1
  };
  struct Wave {
    std::size_t end;  // of its factors
    Twist cosines, sines;
  };
  std::vector<Single> singles;
  std::vector<Factor> factors;
  std::vector<Wave> waves;

  // ``frequencies``: of all joints; ``cosines`` and ``sines``: six numbers each.
  void add(const std::vector<double>& frequencies, const double* cosines, const double* sines) {
    for (std::size_t joint = 0; joint < frequencies.size(); ++joint)
      if (frequencies[joint] != 0.0)
        factors.push_back({number_of(joint, std::abs(frequencies[joint])),
                           frequencies[joint] > 0.0 ? 1.0 : -1.0});
    Wave wave{factors.size(), {}, {}};
    std::copy(cosines, cosines + 6, wave.cosines.begin());
    std::copy(sines, sines + 6, wave.sines.begin());
    waves.push_back(wave);
  }

 private:
  std::size_t number_of(std::size_t joint, double frequency) {
    std::size_t number = 0;
    while (number < singles.size() &&
           (singles[number].joint != joint || singles[number].frequency != frequency))
      ++number;
    if (number == singles.size()) singles.push_back({joint, frequency});
    return number;
  }
};

// Of joint positions to the box in which corrections are known, [-1, 1].
struct Scaling {
  Joints centre{}, half_width{};
};

// Error to a target and its derivative, in the axes of the end effector's frame.
struct Linearisation {
  Twist twist;
  Jacobian jacobian;
  Vector3 displacement;

  double squared() const { return dot(twist, twist); }
  double position_residual() const { return norm(displacement); }
  double orientation_residual() const { return norm({twist[3], twist[4], twist[5]}); }
};

class Chain {
 public:
  std::vector<Joint> joints;
  Placement end_effector;  // in the frame of the last joint
  std::optional<JointHarmonics> joint_harmonics;
  std::optional<JointNetworks> joint_networks;
  std::optional<Deflection> deflection;
  std::optional<PoseNetwork> pose_network;
  std::optional<PoseHarmonics> pose_harmonics;
  Scaling joint_scaling, pose_scaling;
  // Joints whose corrections are known in one turn only, around these centres.
  std::vector<std::size_t> wrapped;
  Joints wrap_centre{};

  std::size_t size() const { return joints.size(); }

  Placement pose(const Joints& commanded) const {
    const Joints inside = in_one_turn(commanded);
    const Phases phases = phases_of(inside);
    Derivatives derivatives;
    const Placement plain = end_of(actual(inside, phases, derivatives), nullptr);
    return moves_end() ? plain * motion(inside, phases) : plain;
  }

  // In the axes of the base frame, as pose() has its position, but without the derivative of the
  // end effector's motion, which is a thousand times smaller.
  void jacobian(const Joints& commanded, Jacobian& result) const {
    const Joints inside = in_one_turn(commanded);
    Derivatives derivatives;
    const Joints positions = actual(inside, phases_of(inside), derivatives);
    to_columns(end_of(positions, &result), derivatives, result);
  }

  void linearise(const Joints& commanded, const Placement& target, Linearisation& result) const {
    const Joints inside = in_one_turn(commanded);
    const Phases phases = phases_of(inside);
    Derivatives derivatives;
    const Joints positions = actual(inside, phases, derivatives);
    const Placement reached = end_of(positions, &result.jacobian);
    // The target is reached with the motion where the target moved back is reached without it.
    const Placement wanted = moves_end() ? moved_back(target, motion(inside, phases)) : target;
    const Rotation& axes = reached.rotation;
    result.displacement = axes.inverse_times(wanted.position - reached.position);
    result.twist = logarithm({axes.inverse_times(wanted.rotation), result.displacement});
    to_columns(reached, derivatives, result.jacobian);
    for (std::size_t joint = 0; joint < size(); ++joint) {
      Column& c = result.jacobian[joint];
      const Vector3 linear = axes.inverse_times(Vector3{c[0], c[1], c[2]});
      const Vector3 angular = axes.inverse_times(Vector3{c[3], c[4], c[5]});
      c = {linear[0], linear[1], linear[2], angular[0], angular[1], angular[2]};
    }
  }

 private:
  // Of the actual by the commanded joint positions: of each by its own, and what a deflection
  // adds, joint by joint.
  struct Derivatives {
    Joints own;
    std::array<Joints, MAX_JOINTS> deflections;
  };

  // Without corrections. ``axes``: z axis and origin of each joint, three numbers each.
  Placement end_of(const Joints& positions, Jacobian* axes) const {
    Phases phases;
    for (std::size_t joint = 0; joint < size(); ++joint)
      if (joints[joint].turns) phases[joint] = phase_at(positions[joint]);
    return end_of(joints, end_effector, positions, phases, axes);
  }

  static Placement end_of(const std::vector<Joint>& joints, const Placement& end_effector,
                          const Joints& positions, const Phases& phases, Jacobian* axes) {
    Placement frame;
    for (std::size_t joint = 0; joint < joints.size(); ++joint) {
      frame = frame * joints[joint].placement;
      Rotation& r = frame.rotation;
      if (axes)
        (*axes)[joint] = {r.z[0],           r.z[1],           r.z[2],
                          frame.position[0], frame.position[1], frame.position[2]};
      if (joints[joint].turns) {
        const auto [cosine, sine] = phases[joint];
        const Vector3 x = r.x;
        r.x = cosine * x + sine * r.y;
        r.y = cosine * r.y - sine * x;
      } else {
        frame.position = frame.position + positions[joint] * r.z;
      }
    }
    return frame * end_effector;
  }

  // From axes and origins to motions of the end effector per unit of commanded motion.
  void to_columns(const Placement& reached, const Derivatives& derivatives,
                  Jacobian& columns) const {
    for (std::size_t joint = 0; joint < size(); ++joint) {
      Column& c = columns[joint];
      const Vector3 axis{c[0], c[1], c[2]};
      const Vector3 lever = reached.position - Vector3{c[3], c[4], c[5]};
      const Vector3 linear = joints[joint].turns ? cross(axis, lever) : axis;
      const Vector3 angular = joints[joint].turns ? axis : Vector3{0.0, 0.0, 0.0};
      c = {linear[0], linear[1], linear[2], angular[0], angular[1], angular[2]};
    }
    const Jacobian plain = columns;
    for (std::size_t joint = 0; joint < size(); ++joint) {
      for (double& number : columns[joint]) number *= derivatives.own[joint];
      if (!deflection) continue;
      for (std::size_t other = 0; other < size(); ++other)
        for (std::size_t row = 0; row < 6; ++row)
          columns[joint][row] += derivatives.deflections[other][joint] * plain[other][row];
    }
  }

  Joints in_one_turn(Joints positions) const {
    for (std::size_t joint : wrapped)
      positions[joint] -=
          FULL_TURN * std::nearbyint((positions[joint] - wrap_centre[joint]) / FULL_TURN);
    return positions;
  }

  // Of turning joints, for the corrections that are periodic.
  Phases phases_of(const Joints& commanded) const {
    Phases phases;
    if (joint_harmonics || deflection || pose_harmonics)
      for (std::size_t joint = 0; joint < size(); ++joint)
        if (joints[joint].turns) phases[joint] = phase_at(commanded[joint]);
    return phases;
  }

  // Of a joint position times a frequency.
  Phase phase_of(std::size_t joint, double frequency, const Joints& commanded,
                 const Phases& phases) const {
    if (joints[joint].turns && frequency == 1.0) return phases[joint];
    if (joints[joint].turns && frequency == 2.0) return phases[joint] * phases[joint];
    return phase_at(frequency * commanded[joint]);
  }

  // Actual joint positions, and their derivatives by the commanded ones.
  Joints actual(const Joints& commanded, const Phases& phases, Derivatives& derivatives) const {
    Joints positions = commanded;
    derivatives.own.fill(1.0);
    if (joint_harmonics) add_harmonics(commanded, phases, positions, derivatives.own);
    if (joint_networks) add_networks(commanded, positions, derivatives.own);
    if (deflection) add_deflection(commanded, phases, positions, derivatives);
    return positions;
  }

  void add_harmonics(const Joints& commanded, const Phases& phases, Joints& positions,
                     Joints& derivatives) const {
    const JointHarmonics& harmonics = *joint_harmonics;
    const std::size_t count = size();
    Joints first_sines, first_cosines, sine, cosine, turns{}, slopes{};
    for (std::size_t joint = 0; joint < count; ++joint) {
      const Phase phase = phase_of(joint, harmonics.frequencies[joint], commanded, phases);
      first_sines[joint] = sine[joint] = phase.sine;
      first_cosines[joint] = cosine[joint] = phase.cosine;
    }
    // All joints of an order together: each waits for its order before.
    for (std::size_t order = 0; order < harmonics.orders; ++order) {
      const double* a = &harmonics.sines[order * count];
      const double* b = &harmonics.cosines[order * count];
      const double number = static_cast<double>(order + 1);
      for (std::size_t joint = 0; joint < count; ++joint) {
        const double s = sine[joint], c = cosine[joint];
        turns[joint] += a[joint] * s + b[joint] * c;
        slopes[joint] += number * (a[joint] * c - b[joint] * s);
        sine[joint] = s * first_cosines[joint] + c * first_sines[joint];
        cosine[joint] = c * first_cosines[joint] - s * first_sines[joint];
      }
    }
    for (std::size_t joint = 0; joint < count; ++joint) {
      positions[joint] += turns[joint];
      derivatives[joint] += harmonics.frequencies[joint] * slopes[joint];
    }
  }

  void add_networks(const Joints& commanded, Joints& positions, Joints& derivatives) const {
    const JointNetworks& network = *joint_networks;
    for (std::size_t joint = 0; joint < size(); ++joint) {
      const double half_width = joint_scaling.half_width[joint];
      const double scaled = (commanded[joint] - joint_scaling.centre[joint]) / half_width;
      const std::size_t begin = joint * network.hidden;
      for (std::size_t unit = begin; unit < begin + network.hidden; ++unit) {
        const double activation = std::tanh(network.input[unit] * scaled + network.bias[unit]);
        positions[joint] += network.output[unit] * activation;
        derivatives[joint] += network.output[unit] * network.input[unit] / half_width *
                              (1.0 - activation * activation);
      }
    }
  }

  // By sums of the places after each joint, weighted by their compliances.
  void add_deflection(const Joints& commanded, const Phases& phases, Joints& positions,
                      Derivatives& derivatives) const {
    Jacobian axes;
    const Vector3 end =
        end_of(deflection->joints, deflection->end_effector, commanded, phases, &axes).position;
    const auto axis_of = [&](std::size_t joint) -> Vector3 {
      return {axes[joint][0], axes[joint][1], axes[joint][2]};
    };
    const auto origin_of = [&](std::size_t joint) -> Vector3 {
      if (joint == size()) return end;
      return {axes[joint][3], axes[joint][4], axes[joint][5]};
    };
    const Vector3& gravity = deflection->gravity;
    for (std::size_t joint = 0; joint < size(); ++joint) {
      Joints& row = derivatives.deflections[joint];
      row.fill(0.0);
      if (!joints[joint].turns) continue;
      const Vector3 axis = axis_of(joint);
      // The turn by a place that shifts: axis . (shift x gravity) = shift . across.
      const Vector3 across = cross(gravity, axis);
      const double* compliances = &deflection->compliances[joint * size()];
      // From the end on: the sum of the places after the joint that moves.
      double weight = 0.0;
      Vector3 sum{0.0, 0.0, 0.0};
      for (std::size_t moved = size(); moved-- > joint;) {
        weight += compliances[moved];
        sum = sum + compliances[moved] * origin_of(moved + 1);
        const Vector3 lever = sum - weight * origin_of(moved);
        row[moved] = dot(axis_of(moved), joints[moved].turns ? cross(lever, across)
                                                             : weight * across);
      }
      const Vector3 lever = sum - weight * origin_of(joint);
      const Vector3 moment = cross(lever, gravity);
      positions[joint] += dot(axis, moment);
      const Vector3 turned = cross(lever, across) + cross(axis, moment);
      for (std::size_t moved = 0; moved < joint; ++moved)
        if (joints[moved].turns) row[moved] = dot(axis_of(moved), turned);
    }
  }

  bool moves_end() const { return pose_network || pose_harmonics; }

  Placement motion(const Joints& positions, const Phases& phases) const {
    if (!pose_harmonics) return exponential(network_motion(positions));
    const Placement periodic = exponential(harmonic_motion(positions, phases));
    return pose_network ? periodic * exponential(network_motion(positions)) : periodic;
  }

  // A twist so small that half the cross product is the exponential's coupling of rotation and
  // translation, to 1e-9 m.
  static Placement exponential(const Twist& twist) {
    const Vector3 linear{twist[0], twist[1], twist[2]}, angular{twist[3], twist[4], twist[5]};
    return {rotation_about(angular), linear + 0.5 * cross(angular, linear)};
  }

  Twist harmonic_motion(const Joints& positions, const Phases& phases) const {
    const PoseHarmonics& part = *pose_harmonics;
    std::vector<Phase> singles(part.singles.size());
    for (std::size_t number = 0; number < singles.size(); ++number) {
      const PoseHarmonics::Single& single = part.singles[number];
      singles[number] = phase_of(single.joint, single.frequency, positions, phases);
    }
    Twist twist{};
    const PoseHarmonics::Factor* factor = part.factors.data();
    for (const PoseHarmonics::Wave& wave : part.waves) {
      Phase phase{1.0, 0.0};
      for (; factor != part.factors.data() + wave.end; ++factor) {
        const Phase& single = singles[factor->single];
        phase = phase * Phase{single.cosine, factor->direction * single.sine};
      }
      for (std::size_t row = 0; row < 6; ++row)
        twist[row] += wave.cosines[row] * phase.cosine + wave.sines[row] * phase.sine;
    }
    return twist;
  }

  Twist network_motion(const Joints& positions) const {
    const PoseNetwork& network = *pose_network;
    Joints scaled;
    for (std::size_t joint = 0; joint < size(); ++joint)
      scaled[joint] = (positions[joint] - pose_scaling.centre[joint]) /
                      pose_scaling.half_width[joint];
    Twist twist{};
    for (std::size_t unit = 0; unit < network.hidden; ++unit) {
      double sum = network.bias[unit];
      for (std::size_t joint = 0; joint < size(); ++joint)
        sum += network.input[unit * size() + joint] * scaled[joint];
      const double activation = std::tanh(sum);
      for (std::size_t row = 0; row < 6; ++row)
        twist[row] += network.output[unit * 6 + row] * activation;
    }
    return twist;
  }

  static Placement moved_back(const Placement& target, const Placement& motion) {
    const Rotation rotation = target.rotation * motion.rotation.inverse();
    return {rotation, target.position - rotation * motion.position};
  }
};

}  // namespace annik
