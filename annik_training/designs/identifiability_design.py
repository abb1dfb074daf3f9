"""A design for learning an arm from measured poses: where its errors show best.

D-optimal, greedily: of many random joint positions, the next is always that which adds most to the
determinant of the information on the model's parameters [Mitchell1974]_, geometric errors and
joint networks alike, each counted in natural units.

References:
    [Mitchell1974] T. J. Mitchell: An algorithm for the construction of "D-optimal" experimental
    designs. Technometrics 16 (2), 1974.
"""

from __future__ import annotations

import numpy as np

from annik_core.pose import FloatArray
from annik_core.robots.robot import Robot
from annik_training.designs.errors import DesignError

NAME = "identifiability"
#: Joint positions to choose from.
_CANDIDATES = 1000
#: By which the lengths and angles of a measured pose are weighed against each other [m], [rad].
_POSITION_NOISE, _ORIENTATION_NOISE = 5e-5, 5e-5


def identifiability_design(robot: Robot, examples: int, rng: np.random.Generator) -> FloatArray:
    """Joint positions ``(examples, dof)`` [rad or m] inside the joint box.

    Args:
        robot: a nominal arm.
        examples: how many, 1 to 1000.
        rng: draws the candidates, and the networks whose errors are to show.

    Raises:
        DesignError: if there are too few or too many examples.
        UnsupportedRobot: if it is no arm.
    """
    from annik_training.calibration.model import GrayBoxModel, Part
    from annik_training.calibration.observations import Noise

    if not 1 <= examples <= _CANDIDATES:
        raise DesignError(f"{NAME} chooses 1 to {_CANDIDATES} examples, not {examples}")
    model = GrayBoxModel(robot, frozenset({Part.GEOMETRY, Part.JOINT_NETWORKS}))
    candidates = robot.joint_box.sample(_CANDIDATES, rng)
    # Errors as large as they are expected to be: a network that says nothing can't be learned of.
    columns = model.evaluate(rng.normal(size=model.size), candidates).columns
    noise = Noise(_POSITION_NOISE, _ORIENTATION_NOISE)
    rows = np.concatenate(
        [columns[:, :3] / noise.position, columns[:, 3:] / noise.orientation], axis=1
    )
    return candidates[_greedy(rows, examples)]


def _greedy(rows: FloatArray, examples: int) -> list[int]:
    """Indices of the candidates ``(n, 6, p)`` chosen one after the other."""
    covariance = np.eye(rows.shape[2])
    # What each candidate's measurements are still unsure by, given those chosen.
    unsure = rows @ np.swapaxes(rows, 1, 2)
    chosen: list[int] = []
    for _ in range(examples):
        gains = np.linalg.slogdet(np.eye(6) + unsure)[1]
        gains[chosen] = -np.inf
        best = int(np.argmax(gains))
        chosen.append(best)
        learned = rows[best] @ covariance
        inside = np.linalg.inv(np.eye(6) + unsure[best])
        covariance = covariance - learned.T @ inside @ learned
        shared = rows @ learned.T
        unsure = unsure - shared @ inside @ np.swapaxes(shared, 1, 2)
    return chosen
