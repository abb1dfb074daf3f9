"""Parametric forward kinematics of an arm, for its calibration.

``pose = base * product of (placement, joint motion, geometric errors) * tool * exp(motion)``: the
nominal chain with geometric errors (:mod:`annik_core.robots.kinematic_errors`), joint positions
with what each joint's series, deflection or network adds, and a small motion of the end effector
that depends on all joints. Parameters are in natural units, in which their prior is Gaussian with
unit variance.
"""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from annik_core.pose import FloatArray
from annik_core.robots.arm_kinematics import gravity_moments
from annik_core.robots.corrections import (
    ArmCorrections,
    Deflection,
    JointHarmonics,
    JointNetworks,
    PoseHarmonics,
    PoseNetwork,
)
from annik_core.robots.kinematic_errors import (
    ErrorKind,
    GeometricError,
    geometric_errors,
    placements_of,
)
from annik_core.robots.robot import Robot
from annik_core.robots.screw_chain import ScrewChain
from annik_training.errors import UnsupportedRobot


class Part(Enum):
    """A part of the model that a calibration may use or leave out."""

    GEOMETRY = "geometry"
    ALIGNMENT = "alignment"
    DEFLECTION = "deflection"
    JOINT_SERIES = "joint series"
    POSE_SERIES = "pose series"
    JOINT_NETWORKS = "joint networks"
    POSE_NETWORK = "pose network"


#: Errors that Denavit and Hartenberg's parameters can't express. Those of the end effector are
#: part of the geometry: four parameters are too few for it.
_ALIGNMENTS = (ErrorKind.ALIGNMENT_OF_BASE, ErrorKind.LINK_ALIGNMENT)
#: Orders of each joint's Fourier series, in bands whose sizes are found each for itself. A
#: harmonic drive or a row of gears has errors of tens of periods a turn.
BANDS = ((1,), (2,), (3, 4), (5, 6, 7, 8), tuple(range(9, 17)), tuple(range(17, 33)))
ORDERS = BANDS[-1][-1]
#: Hidden units of each joint's network: enough for one period of a gear error in a joint box.
JOINT_UNITS = 4
#: Hidden units of the network of the end effector's motion.
POSE_UNITS = 6

_DEGREE = np.pi / 180.0
#: Natural units of angles [rad] and lengths [m], by the kind of error.
_ANGLES = {ErrorKind.JOINT_ZERO: 0.5 * _DEGREE}
_ANGLE, _LENGTH = 0.3 * _DEGREE, 1e-3
#: Of a joint network's output, revolute [rad] and prismatic [m].
_JOINT_ANGLE, _JOINT_LENGTH = 0.3 * _DEGREE, 0.3e-3
#: Of the first order of a joint's series, revolute [rad] and prismatic [m]; of order k a k-th.
_SERIES_ANGLE, _SERIES_LENGTH = 0.1 * _DEGREE, 1e-4
#: Of a joint's compliance, per moment arm [rad/m]; where masses are known, per moment [rad/(N m)].
_COMPLIANCE, _COMPLIANCE_OF_MASSES = 1e-3, 2e-5
_GRAVITY = 9.81
#: Of a hidden unit's input weight, per half width of the joint box.
_INPUT_WEIGHT = 1.5
#: Of the pose network's outputs: linear [m], angular [rad].
_MOTION = np.array([2e-4, 2e-4, 2e-4, 0.02 * _DEGREE, 0.02 * _DEGREE, 0.02 * _DEGREE])


class Evaluated(NamedTuple):
    """Poses of a model and their derivatives."""

    positions: FloatArray  #: ``(n, 3)`` of the end effector in the base frame [m]
    rotations: FloatArray  #: ``(n, 3, 3)``
    #: ``(n, 6, p)`` derivatives by the parameters: linear [m] and angular [rad] motion of the end
    #: effector in the base frame.
    columns: FloatArray


class _Screw(NamedTuple):
    """Axis of a rotation or translation, in the base frame."""

    is_rotation: bool
    direction: FloatArray
    point: FloatArray


