"""Kinematic corrections of an arm, found by calibration, and a bound of the remaining error."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

from annik_core.kernel import compiled_kernel
from annik_core.pose import QUATERNION_NORM_TOLERANCE, FloatArray
from annik_core.robots.definition import (
    check_positive,
    check_shape,
    checked_arrays,
    checked_numbers,
)
from annik_core.robots.errors import InvalidRobotDefinition


class JointCorrection(Protocol):
    """Actual joint positions as functions of the commanded ones."""

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """Actual joint positions, ``(n, dof)`` or ``(dof,)`` as given [rad or m]."""
        ...

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """Derivatives of the actual by the commanded ones, ``(..., dof, dof)``."""
        ...


def diagonal(derivatives: FloatArray) -> FloatArray:
    """Derivatives ``(..., dof)``, each by its own joint, as matrices ``(..., dof, dof)``."""
    return derivatives[..., np.newaxis] * np.eye(derivatives.shape[-1])


Part = TypeVar("Part", bound="_Part")


@dataclass(frozen=True, eq=False)
class _Part:
    """Arrays of an entry of the corrections."""

    def to_dict(self) -> dict[str, Any]:
        """For a robot definition."""
        return {entry.name: getattr(self, entry.name).tolist() for entry in fields(self)}

    @classmethod
    def from_dict(cls: type[Part], data: Any, dof: int, source: str, what: str) -> Part:
        """The reverse of :meth:`to_dict`, for the entry ``what``.

        Raises:
            InvalidRobotDefinition: naming what is missing or wrong.
        """
        arrays = checked_arrays(data, tuple(entry.name for entry in fields(cls)), what, source)
        for name, shape in cls._shapes(dof, arrays).items():
            check_shape(arrays[name], shape, f"{what}.{name}", source)
        for name in cls._POSITIVE:
            check_positive(arrays[name], f"{what}.{name}", source)
        return cls(**arrays)

    #: Arrays that must be positive.
    _POSITIVE: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def _shapes(cls, dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        """Of the arrays, whose sizes may depend on each other."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class _ScaledPart(_Part):
    """Arrays of a function of the joint positions scaled to their box, [-1, 1].

    ``centre`` and ``half_width``, not zero, are those of the box, ``(dof,)`` [rad or m].
    """

    centre: FloatArray
    half_width: FloatArray

    _POSITIVE: ClassVar[tuple[str, ...]] = ("half_width",)

    def scaled(self, joint_positions: FloatArray) -> FloatArray:
        """Joint positions ``(..., dof)``, scaled."""
        return (joint_positions - self.centre) / self.half_width

    @classmethod
    def _shapes(cls, dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        return {"centre": (dof,), "half_width": (dof,), **cls._other_shapes(dof, arrays)}

    @staticmethod
    def _other_shapes(dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class JointHarmonics(_Part):
    """A Fourier series per joint: its correction as a function of its commanded position.

    ``actual = q + sum over orders k, from 1, of sines[k-1] * sin(k frequency q) + cosines[k-1] *
    cos(k frequency q)``. With a frequency of 1/rad a whole turn of the joint changes nothing.

    Attributes:
        frequencies: ``(dof,)`` [1/rad or 1/m].
        sines: ``(dof, orders)`` [rad or m].
        cosines: ``(dof, orders)``.
    """

    frequencies: FloatArray
    sines: FloatArray
    cosines: FloatArray

    _POSITIVE: ClassVar[tuple[str, ...]] = ("frequencies",)

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`JointCorrection`."""
        angles = self._angles(joint_positions)
        series = self.sines * np.sin(angles) + self.cosines * np.cos(angles)
        actual: FloatArray = joint_positions + series.sum(-1)
        return actual

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`JointCorrection`."""
        angles = self._angles(joint_positions)
        series = self._orders * (self.sines * np.cos(angles) - self.cosines * np.sin(angles))
        return diagonal(1.0 + series.sum(-1))

    @property
    def largest(self) -> FloatArray:
        """``(dof,)`` an upper bound of the corrections [rad or m]."""
        return np.asarray(np.hypot(self.sines, self.cosines).sum(axis=1), dtype=np.float64)

    @property
    def _orders(self) -> FloatArray:
        """Angular frequencies ``(dof, orders)``."""
        return np.outer(self.frequencies, np.arange(1.0, self.sines.shape[1] + 1.0))

    def _angles(self, joint_positions: FloatArray) -> FloatArray:
        return joint_positions[..., np.newaxis] * self._orders

    @classmethod
    def _shapes(cls, dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        shape = (dof, *arrays["sines"].shape[-1:])
        return {"frequencies": (dof,), "sines": shape, "cosines": shape}


@dataclass(frozen=True, eq=False)
class Deflection(_Part):
    """Turns of the joints under the weight of what they carry.

    A joint turns by the sum over later places ``k`` of ``compliances[joint, k]`` times the moment
    about its axis of a unit force along ``gravity`` there. Place ``k`` is the origin of the joint
    after joint ``k``, before that joint's motion, and the last is the end effector, all of the
    nominal chain.

    Attributes:
        compliances: ``(dof, dof)`` [rad/m], of which those with ``k`` from the joint on count.
        gravity: ``(3,)`` direction of the gravity in the base frame, a unit vector.
    """

    compliances: FloatArray
    gravity: FloatArray

    @classmethod
    def _shapes(cls, dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        return {"compliances": (dof, dof), "gravity": (3,)}


@dataclass(frozen=True, eq=False)
class JointNetworks(_ScaledPart):
    """A small network per joint: its correction as a function of its commanded position.

    ``actual = q + sum over hidden units of output_weight * tanh(input_weight * x + bias)``, where
    ``x = (q - centre) / half_width``.

    Attributes:
        input_weights: ``(dof, hidden)``.
        biases: ``(dof, hidden)``.
        output_weights: ``(dof, hidden)`` [rad or m].
    """

    input_weights: FloatArray
    biases: FloatArray
    output_weights: FloatArray

    def actual(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`JointCorrection`."""
        corrections: FloatArray = (self.output_weights * self.activations(joint_positions)).sum(-1)
        return joint_positions + corrections

    def derivatives(self, joint_positions: FloatArray) -> FloatArray:
        """See :class:`JointCorrection`."""
        inner = self.output_weights * self.input_weights / self.half_width[:, np.newaxis]
        derivatives: FloatArray = (inner * (1.0 - self.activations(joint_positions) ** 2)).sum(-1)
        return diagonal(1.0 + derivatives)

    @property
    def largest(self) -> FloatArray:
        """``(dof,)`` an upper bound of the corrections [rad or m]."""
        return np.asarray(np.abs(self.output_weights).sum(axis=1), dtype=np.float64)

    def activations(self, joint_positions: FloatArray) -> FloatArray:
        """The hidden units, ``(..., dof, hidden)``."""
        scaled = self.scaled(joint_positions)[..., np.newaxis]
        activations: FloatArray = np.tanh(scaled * self.input_weights + self.biases)
        return activations

    @staticmethod
    def _other_shapes(dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        shape = (dof, *arrays["input_weights"].shape[-1:])
        return dict.fromkeys(("input_weights", "biases", "output_weights"), shape)


@dataclass(frozen=True, eq=False)
class PoseNetwork(_ScaledPart):
    """A small network from the joint positions to a motion of the end effector in its own frame.

    ``motion = output_weights @ tanh(input_weights @ x + biases)``, where ``x`` are the joint
    positions scaled to their box. The motion is a body twist, applied by the exponential map.

    Attributes:
        input_weights: ``(hidden, dof)``.
        biases: ``(hidden,)``.
        output_weights: ``(6, hidden)``: three rows linear [m], three angular [rad].
    """

    input_weights: FloatArray
    biases: FloatArray
    output_weights: FloatArray

    def motions(self, joint_positions: FloatArray) -> FloatArray:
        """Twists ``(n, 6)`` in the end effector's frame for joint positions ``(n, dof)``."""
        motions: FloatArray = self.activations(joint_positions) @ self.output_weights.T
        return motions

    @property
    def largest_shift(self) -> float:
        """An upper bound of the end effector's shift [m]."""
        return _shift_of(np.abs(self.output_weights).sum(axis=1))

    def activations(self, joint_positions: FloatArray) -> FloatArray:
        """The hidden units, ``(n, hidden)``."""
        scaled = self.scaled(joint_positions)
        activations: FloatArray = np.tanh(scaled @ self.input_weights.T + self.biases)
        return activations

    @staticmethod
    def _other_shapes(dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        hidden = arrays["biases"].shape[-1:]
        return {"biases": hidden, "input_weights": (*hidden, dof), "output_weights": (6, *hidden)}


@dataclass(frozen=True, eq=False)
class PoseHarmonics(_Part):
    """A motion of the end effector in its own frame, periodic in the joint positions.

    ``motion = cosines @ cos(waves @ q) + sines @ sin(waves @ q)``: a body twist, applied by the
    exponential map. With whole numbers a full turn changes nothing.

    Attributes:
        waves: ``(waves, dof)`` angular frequencies by the joints.
        cosines: ``(6, waves)``: three rows linear [m], three angular [rad].
        sines: ``(6, waves)`` likewise.
    """

    waves: FloatArray
    cosines: FloatArray
    sines: FloatArray

    def motions(self, joint_positions: FloatArray) -> FloatArray:
        """Twists ``(n, 6)`` in the end effector's frame for joint positions ``(n, dof)``."""
        angles = joint_positions @ self.waves.T
        motions: FloatArray = np.cos(angles) @ self.cosines.T + np.sin(angles) @ self.sines.T
        return motions

    @property
    def largest_shift(self) -> float:
        """An upper bound of the end effector's shift [m]."""
        return _shift_of(np.hypot(self.cosines, self.sines).sum(axis=1))

    @classmethod
    def _shapes(cls, dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        count = arrays["waves"].shape[:1]
        return {"waves": (*count, dof), "cosines": (6, *count), "sines": (6, *count)}


@dataclass(frozen=True, eq=False)
class ErrorBound(_ScaledPart):
    """A bound of the pose error that holds for 95 of 100 poses.

    Its logarithm is quadratic in ``x``, the joint positions scaled to their box: ``coefficients``
    times (1, x_i, x_i x_j for i <= j), one row for the distance [m] and one for the angle [rad].
    """

    coefficients: FloatArray

    def at(self, joint_positions: FloatArray) -> tuple[float, float]:
        """Bounds of the distance [m] and the angle [rad] at joint positions ``(dof,)``."""
        if self._compiled is not None:
            bounds: tuple[float, float] = self._compiled.at(joint_positions)
            return bounds
        position, orientation = self.of_rows(joint_positions[np.newaxis])[0].tolist()
        return position, orientation

    def of_rows(self, joint_positions: FloatArray) -> FloatArray:
        """:meth:`at` for rows ``(n, dof)``: ``(n, 2)``."""
        # Outside the box the quadratic is not known to hold.
        clipped = np.minimum(np.maximum(self.scaled(joint_positions), -1.0), 1.0)
        bounds: FloatArray = np.exp(quadratic_features(clipped) @ self.coefficients.T)
        return bounds

    @cached_property
    def _compiled(self) -> Any:
        kernel = compiled_kernel()
        parts = self.centre, self.half_width, self.coefficients
        return None if kernel is None else kernel.ErrorBound(*parts)

    @staticmethod
    def _other_shapes(dof: int, arrays: Mapping[str, FloatArray]) -> dict[str, tuple[int, ...]]:
        return {"coefficients": (2, 1 + dof + dof * (dof + 1) // 2)}


def quadratic_features(scaled: FloatArray) -> FloatArray:
    """``(n, 1 + dof + dof (dof + 1) / 2)``: 1, x_i and x_i x_j of rows ``(n, dof)``."""
    first, second = np.triu_indices(scaled.shape[1])
    return np.concatenate(
        [np.ones((len(scaled), 1)), scaled, scaled[:, first] * scaled[:, second]], axis=1
    )


def _shift_of(largest: FloatArray) -> float:
    """An upper bound of a shift [m] by that ``(6,)`` of the twist."""
    linear, angular = np.linalg.norm(largest[:3]), np.linalg.norm(largest[3:])
    return float(linear * (1.0 + 0.5 * angular))


#: Allowed difference of a direction's length from 1.
_UNIT_TOLERANCE = 1e-6
#: Greatest logarithm of a bound.
_LARGEST_EXPONENT = 100.0

_PARTS: dict[str, type[_Part]] = {
    "joint_harmonics": JointHarmonics,
    "deflection": Deflection,
    "joint_networks": JointNetworks,
    "pose_network": PoseNetwork,
    "pose_harmonics": PoseHarmonics,
    "error_bound": ErrorBound,
}
_ENTRIES = ("placements", *_PARTS, "provenance")


@dataclass(frozen=True, eq=False)
class ArmCorrections:
    """The entry ``corrections`` of an arm's definition.

    Attributes:
        placements: ``(dof + 1, 7)`` small motions, as poses, of all links that follow: the first
            before the first joint, in the base frame; number i after the i-th joint, in its frame.
        provenance: from which measurements they were found, and how; JSON data.
    """

    placements: FloatArray
    joint_networks: JointNetworks | None = None
    pose_network: PoseNetwork | None = None
    error_bound: ErrorBound | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)
    joint_harmonics: JointHarmonics | None = None
    deflection: Deflection | None = None
    pose_harmonics: PoseHarmonics | None = None

    def to_dict(self) -> dict[str, Any]:
        """For a robot definition."""
        data: dict[str, Any] = {"placements": self.placements.tolist()}
        for name in _PARTS:
            part = getattr(self, name)
            if part is not None:
                data[name] = part.to_dict()
        if self.provenance:
            data["provenance"] = dict(self.provenance)
        return data

    @classmethod
    def from_dict(cls, data: Any, dof: int, source: str) -> "ArmCorrections":
        """The reverse of :meth:`to_dict`.

        Raises:
            InvalidRobotDefinition: naming what is missing or wrong.
        """
        if not isinstance(data, Mapping) or "placements" not in data:
            raise InvalidRobotDefinition(source, "'corrections' is not a mapping with placements")
        for name in data:
            if name not in _ENTRIES:
                raise InvalidRobotDefinition(
                    source, f"corrections.{name} is not one of {', '.join(_ENTRIES)}"
                )
        placements = checked_numbers(data["placements"], "corrections.placements", source)
        check_shape(placements, (dof + 1, 7), "corrections.placements", source)
        norms = np.linalg.norm(placements[:, 3:], axis=1)
        if not (
            np.isfinite(placements).all()
            and (np.abs(norms - 1.0) <= QUATERNION_NORM_TOLERANCE).all()
        ):
            raise InvalidRobotDefinition(
                source, "corrections.placements are not x, y, z and a unit quaternion each"
            )
        parts: dict[str, Any] = {
            name: part.from_dict(data[name], dof, source, f"corrections.{name}")
            for name, part in _PARTS.items()
            if data.get(name) is not None
        }
        deflection = parts.get("deflection")
        if deflection and abs(np.linalg.norm(deflection.gravity) - 1.0) > _UNIT_TOLERANCE:
            raise InvalidRobotDefinition(
                source, "corrections.deflection.gravity is not a unit vector"
            )
        bound = parts.get("error_bound")
        # Beyond it the exponential overflows.
        if bound and np.abs(bound.coefficients).sum(axis=1).max() > _LARGEST_EXPONENT:
            raise InvalidRobotDefinition(
                source, "corrections.error_bound.coefficients are too large for bounds"
            )
        provenance = data.get("provenance")
        if provenance is None:
            provenance = {}
        if not isinstance(provenance, Mapping):
            raise InvalidRobotDefinition(source, "corrections.provenance is not a mapping")
        placements.flags.writeable = False
        return cls(placements, **parts, provenance=provenance)
