"""What repeated approaches of the same place tell: play and friction, which no model has.

Two rows are repeated approaches if their joint positions differ by so little that the errors of no
plausible robot could differ much between them. What differs nevertheless is no function of the
joint positions.
"""

import math
from dataclasses import dataclass

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.kinematic_errors import ErrorKind
from annik_training.calibration.estimation import Estimate
from annik_training.calibration.observations import Noise

#: The way of the measured point between repeated approaches is at most this [m].
_NEAR = 0.03
#: Errors of a robot change by at most this part of the way of the measured point.
_SLOPE = 0.01
#: Fewer pairs tell nothing.
_LEAST_PAIRS = 8
#: Approaches that differ by more are play, where the noise of the measurements is not known [m].
_LARGEST_NOISE = 5e-4
#: Otherwise, where they differ by more than so many times that noise.
_TIMES_NOISE = 3.0


@dataclass(frozen=True)
class Repeatability:
    """How far repeated approaches of the same place end from their mean."""

    pairs: int  #: of repeated approaches
    distance: float  #: root of the mean square, besides what the joint positions explain [m]
    #: Whether that is more than the measurements' noise: play or friction.
    is_play: bool


def repeatability(found: Estimate, noise: Noise) -> Repeatability | None:
    """Repeatability by the residuals of a fit; None without enough repeated approaches.

    ``noise`` is that of the measurements, zero if it is not known.
    """
    residuals = found.noise.position * found.residuals[:, :3]
    ways = _ways(found)
    first, second = np.nonzero(np.triu(ways < _NEAR, 1))
    if len(first) < _LEAST_PAIRS:
        return None
    squares = ((residuals[first] - residuals[second]) ** 2).sum(axis=1)
    beyond = np.maximum(0.0, squares - (_SLOPE * ways[first, second]) ** 2)
    distance = math.sqrt(0.5 * float(beyond.mean()))
    largest = _LARGEST_NOISE
    if noise.position > 0.0:
        largest = _TIMES_NOISE * math.sqrt(3.0) * noise.position
    return Repeatability(len(first), distance, distance > largest)


def _ways(found: Estimate) -> FloatArray:
    """Ways ``(n, n)`` of the measured point from row to row, by all joints together [m]."""
    model, joint_positions = found.model, found.observations.joint_positions
    ways = np.zeros((len(joint_positions), len(joint_positions)))
    for index, error in enumerate(model.errors):
        if error.place == 0:
            continue
        slides = model.robot.joint_types[error.place - 1] == "prismatic"
        if error.kind is not (ErrorKind.JOINT_OFFSET if slides else ErrorKind.JOINT_ZERO):
            continue
        motions = found.noise.position * found.derivatives[:, :3, index]
        levers = np.linalg.norm(motions, axis=1) / model.amount(error, 1.0)
        moved = joint_positions[:, error.place - 1]
        ways += np.abs(np.subtract.outer(moved, moved)) * np.maximum.outer(levers, levers)
    return ways