@dataclass(frozen=True, eq=False)
class ParametricModel:
    """Parametric forward kinematics of one arm."""

    robot: Robot  #: the nominal arm
    parts: frozenset[Part]  #: parts of the model that have parameters
    #: ``(3,)`` direction of the gravity in the base frame, a unit vector.
    gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)

    def __post_init__(self) -> None:
        check_nominal_arm(self.robot)

    @cached_property
    def errors(self) -> tuple[GeometricError, ...]:
        """Geometric errors that are parameters, in the order of the chain."""
        return tuple(
            error
            for error in geometric_errors(self.robot)
            if (Part.ALIGNMENT if error.kind in _ALIGNMENTS else Part.GEOMETRY) in self.parts
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        names = [error.name for error in self.errors]
        joints = self.robot.joint_names
        names += [
            f"{joints[joint]}: compliance to the weight after joint {place + 1}"
            for joint, place in self._pairs
        ]
        if self._has_masses:
            names += [f"{joint}: compliance to the weight of the links" for joint in joints]
        if Part.JOINT_SERIES in self.parts:
            names += [correction_name(joint) for joint in joints for _ in range(2 * ORDERS)]
        if Part.POSE_SERIES in self.parts:
            names += ["motion of the end effector"] * self._motion_size
        if Part.JOINT_NETWORKS in self.parts:
            names += [
                correction_name(joint)
                for joint in self.robot.joint_names
                for _ in range(3 * JOINT_UNITS)
            ]
        if Part.POSE_NETWORK in self.parts:
            names += ["motion of the end effector"] * self._pose_parameters
        return tuple(names)

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    @cached_property
    def groups(self) -> tuple[NDArray[np.int64], ...]:
        """Indices of the parameters whose common size in natural units the examples tell.

        Those of the geometry have the size that the description's errors are known to have.
        """
        start, pairs = len(self.errors), len(self._pairs)
        groups = [start + np.arange(pairs)] if pairs else []
        if self._has_masses:
            groups.append(start + pairs + np.arange(self.robot.dof))
        if Part.JOINT_SERIES in self.parts:
            indices = self._series_start + np.arange(self.robot.dof * 2 * ORDERS)
            series = indices.reshape(self.robot.dof, 2, ORDERS)
            groups += [series[..., np.array(band) - 1].ravel() for band in BANDS]
        if Part.POSE_SERIES in self.parts:
            groups.append(self._motion_start + np.arange(self._motion_size))
        return tuple(groups)

    def indices_in(self, other: "ParametricModel") -> NDArray[np.int64]:
        """Where its parameters, none of networks, are in a model with these parts and others."""
        names = [error.name for error in other.errors]
        start, own = other._series_start, self._series_start - len(self.errors)
        geometry = [names.index(error.name) for error in self.errors]
        deflection = range(len(names), start)[:own]
        series = range(start, other.size)[: self._motion_start - self._series_start]
        motion = range(other._motion_start, other.size)[: self.size - self._motion_start]
        return np.array([*geometry, *deflection, *series, *motion], dtype=np.int64)

    @property
    def has_networks(self) -> bool:
        """Whether parameters are weights of networks, far from linear."""
        return bool({Part.JOINT_NETWORKS, Part.POSE_NETWORK} & self.parts)

    def amount(self, error: GeometricError, parameter: float) -> float:
        """A geometric error [rad or m] by its parameter."""
        return parameter * _unit(error)

    def start(self, rng: np.random.Generator) -> FloatArray:
        """Initial parameters ``(p,)``: the nominal robot with random networks."""
        start = np.zeros(self.size)
        weights = self._networks(start)
        weights[:] = rng.normal(size=len(weights))
        joints, pose = self._split(start)
        # Small outputs, from hidden units that differ.
        if joints is not None:
            joints[..., 0] *= 0.1
        if pose is not None:
            pose[-6 * POSE_UNITS :] *= 0.1
        return start

    def positions_and_rotations(
        self, parameters: FloatArray, joint_positions: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Positions ``(n, 3)`` [m] and rotations ``(n, 3, 3)`` at ``(p,)`` and ``(n, dof)``."""
        return self._forward(parameters, joint_positions)[:2]

    def evaluate(self, parameters: FloatArray, joint_positions: FloatArray) -> Evaluated:
        """The same, with derivatives by the parameters."""
        positions, rotations, screws, joint_screws = self._forward(parameters, joint_positions)
        columns = np.zeros((len(joint_positions), 6, self.size))
        for index, (error, screw) in enumerate(zip(self.errors, screws, strict=True)):
            columns[:, :, index] = _column(screw, positions) * _unit(error)
        joints, pose = self._split(parameters)
        place = len(self.errors)
        motions = [_column(screw, positions) for screw in joint_screws]
        if self._pairs:
            turns = self._deflection_functions(joint_positions)
            for motion, own in zip(motions, np.swapaxes(turns, 0, 1), strict=True):
                columns[:, :, place : self._series_start] += motion[:, :, None] * own[:, None, :]
            place = self._series_start
        if Part.JOINT_SERIES in self.parts:
            functions = self._series_functions(joint_positions)
            for motion, own in zip(motions, np.swapaxes(functions, 0, 1), strict=True):
                columns[:, :, place : place + 2 * ORDERS] = motion[:, :, None] * own[:, None, :]
                place += 2 * ORDERS
        if Part.POSE_SERIES in self.parts:
            functions = self._motion_functions(joint_positions)
            columns[:, :, place : place + self._motion_size] = _in_base(rotations, functions)
            place += self._motion_size
        if joints is not None:
            for index, motion in enumerate(motions):
                by_parameter = self._joint_derivatives(
                    joints[index], joint_positions[:, index], index
                )
                width = by_parameter.shape[1]
                columns[:, :, place : place + width] = (
                    motion[:, :, None] * by_parameter[:, None, :]
                )
                place += width
        if pose is not None:
            columns[:, :, place:] = self._pose_columns(pose, joint_positions, rotations)
        return Evaluated(positions, rotations, columns)

    def correction_derivatives(
        self, parameters: FloatArray, joint_positions: FloatArray, index: int
    ) -> FloatArray:
        """Derivatives ``(n, 3 units)`` of a joint's correction by its network's parameters."""
        joints, _ = self._split(parameters)
        assert joints is not None
        return self._joint_derivatives(joints[index], joint_positions[:, index], index)

    def corrections(self, parameters: FloatArray) -> ArmCorrections:
        """Corrections of a robot's definition by parameters ``(p,)``."""
        amounts = parameters[: len(self.errors)] * [_unit(error) for error in self.errors]
        joints, pose = self._split(parameters)
        return ArmCorrections(
            placements_of(self.errors, amounts, self.robot.dof),
            None if joints is None else self._joint_networks(joints),
            None if pose is None else self._pose_network(pose),
            joint_harmonics=self._joint_series(parameters),
            deflection=self._deflection(parameters),
            pose_harmonics=self._pose_series(parameters),
        )

    @cached_property
    def _pairs(self) -> tuple[tuple[int, int], ...]:
        """Joints that turn, each with the places after it whose weight may turn it."""
        if Part.DEFLECTION not in self.parts:
            return ()
        dof, kinds = self.robot.dof, self.robot.joint_types
        return tuple(
            (joint, place)
            for joint in range(dof)
            if kinds[joint] != "prismatic"
            for place in range(joint, dof)
        )

    @property
    def _has_masses(self) -> bool:
        """Whether each joint has a compliance to the weights that are known."""
        return bool(self._pairs) and self.robot.masses is not None

    @cached_property
    def _compliances(self) -> FloatArray:
        """``(parameters, dof, dof)`` compliances [rad/m] of the deflection by its parameters.

        Where masses are known, a joint has one for all of them, and those for each place are what
        the masses leave unexplained: without need their common size vanishes.
        """
        dof, pairs = self.robot.dof, len(self._pairs)
        compliances = np.zeros((self._series_start - len(self.errors), dof, dof))
        for number, (joint, place) in enumerate(self._pairs):
            compliances[number, joint, place] = _COMPLIANCE
            if self.robot.masses is not None:
                weight = _GRAVITY * self.robot.masses[place]
                compliances[pairs + joint, joint, place] = _COMPLIANCE_OF_MASSES * weight
        return compliances

    @cached_property
    def _series_start(self) -> int:
        """Number of the parameters of geometry and deflection."""
        own = len(self._pairs) + self.robot.dof * self._has_masses
        return len(self.errors) + own

    def _moments(self, joint_positions: FloatArray) -> FloatArray:
        return gravity_moments(self._chain, joint_positions, np.array(self.gravity))

    def _deflection_functions(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives ``(n, dof, p)`` of the joints' deflections by their parameters."""
        moments = self._moments(joint_positions)
        functions: FloatArray = np.einsum("njk,pjk->njp", moments, self._compliances)
        return functions

    def _deflection(self, parameters: FloatArray) -> Deflection | None:
        if not self._pairs:
            return None
        own = parameters[len(self.errors) : self._series_start]
        return Deflection(np.tensordot(own, self._compliances, 1), np.array(self.gravity))

    @cached_property
    def _series_units(self) -> FloatArray:
        """``(dof, orders)`` [rad or m]."""
        first = np.where(self._prismatic, _SERIES_LENGTH, _SERIES_ANGLE)
        return np.outer(first, 1.0 / np.arange(1.0, ORDERS + 1.0))

    @cached_property
    def _frequencies(self) -> FloatArray:
        """``(dof,)``: one period a turn; of a prismatic joint half a period in its interval."""
        half = self.scale[1]
        return np.where(self._prismatic, 0.5 * np.pi / half, 1.0)

    @cached_property
    def _prismatic(self) -> NDArray[np.bool_]:
        return np.array([kind == "prismatic" for kind in self.robot.joint_types])

    def _joint_series(self, parameters: FloatArray) -> JointHarmonics | None:
        if Part.JOINT_SERIES not in self.parts:
            return None
        start, size = self._series_start, self.robot.dof * 2 * ORDERS
        own = parameters[start : start + size].reshape(self.robot.dof, 2, ORDERS)
        own = own * self._series_units[:, None, :]
        return JointHarmonics(self._frequencies, own[:, 0].copy(), own[:, 1].copy())

    @property
    def _motion_start(self) -> int:
        """Number of the parameters of geometry, deflection and joint series."""
        series = Part.JOINT_SERIES in self.parts
        return self._series_start + self.robot.dof * 2 * ORDERS * series

    @property
    def _motion_size(self) -> int:
        """Number of the parameters of the pose series: two times six of a wave."""
        return 12 * len(self._waves)

    @cached_property
    def _waves(self) -> FloatArray:
        """``(waves, dof)``: each joint with one and two periods, and each pair of joints."""
        identity = np.eye(self.robot.dof)
        first, second = np.triu_indices(self.robot.dof, 1)
        pairs = [identity[first] + identity[second], identity[first] - identity[second]]
        waves: FloatArray = np.concatenate([identity, 2.0 * identity, *pairs])
        return waves * self._frequencies

    def _pose_series(self, parameters: FloatArray) -> PoseHarmonics | None:
        if Part.POSE_SERIES not in self.parts:
            return None
        start = self._motion_start
        own = parameters[start : start + self._motion_size].reshape(2, 6, -1)
        own = own * self._motion_units
        return PoseHarmonics(self._waves, own[0], own[1])

    @cached_property
    def _motion_units(self) -> FloatArray:
        """``(6, waves)``: less for waves that change faster."""
        periods = np.abs(self._waves / self._frequencies).sum(axis=1)
        return np.outer(_MOTION, 1.0 / periods)

    def _motion_functions(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives ``(n, 6, p)`` of the end effector's motion by its series' parameters."""
        angles = joint_positions @ self._waves.T
        functions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        columns = np.zeros((len(angles), 6, 2, 6, len(self._waves)))
        rows = np.arange(6)
        columns[:, rows, :, rows] = functions * self._motion_units[:, None, None, :]
        return columns.reshape(len(angles), 6, -1)

    def _series_functions(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives ``(n, dof, 2 orders)`` of the joints' corrections by their parameters."""
        orders = np.arange(1.0, ORDERS + 1.0)
        angles = (joint_positions * self._frequencies)[..., None] * orders
        functions = np.stack([np.sin(angles), np.cos(angles)], axis=2)
        functions *= self._series_units[:, None, :]
        return functions.reshape(*joint_positions.shape, 2 * ORDERS)

    def _forward(
        self, parameters: FloatArray, joint_positions: FloatArray
    ) -> tuple[FloatArray, FloatArray, list[_Screw], list[_Screw]]:
        chain, joints, pose = self._chain, *self._split(parameters)
        actual = joint_positions
        if joints is not None:
            actual = self._joint_networks(joints).actual(joint_positions)
        series, deflection = self._joint_series(parameters), self._deflection(parameters)
        if series is not None:
            actual = actual + (series.actual(joint_positions) - joint_positions)
        if deflection is not None:
            actual = actual + (self._moments(joint_positions) * deflection.compliances).sum(-1)
        count = len(joint_positions)
        rotation, position = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
        screws: list[_Screw] = []
        joint_screws: list[_Screw] = []
        errors = list(zip(self.errors, parameters, strict=False))
        for place in range(self.robot.dof + 1):
            if place > 0:
                rotation, position = _after(rotation, position, chain.placements[place - 1])
                linear, angular = chain.axes[place - 1, :3], chain.axes[place - 1, 3:]
                turns = bool(np.any(angular))
                axis = angular if turns else linear
                joint_screws.append(_Screw(turns, rotation @ axis, position))
                if turns:
                    rotation = rotation @ _exponentials(actual[:, place - 1, None] * axis)
                else:
                    position = position + actual[:, place - 1, None] * (rotation @ axis)
            for error, parameter in errors:
                if error.place != place:
                    continue
                point = position + rotation @ error.point
                screws.append(_Screw(error.is_rotation, rotation @ error.direction, point))
                motion = error.motion(float(parameter) * _unit(error))
                rotation, position = _after(rotation, position, motion)
        rotation, position = _after(rotation, position, chain.placements[-1])
        network = None if pose is None else self._pose_network(pose)
        for part in (self._pose_series(parameters), network):
            if part is None:
                continue
            motions = part.motions(joint_positions)
            linear, angular = motions[:, :3], motions[:, 3:]
            shift = linear + 0.5 * np.cross(angular, linear)
            position = position + np.einsum("nij,nj->ni", rotation, shift)
            rotation = rotation @ _exponentials(angular)
        return position, rotation, screws, joint_screws

    @cached_property
    def _chain(self) -> ScrewChain:
        return ScrewChain.from_urdf(self.robot.definition["urdf"])

    @property
    def _pose_parameters(self) -> int:
        return POSE_UNITS * (self.robot.dof + 1 + 6)

    def _networks(self, parameters: FloatArray) -> FloatArray:
        """A view of the weights of networks."""
        linear = self._motion_start
        if Part.POSE_SERIES in self.parts:
            linear += self._motion_size
        return parameters[linear : self.size]

    def _split(self, parameters: FloatArray) -> tuple[FloatArray | None, FloatArray | None]:
        """Views of the parameters of joint networks ``(dof, units, 3)`` and pose network."""
        rest = self._networks(parameters)
        joints = pose = None
        if Part.JOINT_NETWORKS in self.parts:
            size = self.robot.dof * JOINT_UNITS * 3
            joints, rest = rest[:size].reshape(self.robot.dof, JOINT_UNITS, 3), rest[size:]
        if Part.POSE_NETWORK in self.parts:
            pose = rest
        return joints, pose

    @cached_property
    def scale(self) -> tuple[FloatArray, FloatArray]:
        """Centre and half width of the joint box; half width 1 for a locked joint."""
        box = self.robot.joint_box
        half = 0.5 * (box.upper - box.lower)
        return box.centre, np.where(half > 0.0, half, 1.0)

    @cached_property
    def _joint_units(self) -> FloatArray:
        return np.array(
            [
                _JOINT_LENGTH if kind == "prismatic" else _JOINT_ANGLE
                for kind in self.robot.joint_types
            ]
        )

    def _joint_networks(self, joints: FloatArray) -> JointNetworks:
        return JointNetworks(
            *self.scale,
            _INPUT_WEIGHT * joints[..., 1],
            joints[..., 2].copy(),
            joints[..., 0] * self._joint_units[:, None],
        )

    def _joint_derivatives(
        self, joint: FloatArray, joint_positions: FloatArray, index: int
    ) -> FloatArray:
        """Derivatives ``(n, 3 units)`` of one joint's correction by its parameters."""
        centre, half = (values[index] for values in self.scale)
        scaled = ((joint_positions - centre) / half)[:, None]
        active = np.tanh(_INPUT_WEIGHT * joint[:, 1] * scaled + joint[:, 2])
        inner = joint[:, 0] * (1.0 - active**2)
        derivatives = np.stack([active, inner * _INPUT_WEIGHT * scaled, inner], axis=-1)
        flat: FloatArray = derivatives.reshape(len(joint_positions), -1) * self._joint_units[index]
        return flat

    def _pose_network(self, pose: FloatArray) -> PoseNetwork:
        inputs, biases, outputs = self._pose_weights(pose)
        return PoseNetwork(*self.scale, inputs, biases, _MOTION[:, None] * outputs)

    def _pose_weights(self, pose: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        dof = self.robot.dof
        inputs, biases, outputs = np.split(pose, [POSE_UNITS * dof, POSE_UNITS * (dof + 1)])
        return inputs.reshape(POSE_UNITS, dof), biases, outputs.reshape(6, POSE_UNITS)

    def _pose_columns(
        self, pose: FloatArray, joint_positions: FloatArray, rotations: FloatArray
    ) -> FloatArray:
        """Derivatives ``(n, 6, p)``, to first order in the small motions."""
        network = self._pose_network(pose)
        scaled = network.scaled(joint_positions)
        active = network.activations(joint_positions)
        count = len(joint_positions)
        by_bias = network.output_weights * (1.0 - active**2)[:, None, :]
        by_input = by_bias[..., None] * scaled[:, None, None, :]
        by_output = np.zeros((count, 6, 6, POSE_UNITS))
        by_output[:, range(6), range(6)] = _MOTION[:, None] * active[:, None, :]
        columns = np.concatenate(
            [by_input.reshape(count, 6, -1), by_bias, by_output.reshape(count, 6, -1)], axis=2
        )
        return _in_base(rotations, columns)


def check_nominal_arm(robot: Robot) -> None:
    """Refuse what is no arm, or is calibrated already, as :class:`UnsupportedRobot`."""
    if robot.kind != "arm" or "corrections" in robot.definition:
        raise UnsupportedRobot(
            "calibration",
            f"{robot.name} ({robot.kind})",
            "it needs the nominal description of an arm, a packaged one or a URDF",
        )


def correction_name(joint: str) -> str:
    """Name of the parameters of a joint's network."""
    return f"{joint}: correction by its position"


def _unit(error: GeometricError) -> float:
    return _ANGLES.get(error.kind, _ANGLE) if error.is_rotation else _LENGTH


def _column(screw: _Screw, positions: FloatArray) -> FloatArray:
    """Motion ``(n, 6)`` of the end effector per unit of motion about or along an axis."""
    if not screw.is_rotation:
        return np.concatenate([screw.direction, np.zeros_like(screw.direction)], axis=1)
    linear = np.cross(screw.direction, positions - screw.point)
    return np.concatenate([linear, screw.direction], axis=1)


def _in_base(rotations: FloatArray, columns: FloatArray) -> FloatArray:
    """Columns ``(n, 6, p)`` of motions in the end effector's frame, in the axes of the base."""
    return np.concatenate([rotations @ columns[:, :3], rotations @ columns[:, 3:]], axis=1)


def _after(
    rotation: FloatArray, position: FloatArray, motion: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rotations ``(n, 3, 3)`` and positions ``(n, 3)`` followed by a motion ``(4, 4)``."""
    return rotation @ motion[:3, :3], position + rotation @ motion[:3, 3]


def _exponentials(rotation_vectors: FloatArray) -> FloatArray:
    matrices: FloatArray = Rotation.from_rotvec(rotation_vectors).as_matrix()
    return matrices
